"""What an arm can carry: looked at before it takes hold of something, and before it moves."""

from __future__ import annotations

from bt_dualarm.arm.grip_limit import at_pace, grip_pace
from bt_dualarm.errors import Failure
from bt_dualarm.motion.control.dynamics import ArmDynamics
from bt_dualarm.motion.control.effort import refuse_overload, within_efforts
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Pose, Vector
from bt_dualarm.world.nominal.nominal_load import NominalLoad
from bt_dualarm.world.world import World


class Carrying:
    """The load of one arm against its payload and its joints' efforts.

    Args:
        world: World that the arm is in.
        name: Name of the arm.

    Attributes:
        grip_pace: Share of the pace of the last motion that the grip on what is held allows.
    """

    def __init__(self, world: World, name: str) -> None:
        self._world, self._name = world, name
        self._held: tuple[NominalLoad, ...] | None = None
        self.grip_pace = 1.0

    def within_efforts(self, motion: Trajectory) -> Trajectory:
        """The motion, as much slower as what the arm holds asks for; itself where it may be.

        Raises:
            Failure: ``OVERLOADED`` if the joints' efforts do not suffice at any speed.
        """
        nominal = self._world.nominal[self._name]
        if self._held is not nominal.loads:
            self._held = nominal.loads
            self._dynamics = ArmDynamics(nominal, self._held)
        able = within_efforts(motion, nominal.robot, self._dynamics)
        self.grip_pace = grip_pace(able, self._world, self._name)
        return at_pace(able, self.grip_pace)

    def refuse(self, thing: str, q: Vector, tool_link: Pose, seen: Pose | None = None) -> None:
        """Check an object before the arm takes hold of it, as far as its mass is known.

        Args:
            thing: Name of the object, where it lies.
            q: Configuration in which it is taken, of shape (dof,), rad.
            tool_link: Pose of the tool's link there, in the world.
            seen: Pose of the object in the world by sight; its true one by default.

        Raises:
            Failure: ``OVERLOADED`` if it is more than the arm's payload, or than what its joints
                can hold in that configuration.
        """
        world, nominal = self._world, self._world.nominal[self._name]
        lies, robot = seen or world.object_pose(thing), nominal.robot
        pose = tool_link.inverse @ lies
        new = NominalLoad.of(thing, world.objects[thing], pose, known=not nominal.weighs)
        loads = (*nominal.loads, new)
        mass = sum(load.mass for load in loads if load.mass is not None)
        if robot.payload is not None and mass > robot.payload:
            raise Failure(
                "OVERLOADED",
                f"{self._name} would hold {mass:.3g} kg; "
                f"the payload of {robot.name} is {robot.payload:g} kg",
                mass_kg=mass,
                payload_kg=robot.payload,
            )
        refuse_overload(ArmDynamics(nominal, loads).at_rest(q)[None], robot)
