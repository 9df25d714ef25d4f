"""How a gripper gets around an object: free to before it, then straight; and straight back out."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass

from bt_dualarm.arm.arm import Arm
from bt_dualarm.errors import Failure
from bt_dualarm.motion.grasping.ranking import RankedGrasp
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Matrix, Pose
from bt_dualarm.skill.grasp_search import WantedGrasp

TRIES = 16
"""Grasps whose way is looked for, until the object counts as out of reach."""

_NEAR_M, _NEAR_RAD = 0.02, 0.2
"""Differences of two poses of a tool that hardly matter to whether an arm reaches them."""


@dataclass(frozen=True, eq=False)
class WayToGrasp:
    """A way to a grasp.

    Attributes:
        ranked: Grasp at its end.
        to_standoff: Motion to before the straight part.
        rows: Configurations of the straight part, of shape (n, dof), rad.
        standoff: Length of the straight part, m.
    """

    ranked: RankedGrasp
    to_standoff: Trajectory
    rows: Matrix
    standoff: float

    def back_out(self, arm: Arm, speed: float) -> Iterator[float]:
        """Go back along the straight part, so that another try begins where this one did.

        Args:
            arm: Arm that stands somewhere on it.
            speed: Share of its limits, above 0 to 1.
        """
        out = self.ranked.tool @ Pose.from_rpy((0.0, 0.0, -self.standoff))
        rows = arm.line_on(out)
        motion = arm.begin(arm.time_path(rows, speed), may_touch=True)
        while not motion.done:
            yield motion.progress
            arm.check()
        yield from arm.settle()


def first_way(
    arm: Arm,
    order: Sequence[RankedGrasp],
    wanted: WantedGrasp,
    standoff: float,
    speed: float,
    seen: Pose | None = None,
) -> Generator[None, None, WayToGrasp]:
    """The way to the first of several grasps that has one; yields once a tick.

    Args:
        arm: Arm that is to go there, its gripper open.
        order: Grasps, the best first.
        wanted: What is to be taken.
        standoff: Length of the straight part, m.
        speed: Share of its limits on the way to that, above 0 to 1.
        seen: Pose of the object in the world by sight; the plan then knows it at no other place.

    Raises:
        Failure: ``OUT_OF_REACH`` of the best grasp, caused by all; ``OVERLOADED`` or ``BUSY``.
    """
    reasons, touched = list[Failure](), frozenset({wanted.name} if wanted.name else ())
    left, beyond = list(order), list[Pose]()
    while left and len(reasons) < TRIES:
        # Next to one that cannot be reached the others cannot, either: those come last.
        other = (one for one in left if not any(_is_near(one.tool, pose) for pose in beyond))
        ranked = next(other, left[0])
        left.remove(ranked)
        out = ranked.tool @ Pose.from_rpy((0.0, 0.0, -standoff))
        try:
            rows = arm.line(out, ranked.tool)
            if wanted.name and wanted.edges is None:
                arm.refuse_load(wanted.name, rows[-1], seen)
            arm.refuse_collision_along(rows, ignore=touched)
            unknown = touched if seen else frozenset[str]()
            return WayToGrasp(
                ranked, (yield from arm.plan([rows[0]], speed, unknown)), rows, standoff
            )
        except Failure as failure:
            if failure.code in ("BUSY", "OVERLOADED"):
                raise
            reasons.append(failure.with_traceback(None))  # that refers to this frame
            if failure.code == "UNREACHABLE":
                beyond.append(ranked.tool)
        yield
    first = reasons[0]
    raise Failure(
        "OUT_OF_REACH",
        f"no way to {wanted.label}: {first.reason}",
        ways_tried=len(reasons),
        **first.numbers,
    ) from ExceptionGroup("no way", reasons)


def _is_near(one: Pose, other: Pose) -> bool:
    return one.distance(other) < _NEAR_M and one.angle(other) < _NEAR_RAD
