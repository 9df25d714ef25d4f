"""An arm as skills drive it: its state, gripper and camera, and its motions, also past other arms.

Each leaf gets an `Arm` of its own. `ArmState` measures, `ArmMotions` moves and plans, `PastOthers`
waits, yields and replans while other arms move.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from bt_dualarm.arm.gripper import ArmGripper
from bt_dualarm.arm.known_objects import KnownObjects
from bt_dualarm.arm.motions import WAIT_S, ArmMotions
from bt_dualarm.arm.past_others import PastOthers
from bt_dualarm.arm.shared_arm import SharedArm
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.planning.path_constraints import PathConstraint
from bt_dualarm.planning.path_search import DEFAULT_PLANNER, Planner
from bt_dualarm.sim.camera import GuardedCamera


class Arm(ArmMotions):
    """An arm as one leaf drives it: its state, gripper and camera, its motions and their plans.

    Shapes, units and frames are those of `ArmMotions`.

    Args:
        shared: The arm with what its leaves share.
        leaf: Path of the leaf in its tree.

    Attributes:
        camera: Camera of this arm, if it has one; an error in a callback fails this leaf.
    """

    def __init__(self, shared: SharedArm, leaf: str) -> None:
        super().__init__(shared, leaf)
        self.camera = None if shared.camera is None else GuardedCamera(shared.camera)
        self._gripper = ArmGripper(shared.world, shared.name, self._lease, shared.known)

    def enter(self, *, anew: bool) -> None:
        """Register the thread that ticks or halts the leaf, and whether a new run of it begins."""
        super().enter(anew=anew)
        if anew and self.camera is not None:
            self.camera.fault = None

    def pending_fault(self) -> BaseException | None:
        """Return and clear the error of a camera callback, or of this leaf's motion, if any."""
        if self.camera is not None and self.camera.fault is not None:
            fault = self.camera.fault
            self.camera.fault = None
            return fault
        return super().pending_fault()

    def refuse_dropped(self) -> None:
        """Check that the hand has lost nothing while no leaf was checking.

        Raises:
            Failure: ``DROPPED``.
        """
        self.known.refuse_dropped()

    def come_to_rest(self) -> Iterator[None]:
        """Wait until an earlier motion has ended, such as the braking of a halted leaf.

        A leaf that was halted or failed may also have left behind a gripper that opens.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm; ``TRACKING_ERROR`` when it does not
                come to rest.
        """
        yield from super().come_to_rest()
        if self._shared.unfinished and self.name in self.world.grippers:
            yield from self._gripper.until_let_go()
        self._shared.unfinished = False

    # Gripper, objects and camera

    @property
    def gripper(self) -> ArmGripper:
        """Gripper of this arm.

        Raises:
            Failure: ``NO_GRIPPER``: it has none.
        """
        if self.name not in self.world.grippers:
            raise Failure("NO_GRIPPER", f"{self.name} has no gripper: the file mounts none on it")
        return self._gripper

    def attach(self, name: str, seen: Pose | None = None, *, share: float = 1.0) -> None:
        """Weld an object to the tool at its current pose; repeated calls change nothing.

        Args:
            name: Name of the object.
            seen: Estimated pose in the world, for the nominal model; the true one by default.
            share: Share of the weight that the arm bears, if another one holds the object, too.
        """
        self._lease.refuse_other_threads()
        self.world.attach(self.name, name, seen, share=share)
        self.known.took(name)

    def detach(self, name: str) -> bool:
        """Release an attached object; returns whether it was held."""
        self._lease.refuse_other_threads()
        if name in self.held:
            self.known.left(name)
        return self.world.attachments.detach(self.name, name)

    @property
    def known(self) -> KnownObjects:
        """Where the arm believes objects to be: as declared, seen or felt."""
        return self._shared.known

    def correct_camera(self, correction: Pose) -> None:
        """Correct the camera mount of the nominal model by a pose in the frame assumed so far."""
        self._lease.refuse_other_threads()
        self.world.nominal[self.name].correct_camera(correction)

    @property
    def slips_felt(self) -> int:
        """Number of slips that were detected, whether the grip could become firmer or not."""
        return self._shared.slip.felt

    # Moving among other arms

    def travel(
        self,
        goals: Sequence[Vector],
        speed: float,
        ignore: frozenset[str] = frozenset(),
        *,
        give_way: bool = True,
        patience: float = WAIT_S,
        planner: Planner = DEFAULT_PLANNER,
        keep: PathConstraint | None = None,
        began_s: float | None = None,
        turns: bool = False,
    ) -> Iterator[float | None]:
        """Plan to one of several goals and execute the plan, waiting for other arms; once per tick.

        Args:
            goals: Configurations, each of shape (dof,), rad, the preferred one first.
            speed: Fraction of the limits, above 0 to 1.
            ignore: Names of the objects that may be touched.
            give_way: Whether the arm moves aside if one that has waited longer waits for it; never
                with ``keep``, which a motion aside would not keep.
            patience: Simulated seconds after which it no longer waits or replans.
            planner: Planner to use if the straight path is blocked.
            keep: Constraint along the whole path, if there is one.
            began_s: As for `plan`: the arm may think of its next motion while it takes images.
            turns: Whether the motion may end in a goal with joints rotated by whole turns, at the
                same pose of the tool, if there is none to the goals themselves.

        Raises:
            Failure: As `plan` and `follow`.
        """
        move = self.past_others(speed, ignore)
        give_way = give_way and keep is None
        move = replace(
            move, search=planner, give_way=give_way, wait_s=patience, keep=keep, turns=turns
        )
        return move.go(goals, began_s)

    def past_others(self, speed: float, ignore: frozenset[str] = frozenset()) -> PastOthers:
        """Motions other than `travel` that wait for moving arms and replan."""
        return PastOthers(self, self._shared.patience, self._shared.traffic, speed, ignore)
