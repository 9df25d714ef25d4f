"""Choice of viewpoints: those from which an object is soonest known accurately."""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np
import numpy.typing as npt

from bt_dualarm.arm.arm import Arm
from bt_dualarm.core import rotations
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.perception.expected_fit import ExpectedFit, Stack
from bt_dualarm.perception.shape_fit import SIZE_KNOWN
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.skill.looking import SIDES, Side, camera_now, hidden_share

_SURE: Final = 0.55
"""Fraction of the requested standard deviations that is aimed at: it takes a tenth of a second
more. `place` then touches down nearer to where it expects the support, and a lens that is distorted
more than assumed, which no standard deviation contains, does less harm."""

_WORTH_S: Final = 0.3
"""Longer motion that an estimate is worth if one of its standard deviations is smaller by as much
as is aimed at, s."""

_BEYOND_RAD: Final = 0.2
"""Distance beyond a joint limit up to which a linearized motion may still be possible, rad."""

_BEYOND_S: Final = 1.0
"""Delay assumed for a viewpoint that is probably out of reach, s."""


_MOST_HIDDEN: Final = 0.05
"""Share of its outline that another arm may hide of an object whose image is still of use."""

_SOON: Final = 20
"""Viewpoints soonest reached, of which three are compared at once: 1,140 triples."""

_AT_ONCE: Final = 256
"""Pairs of viewpoints that are compared at once, the soonest reached first."""


class Viewpoints:
    """Choice among `SIDES`: the quickest one to three after which an estimate is accurate enough.

    What an image will tell follows from its viewpoint alone (`ExpectedFit`), so the choice can be
    made while the images of the viewpoint before are being taken.

    Args:
        arm: Arm with a wrist camera.
        looking: Quaternion of the camera at the first view, of shape (4,).
        speed: Fraction of the arm's limits, above 0 to 1.
        accuracy: Requested standard deviation of the position, m.
        angle_accuracy: Requested standard deviation of the rotation, rad.
    """

    def __init__(
        self, arm: Arm, looking: Vector, speed: float, accuracy: float, angle_accuracy: float
    ) -> None:
        self._arm = arm
        self._looking = looking
        self._limits = arm.limits(speed)
        self._accuracy = accuracy
        self._angle_accuracy = angle_accuracy
        self._left: list[Side] = list(SIDES)

    def choose(
        self, expected: ExpectedFit, point: Vector, distance: float, *, pending: bool = False
    ) -> Pose | None:
        """Pose of the camera at the next viewpoint, which is not chosen again.

        Args:
            expected: Information about the least known object.
            point: Point at the image center, in the world, of shape (3,), m.
            distance: Nominal distance from the point, m.
            pending: Whether images from the current pose, not taken yet, come first.

        Returns:
            The pose in the world; None if no viewpoint is left, or if the pending images suffice.
        """
        camera = camera_now(self._arm)
        more = expected.by(camera) if pending else np.zeros_like(expected.information)
        if pending and self._lacks(expected, more[None]).max() <= 1.0:
            return None
        if not self._left:
            return None
        cameras = [side.camera(point, self._looking, distance) for side in self._left]
        by = np.array([self._shown(expected, one) * expected.by(one) for one in cameras])
        chosen = self._best(expected, more, by, self._joint_steps(camera, cameras))
        del self._left[chosen]
        return cameras[chosen]

    def _shown(self, expected: ExpectedFit, camera: Pose) -> float:
        """1 for a pose of the camera from which no other arm hides the object, otherwise 0."""
        center = expected.center
        is_hidden = hidden_share(self._arm, camera, center, expected.shape) > _MOST_HIDDEN
        return 0.0 if is_hidden else 1.0

    def _best(self, expected: ExpectedFit, more: Matrix, by: Stack, steps: Matrix) -> int:
        """Number of the viewpoint to go to next.

        Args:
            expected: Information about the object.
            more: Information by pending images.
            by: Information by an image from each of n viewpoints, of shape (n, rows, rows).
            steps: Joint displacements to each viewpoint, of shape (n, dof), rad.
        """
        late_s = np.where(self._is_beyond(steps), _BEYOND_S, 0.0)
        there_s = travel_s(steps, self._limits) + late_s
        lacks = self._lacks(expected, more + by)
        if lacks.max(axis=1).min() <= 1.0:
            return _best(lacks, there_s)
        if len(by) == 1:
            return 0
        # Two more: the information of both adds up, in either order.
        one, other = np.triu_indices(len(by), 1)
        between_s = travel_s(steps[other] - steps[one], self._limits)
        whole_s = np.minimum(there_s[one] + late_s[other], there_s[other] + late_s[one]) + between_s
        lacks = np.full((len(one), 3), np.inf)
        soonest = np.argsort(whole_s, kind="stable")
        for first in range(0, len(soonest), _AT_ONCE):
            part = soonest[first : first + _AT_ONCE]
            lacks[part] = self._lacks(expected, more + by[one[part]] + by[other[part]])
            if lacks[part].max(axis=1).min() <= 1.0:
                break
        best = _best(lacks, whole_s)
        tour = [int(one[best]), int(other[best])]
        if lacks[best].max() > 1.0:
            tour = self._three(expected, more, by, steps, there_s) or tour
        return min(tour, key=lambda end: float(there_s[end]))

    def _three(
        self, expected: ExpectedFit, more: Matrix, by: Stack, steps: Matrix, there_s: Vector
    ) -> list[int]:
        """Numbers of the three viewpoints after which the object is soonest known; none if unknown.

        Of those that are soon reached: otherwise there are too many. Arguments as for `_best`.
        """
        soon = np.argsort(there_s, kind="stable")[:_SOON]
        numbers = np.array(list(itertools.combinations(soon.tolist(), 3)), dtype=int)
        if not len(numbers):
            return []
        lacks = self._lacks(expected, more + by[numbers].sum(axis=1))
        # In the order in which they are soonest reached.
        numbers = np.take_along_axis(numbers, np.argsort(there_s[numbers], kind="stable"), axis=1)
        legs = np.diff(steps[numbers], axis=1).reshape(-1, steps.shape[1])
        whole_s = there_s[numbers[:, 0]] + travel_s(legs, self._limits).reshape(-1, 2).sum(axis=1)
        best = _best(lacks, whole_s)
        return numbers[best].tolist() if lacks[best].max() <= 1.0 else []

    def _lacks(self, expected: ExpectedFit, more: Stack) -> Matrix:
        """Expected over wanted standard deviations of n alternatives, of shape (n, 3)."""
        wanted = _SURE * np.array((self._accuracy, self._angle_accuracy, SIZE_KNOWN))
        ratios: Matrix = np.column_stack(expected.accuracy(more)) / wanted
        return ratios

    def _joint_steps(self, camera: Pose, cameras: list[Pose]) -> Matrix:
        """Joint displacements to poses of the camera, of shape (n, dof), rad, to first order.

        Accurate enough to compare durations, and a hundred times as fast as inverse kinematics.
        """
        arm = self._arm
        tool = arm.tool_pose
        camera_in_tool = tool.inverse @ camera
        goals = [one @ camera_in_tool.inverse for one in cameras]
        moved = np.array([goal.position for goal in goals]) - tool.position
        turned = rotations.product(
            np.array([goal.quaternion for goal in goals]), rotations.inverse(tool.quaternion[None])
        )
        twists = np.hstack((moved, rotations.rotation_vectors(turned)))
        steps: Matrix = twists @ np.linalg.pinv(arm.kinematics.jacobian(arm.setpoint.q)).T
        return steps

    def _is_beyond(self, steps: Matrix) -> npt.NDArray[np.bool_]:
        q = self._arm.setpoint.q + steps
        limits = self._limits
        beyond = np.maximum(limits.lower - q, q - limits.upper).max(axis=1)
        found: npt.NDArray[np.bool_] = beyond > _BEYOND_RAD
        return found


