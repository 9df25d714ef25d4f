"""Inverse kinematics of several arms as one problem.

Targets may be relative: two tools keep their relative pose while one of them moves along a path, or
both hold one object. Arms without a target stay where they are.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.kinematics.solver import (
    EXACT,
    NEAR,
    TOOL,
    Chain,
    FrameTask,
    Mechanism,
    Multistart,
    Tolerance,
    branches,
    origin,
    target_matrix,
    with_tool,
)
from bt_dualarm.robots.robot import Robot

_WORLD = "bt_dualarm_world"


@dataclass(frozen=True, eq=False)
class ToolTarget:
    """Target pose of a tool.

    Attributes:
        arm: Name of the arm whose tool it is.
        pose: Target of its tool frame.
        seen_from: Name of the arm in whose tool frame the pose is given; None for the world.
    """

    arm: str
    pose: Pose
    seen_from: str | None = None


def holding(grasps: Mapping[str, Pose], pose: Pose) -> tuple[ToolTarget, ...]:
    """Targets of arms that hold one object: the first arm's tool in the world, others seen from it.

    Args:
        grasps: Poses of the tools in the object's frame, by arm.
        pose: Pose of the object in the world.
    """
    (first, grasp), *others = grasps.items()
    return (
        ToolTarget(first, pose @ grasp),
        *(ToolTarget(arm, grasp.inverse @ other, first) for arm, other in others),
    )


class MultiArmKinematics(Mechanism):
    """Forward and inverse kinematics of one or more arms in one world.

    Configurations are by arm, each of shape (dof,), rad. Equal arguments give equal results (to
    1e-8 rad), independent of earlier calls. Solutions keep the position limits. Not thread-safe.

    Args:
        arms: Robot and pose of its base link in the world, by name.
        seed: Seed of the start configurations for difficult targets.
    """

    def __init__(self, arms: Mapping[str, tuple[Robot, Pose]], seed: int = 0) -> None:
        self._seed = seed
        self._searches: dict[tuple[FrameTask, ...], Multistart] = {}
        self._slices: dict[str, slice] = {}
        root = ET.Element("robot", name="arms")
        # One URDF for PlaCo: all arms fixed to a common link, with prefixed names.
        joints: list[str] = []
        ET.SubElement(root, "link", name=_WORLD)
        for name, (robot, base) in arms.items():
            self._slices[name] = slice(len(joints), len(joints) + len(robot.joints))
            joints += [f"{name}/{joint}" for joint in robot.joints]
            root.extend(_prefixed(name, robot, base))
        limits = [robot.limits for robot, _ in arms.values()]
        super().__init__(
            ET.tostring(root, encoding="unicode"),
            joints,
            np.concatenate([each.lower for each in limits]),
            np.concatenate([each.upper for each in limits]),
        )

    @property
    def parts(self) -> dict[str, slice]:
        """Columns of each arm's joints where those of all arms are side by side."""
        return dict(self._slices)

    def forward(self, arm: str, q: Mapping[str, Vector]) -> Pose:
        """Pose of an arm's tool in the world."""
        self.set_state(self._joined(q))
        return Pose.from_matrix(self.frame(_tool(arm)))

    def solve(
        self,
        targets: Sequence[ToolTarget],
        near: Mapping[str, Vector],
        tolerance: Tolerance = EXACT,
    ) -> dict[str, Vector]:
        """Configurations with all tools on their targets: the solution nearest to ``near``.

        Raises:
            Failure: ``INVALID_TARGET`` for invalid or contradictory targets; ``UNREACHABLE`` with
                the target that is missed by most in the best attempt, and by how much.
        """
        q = self._solutions(targets, near, tolerance, every=False)[0]
        return {name: q[part].copy() for name, part in self._slices.items()}

    def follow(
        self,
        steps: Sequence[Sequence[ToolTarget]],
        near: Mapping[str, Vector],
        tolerance: Tolerance = EXACT,
        *,
        max_step: float = 0.2,
    ) -> dict[str, Matrix]:
        """Configurations along a path without a jump: by arm, of shape (n, dof), rad.

        The branch is the first solution of the first step, nearest first, from which the whole path
        can be followed.

        Args:
            steps: Targets of the same tools at each sample, close together.
            near: Configurations before the path.
            tolerance: Tolerance of each target at each step.
            max_step: Movement of a joint between two steps, in rad, that counts as a jump.

        Raises:
            Failure: As ``solve`` for the first step; ``PATH_BROKEN`` with the largest ``fraction``
                of the path that could be followed.
        """
        keys = [_tasks(step) for step in steps]
        _require(
            len(steps) > 0 and len(set(keys)) == 1, "the targets of a path must be of one kind"
        )
        search = self._search(steps[0])
        goals = [_goals(step) for step in steps]
        tried = 0
        longest = 0
        for start in self._branches(steps[0], near, tolerance):
            rows = search.along(search.continuation, goals, start, tolerance, max_step)
            if len(rows) == len(goals):
                whole = np.array(rows)
                return {name: whole[:, part] for name, part in self._slices.items()}
            tried += 1
            longest = max(longest, len(rows))
        raise _broken(longest / len(goals), tried)

    def follow_on(
        self,
        steps: Sequence[Sequence[ToolTarget]],
        start: Mapping[str, Vector],
        tolerance: Tolerance = EXACT,
        *,
        max_step: float = 0.2,
        least: int | None = None,
    ) -> dict[str, Matrix]:
        """Configurations along a path from given ones, which are the first rows.

        Args:
            steps: Targets of the same tools at each sample; those of the first one are held at
                ``start``.
            start: Configurations at the first sample.
            tolerance: Tolerance of each target at each step.
            max_step: Movement of a joint between two steps, in rad, that counts as a jump.
            least: Number of samples that must be followed; all by default. The rows end where the
                path cannot be followed any further.

        Raises:
            Failure: ``INVALID_TARGET``; ``PATH_BROKEN`` with the ``fraction`` that was followed.
        """
        q = self._joined(start)
        rows = [q]
        if len(steps) > 1:
            keys = [_tasks(step) for step in steps]
            _require(len(set(keys)) == 1, "the targets of a path must be of one kind")
            search = self._search(steps[0])
            goals = [_goals(step) for step in steps[1:]]
            rows += search.along(search.continuation, goals, q, tolerance, max_step)
        if len(rows) < (len(steps) if least is None else least):
            raise _broken(len(rows) / len(steps), 1)
        whole = np.array(rows)
        return {name: whole[:, part] for name, part in self._slices.items()}

    def branches(
        self,
        targets: Sequence[ToolTarget],
        near: Mapping[str, Vector],
        tolerance: Tolerance = EXACT,
    ) -> Iterator[dict[str, Vector]]:
        """Different configurations with all tools on their targets: the nearest ones, then others.

        Raises:
            Failure: As `solve`.
        """
        for q in self._branches(targets, near, tolerance):
            yield {name: q[part].copy() for name, part in self._slices.items()}

    def _branches(
        self, targets: Sequence[ToolTarget], near: Mapping[str, Vector], tolerance: Tolerance
    ) -> Iterator[Vector]:
        """Different configurations for the first step: the nearest ones, then all others."""
        return branches(lambda every: self._solutions(targets, near, tolerance, every=every))

    def _solutions(
        self,
        targets: Sequence[ToolTarget],
        near: Mapping[str, Vector],
        tolerance: Tolerance,
        *,
        every: bool,
    ) -> list[Vector]:
        search = self._search(targets)
        goals = _goals(targets)
        start = self._joined(near)
        found, closest = search.solutions(goals, start, tolerance, every=every, near_enough=NEAR)
        if not found:
            raise _missed(targets, search.residuals(closest, goals))
        return sorted(found, key=lambda q: float(np.linalg.norm(q - start)))

    def _search(self, targets: Sequence[ToolTarget]) -> Multistart:
        """Search for targets of these tools and frames; PlaCo's problem is set up once for each."""
        _require(len(targets) > 0, "there is no target")
        for target in targets:
            for arm in (target.arm, target.seen_from):
                _require(arm is None or arm in self._slices, f"there is no arm {arm!r}")
            _require(target.arm != target.seen_from, f"{target.arm} is given relative to itself")
        key = _tasks(targets)
        _require(len({target.arm for target in targets}) == len(key), "a tool has two targets")
        if key not in self._searches:
            self._searches[key] = Multistart(self.bare, key, self._seed)
        return self._searches[key]

    def _joined(self, q: Mapping[str, Vector]) -> Vector:
        return np.concatenate([q[name] for name in self._slices])


