"""What skills have in common that lead the tool along a path."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

from bt_dualarm.motion.paths.cartesian_path import CartesianPath
from bt_dualarm.pose import Pose
from bt_dualarm.skill.held_through import held_through
from bt_dualarm.skill.path_following import TOLERANCE_M, follow_curve
from bt_dualarm.skill.skill import Skill
from bt_dualarm.spec.ports import port


class PathSkill(Skill):
    """Base of skills that draw a path and lead the tool along it, all of it or nothing.

    A subclass declares the ports ``speed`` and ``tolerance`` as they are declared here, draws its
    path in `run`, and goes `along` it.

    Attributes:
        SPEED: Declaration of the port that says how fast the path is gone along.
        TOLERANCE: Declaration of the port that says how exactly.
    """

    # A port's declaration is of any type: the type of the port stands beside its name.
    SPEED: ClassVar[Any] = port(0.5, "share of the arm's limits of velocity, acceleration and jerk")
    TOLERANCE: ClassVar[Any] = port(
        TOLERANCE_M, "how far the tool may be from its plan at any time", unit="m", ge=1e-4, le=0.1
    )
    failures: ClassVar[dict[str, str]] = {
        "SINGULAR": "the path leads through a singularity of the arm; nothing was executed",
        "PATH_BROKEN": "the arm can follow only a part of the path; nothing was executed",
        "IN_COLLISION": "the arm would touch something on the way",
        "TRACKING_ERROR": "the arm was blocked or left its plan by more than the tolerance",
        "SLIPPED": "what the gripper holds slid between the fingers",
        "DROPPED": "fingers or cup no longer hold what they held",
        "BUSY": "another leaf moves the arm",
    }
    needs = ("scipy.interpolate",)

    def along(self, path: CartesianPath, *, to_center: bool = False) -> Iterator[float | None]:
        """Go to the start of a path and along it; what was measured is among the metrics.

        Args:
            path: Path of the tool, in the world.
            to_center: Whether the tool goes on to the middle of a curve, on a straight line.

        Raises:
            Failure: As `follow_curve`; of what the gripper holds as `held_through`.
        """
        end = path.center if to_center else None
        self.metrics |= yield from held_through(self.arm, self._follow(path, end))

    def _follow(self, path: CartesianPath, end: Pose | None) -> Iterator[float | None]:
        ports = self.ports
        self.metrics |= yield from follow_curve(
            self.arm, path, ports.speed, self.record, ports.tolerance, end
        )