def _best(lacks: Matrix, seconds: Vector) -> int:
    """Number of the best alternative: one that suffices, if there is one, and is soon done.

    Args:
        lacks: Expected over wanted standard deviations of each, of shape (n, 3).
        seconds: Duration of each, of shape (n,), s.
    """
    worst = lacks.max(axis=1)
    enough = worst <= 1.0
    if not enough.any():
        return int(np.argmin(worst))
    return int(np.argmin(np.where(enough, seconds + _WORTH_S * lacks.sum(axis=1), np.inf)))


def travel_s(steps: Matrix, limits: JointLimits) -> Vector:
    """Duration of motions from rest to rest along straight lines in joint space, of shape (n,), s.

    A motion accelerates with bounded jerk (Biagiotti and Melchiorri, Trajectory Planning for
    Automatic Machines and Robots, 2008, section 3.4). On a straight line all joints move in
    proportion, and each of the three limits is that of the joint which reaches it first.

    Args:
        steps: Joint displacements, of shape (n, dof), rad.
        limits: Limits of velocity, acceleration and jerk.
    """
    away = np.abs(steps).clip(1e-12)
    v, a, j = (
        (limit / away).min(axis=1)  # in lengths of the line per s, s² and s³
        for limit in (limits.velocity, limits.acceleration, limits.jerk)
    )
    ramp = a / j
    with_jerk = (32.0 / j) ** (1.0 / 3.0)  # the acceleration limit is not reached
    accelerating = ramp + np.sqrt(ramp**2 + 4.0 / a)  # nor is the velocity limit
    cruising = 1.0 / v + v / a + ramp
    duration: Vector = np.where(
        2.0 * a**3 / j**2 >= 1.0,
        with_jerk,
        np.where(v**2 / a + v * ramp >= 1.0, accelerating, cruising),
    )
    return duration
