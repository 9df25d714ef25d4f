"""What an arm can carry: looked at before it takes hold of something, and before it moves."""

from __future__ import annotations

from bt_dualarm.errors import Failure
from bt_dualarm.motion.control.dynamics import ArmDynamics, Load
from bt_dualarm.motion.control.effort import refuse_overload, within_efforts
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Pose, Vector
from bt_dualarm.world.attachments import Attachment
from bt_dualarm.world.world import World


class Carrying:
    """The load of one arm against its payload and its joints' efforts.

    Args:
        world: World that the arm is in.
        name: Name of the arm.
    """

    def __init__(self, world: World, name: str) -> None:
        self._world, self._name = world, name
        self._held: tuple[Attachment, ...] = ()
        self._dynamics: ArmDynamics | None = None

    def within_efforts(self, motion: Trajectory) -> Trajectory:
        """The motion, as much slower as what the arm holds asks for; itself where it may be.

        Raises:
            Failure: ``OVERLOADED`` if the joints' efforts do not suffice at any speed.
        """
        held = self._attachments
        if self._dynamics is None or held != self._held:
            self._held, self._dynamics = held, self._with(self._loads(held))
        return within_efforts(motion, self._world.robots[self._name], self._dynamics)

    def refuse(self, thing: str, q: Vector, tool_link: Pose) -> None:
        """Check an object before the arm takes hold of it.

        Args:
            thing: Name of the object, where it lies.
            q: Configuration in which it is taken, of shape (dof,), rad.
            tool_link: Pose of the tool's link there, in the world.

        Raises:
            Failure: ``OVERLOADED`` if it is more than the arm's payload, or than what its joints
                can hold in that configuration.
        """
        world, robot = self._world, self._world.robots[self._name]
        new = Load(world.objects[thing], tool_link.inverse @ world.object_pose(thing))
        loads = (*self._loads(self._attachments), new)
        mass = sum(load.thing.mass for load in loads)
        if robot.payload is not None and mass > robot.payload:
            raise Failure(
                "OVERLOADED",
                f"{self._name} would hold {mass:.3g} kg; "
                f"the payload of {robot.name} is {robot.payload:g} kg",
                mass_kg=mass,
                payload_kg=robot.payload,
            )
        refuse_overload(self._with(loads).at_rest(q)[None], robot)

    @property
    def _attachments(self) -> tuple[Attachment, ...]:
        return tuple(held for held in self._world.attachments if held.arm == self._name)

    def _loads(self, held: tuple[Attachment, ...]) -> tuple[Load, ...]:
        return tuple(Load(self._world.objects[one.object], one.relative) for one in held)

    def _with(self, loads: tuple[Load, ...]) -> ArmDynamics:
        world = self._world
        base = world.declared_arms[self._name].base.pose
        return ArmDynamics(world.robots[self._name], base, world.model.opt.gravity, loads)