def _tool(arm: str) -> str:
    return f"{arm}/{TOOL}"


def _tasks(targets: Sequence[ToolTarget]) -> tuple[FrameTask, ...]:
    return tuple(
        FrameTask(_tool(aim.arm), None if aim.seen_from is None else _tool(aim.seen_from))
        for aim in targets
    )


def _goals(targets: Sequence[ToolTarget]) -> list[Matrix]:
    return [target_matrix(target.pose) for target in targets]


def _missed(targets: Sequence[ToolTarget], residuals: Sequence[tuple[float, float]]) -> Failure:
    """Failure for unreachable targets, with the one that is missed by most."""
    worst = max(range(len(targets)), key=lambda number: sum(residuals[number]))
    target = targets[worst]
    distance, angle = residuals[worst]
    place = "" if target.seen_from is None else f" seen from {target.seen_from}"
    return Failure(
        "UNREACHABLE",
        f"the tool of {target.arm}{place} gets no closer to its target than "
        f"{1e3 * distance:.1f} mm and {np.rad2deg(angle):.1f}°",
        arm=target.arm,
        residual_m=distance,
        residual_rad=angle,
    )


def _broken(fraction: float, branches: int) -> Failure:
    return Failure(
        "PATH_BROKEN",
        f"the arms can follow only {100.0 * fraction:.0f} % of the path together",
        fraction=fraction,
        branches=branches,
    )


def _require(holds: bool, reason: str) -> None:
    if not holds:
        raise Failure("INVALID_TARGET", reason)


def _prefixed(name: str, robot: Robot, base: Pose) -> list[ET.Element]:
    """Links and joints of an arm with prefixed names, and the joint that fixes it to the world."""
    arm = ET.fromstring(with_tool(robot))  # noqa: S314  # made from our own element
    parts = [*arm.findall("link"), *arm.findall("joint")]
    for part in parts:
        part.set("name", f"{name}/{part.get('name')}")
        for end in (*part.findall("parent"), *part.findall("child")):
            end.set("link", f"{name}/{end.get('link')}")
    children = {end.get("link") for part in parts for end in part.findall("child")}
    (first,) = (part for part in parts if part.tag == "link" and part.get("name") not in children)
    # The robot's base link need not be the root of its URDF: find where the root is.
    chain = Chain(robot, base)
    chain.set_state(robot.postures["home"])
    there = Pose.from_matrix(chain.frame(str(first.get("name")).removeprefix(f"{name}/")))
    return [
        *parts,
        ET.fromstring(  # noqa: S314  # as above
            f'<joint name="{name}/{_WORLD}" type="fixed">{origin(there)}'
            f'<parent link="{_WORLD}"/><child link="{first.get("name")}"/></joint>'
        ),
    ]
