"""Choice of the grasps with which several arms can carry one object along its whole path."""

from __future__ import annotations

import itertools
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.collision.distance import PLANNING_MARGIN_M, RESTING_MARGIN_M
from bt_dualarm.collision.group import GroupChecker
from bt_dualarm.control.internal_wrench import CarryingArm
from bt_dualarm.core.errors import CollisionFailure, Failure, nearest_to_success
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.grasping.candidates import RankedGrasp
from bt_dualarm.grasping.sections import Section, shares_at
from bt_dualarm.kinematics.multi_arm import MultiArmKinematics, ToolTarget, holding
from bt_dualarm.kinematics.solver import Chain
from bt_dualarm.planning.carrying import CarriedPath, CarryPlanner, path_through
from bt_dualarm.sim.world import World
from bt_dualarm.spec.node_types import PortModel, port
from bt_dualarm.spec.values import Angle, Duration, PoseSpec, Speed
from bt_dualarm.trajectory.paths import line

FREE_M: Final = 0.004
"""Height in meters above the goal from which the object is lowered by touch."""

_GRASPS: Final = 4  # grasps to try per arm and section
_MOST_TRIES: Final = 8  # grasps out of reach after which an arm counts as unable to hold a section
_NEAR_M: Final = 0.03  # distance from a grasp out of reach within which others are as well
_NEAR_RAD: Final = 0.3  # likewise, rotation
_COMBINATIONS: Final = 24  # combinations of the arms' grasps to try
_AROUND: Final = 3  # combinations and branches for which paths around obstacles are searched
_BRANCHES: Final = 6  # branches of the inverse kinematics per combination
_GOOD: Final = (
    25.0  # condition number of every arm along the path with which no better one is sought
)
_BEARABLE: Final = 50.0  # largest condition number: beyond, joint torques tell little of a wrench
_EVERY: Final = 8  # one of this many samples of a path is examined


class CarryPorts(PortModel):
    """Ports of skills that carry an object with several arms."""

    set_down: bool = port(
        True, "whether the object is set down and released; that of the arm with the goal counts"
    )
    spread: float = port(
        1.0,
        "distance of the outer grasps along the longest axis, as a fraction of its maximum",
        unit="share",
        ge=0.2,
        le=1.0,
    )
    lift: float = port(0.08, "height of the first lift", unit="m", ge=0.01, le=0.5)
    height: float = port(
        0.04, "height above the goal at which the object is lowered", unit="m", ge=0.01, le=0.3
    )
    standoff: float = port(0.08, "length of the straight approach", unit="m", ge=0.01, le=0.3)
    retreat: float = port(0.08, "length of the retreat", unit="m", ge=0.01, le=0.3)
    speed: Speed = port(0.5, "fraction of the limits of all arms while carrying")
    approach_speed: Speed = port(0.15, "fraction of the arm's limits on the straight parts")
    shake: float = port(8.0, "acceleration that the grips must withstand", unit="m/s²", ge=0, le=50)
    mass: float | None = port(
        None,
        "assumed mass; by default the one that the arms know, or else the largest grip force",
        unit="kg",
        gt=0,
        le=100,
    )
    margin: float = port(2.0, "safety factor of the grips", unit="times the load", ge=1, le=10)
    touch: float = port(40.0, "contact force at which the approach stops", unit="N", ge=1, le=200)
    force: float = port(
        15.0, "contact force at which the support is detected", unit="N", ge=1, le=100
    )
    search: float = port(
        0.015,
        "distance below the goal down to which the support is searched",
        unit="m",
        ge=0.001,
        le=0.1,
    )
    down_speed: Speed = port(
        0.1, "fraction of the limits where contact is expected, at 2 mm/s at most"
    )
    most_internal_force: float = port(
        60.0,
        "largest force with which the arms may press against each other",
        unit="N",
        gt=0,
        le=500,
    )
    most_internal_moment: float = port(
        20.0,
        "largest moment with which the arms may twist or bend the object",
        unit="N m",
        gt=0,
        le=200,
    )
    tolerance: float = port(
        0.008, "largest position error of the object at the end", unit="m", ge=1e-3, le=0.1
    )
    angle_tolerance: Angle = port(
        5.0, "largest rotation error at the end, up to the object's symmetry", ge=0.1, le=90
    )
    settle: Duration = port(2.0, "longest time to come to rest", gt=0, le=30)


@dataclass(frozen=True, eq=False)
class Proposal:
    """What an arm reports to the others about itself and its grasps.

    Attributes:
        goals: Poses of the object that its leaf requests; empty if it follows.
        carrying: Sensors and model for the internal wrench.
        q: Joint positions of the last set-point, of shape (dof,), rad.
        grasps: Grasps at each section that its hand can hold, the best first.
        refusals: Why it has none at a section; None where it has some.
        why_not: Why it has none at all; None if it has some.
        has_released: Whether it has already released the object at the goal, in an earlier attempt
            that was halted before all arms were away.
    """

    goals: tuple[PoseSpec, ...]
    carrying: CarryingArm
    q: Vector
    grasps: tuple[tuple[RankedGrasp, ...], ...]
    refusals: tuple[Failure | None, ...]
    why_not: Failure | None
    has_released: bool = False


@dataclass(frozen=True, eq=False)
class CarryPlan:
    """Plan of the leader for all arms.

    Attributes:
        leader: Name of the arm that plans.
        chosen: Grasp of each arm, by name; empty if they hold the object already.
        grasps: Poses of the tools in the object's frame, by arm.
        shares: Share of the weight that each arm supports.
        approach: Joint positions of each arm's straight approach, of shape (n, dof), rad.
        set_down: Whether the arms set the object down and release it at the end.
    """

    leader: str
    chosen: Mapping[str, RankedGrasp]
    grasps: Mapping[str, Pose]
    shares: Mapping[str, float]
    approach: Mapping[str, Matrix]
    set_down: bool


class _Stage(IntEnum):
    """How far the check of some grasps came before one of them was refused."""

    GRASP = 0
    PATH = 1
    CONDITION = 2


class _Refusal(NamedTuple):
    """Why some grasps do not allow the path.

    Attributes:
        stage: How far their check came.
        failure: The reason.
    """

    stage: _Stage
    failure: Failure


class CarryPlanning:
    """Choice of the grasps of all arms with which the whole path can be followed.

    Args:
        arm: Arm that leads.
        proposals: What each arm can do, in the order of all joints.
        obj: Name of the object.
        ports: Ports of the leader.
    """

    def __init__(
        self, arm: Arm, proposals: Mapping[str, Proposal], obj: str, ports: CarryPorts
    ) -> None:
        self._leader = arm.name
        self._world = arm.world
        self._proposals = proposals
        self._object = obj
        self._ports = ports
        world = arm.world
        arms = {name: (world.robots[name], world.arms[name].base) for name in proposals}
        self._kinematics = MultiArmKinematics(arms)
        self._chains = {name: Chain(*one) for name, one in arms.items()}
        self._reachable = dict[tuple[str, int, bool], list[RankedGrasp]]()
        self._beyond: Failure | None = None

    def plan(
        self, object_pose: Pose, goals: Sequence[Pose], parts: Sequence[Section]
    ) -> Generator[None, None, CarryPlan]:
        """Choose grasps; yields once per attempt.

        Raises:
            Failure: ``OUT_OF_REACH`` with the reason of the attempt that came farthest, caused by
                all; that of the leader where no arm can hold the object at a section.
        """
        held = {name: self._world.attachments.find(name, self._object) for name in self._proposals}
        if all(held.values()):
            grasps = {
                name: one.relative.inverse @ self._world.robots[name].tool
                for name, one in held.items()
                if one is not None
            }
            return CarryPlan(
                self._leader, {}, grasps, self._shares(grasps), {}, self._ports.set_down
            )
        if any(held.values()):
            holder = next(name for name, one in held.items() if one is not None)
            raise Failure(
                "INVALID_TARGET", f"{holder} holds {self._object!r} already, and the others do not"
            )
        for k, part in enumerate(parts):
            refusal = self._proposals[self._leader].refusals[k]
            if refusal is not None and not any(one.grasps[k] for one in self._proposals.values()):
                at = ", ".join(f"{x:.3g}" for x in part.pose.position.round(4) + 0.0)
                raise Failure(
                    refusal.code,
                    f"no arm can hold {self._object!r} at ({at}) m in its frame, where one of "
                    f"{len(parts)} has to: {refusal.reason}",
                    **refusal.numbers,
                ) from refusal
        poses = _poses_of(object_pose, goals, self._ports)
        refusals: list[_Refusal] = []
        best: tuple[float, CarryPlan] | None = None
        tried = (
            (False, False, _COMBINATIONS),
            (False, True, _AROUND),
            (True, False, _COMBINATIONS),  # the best ones may all be nearly the same
            (True, True, _AROUND),
        )
        for apart, around, count in tried:
            if best or (apart and not refusals):
                break
            if around and not any(isinstance(one.failure, CollisionFailure) for one in refusals):
                continue  # searching around obstacles takes much longer
            left = count
            for combination in self._combinations(object_pose, parts, apart):
                yield
                if combination is None:
                    continue
                left -= 1
                found = yield from self._with(combination, poses, around)
                if isinstance(found, _Refusal):
                    refusals.append(found)
                elif best is None or found[0] < best[0]:
                    best = found
                if left <= 0 or (best is not None and (best[0] < _GOOD or around)):
                    break
        if best is not None:
            return best[1]
        if not refusals and self._beyond is not None:
            raise Failure(
                "OUT_OF_REACH",
                f"no grasp at its end of the object is within the reach of an arm: "
                f"{self._beyond.reason}",
                **self._beyond.numbers,
            ) from self._beyond
        if not refusals:
            raise Failure("OUT_OF_REACH", "no arm has a grasp at its end of the object")
        # Why some grasps are not possible says little where others are, and fail later.
        farthest = max(one.stage for one in refusals)
        failure = nearest_to_success([one.failure for one in refusals if one.stage is farthest])
        raise Failure(
            "OUT_OF_REACH",
            f"no grasps of {' and '.join(self._proposals)} allow the whole path: {failure.reason}",
            plans_tried=len(refusals),
            **failure.numbers,
        ) from ExceptionGroup("no way", [one.failure for one in refusals])

    def _combinations(
        self, object_pose: Pose, parts: Sequence[Section], apart: bool
    ) -> Iterator[dict[str, RankedGrasp] | None]:
        """Grasps of all arms: near ends for near arms first, then the best grasps first.

        None where a tick passes without a combination. If they are to be ``apart``, those of an arm
        at one section are not nearly the same.
        """
        names = list(self._proposals)
        bases = [self._world.arms[name].base.position for name in names]
        places = [(object_pose @ part.pose).position for part in parts]

        def distance(order: tuple[int, ...]) -> float:
            return sum(float(np.linalg.norm(bases[i] - places[k])) for i, k in enumerate(order))

        for order in sorted(itertools.permutations(range(len(parts))), key=distance):
            each = list[list[RankedGrasp]]()
            for name, k in zip(names, order, strict=True):
                each.append((yield from self._within_reach(name, k, apart)))
            for chosen in sorted(
                itertools.product(*each), key=lambda some: sum(one.cost for one in some)
            ):
                yield dict(zip(names, chosen, strict=True))

    def _within_reach(
        self, name: str, section: int, apart: bool
    ) -> Generator[None, None, list[RankedGrasp]]:
        """Best grasps of an arm at a section that it can reach by itself.

        In a problem with all arms, the error of one that cannot is spread over all of them. Yields
        once per grasp that is out of reach.
        """
        key = name, section, apart
        if key in self._reachable:
            return self._reachable[key]
        found = self._reachable[key] = []
        known = list[Pose]()  # out of reach, or where grasps are apart already found
        beyond: list[Failure] = []
        alone = MultiArmKinematics({name: (self._world.robots[name], self._world.arms[name].base)})
        near = {name: self._proposals[name].q}
        for one in self._proposals[name].grasps[section]:
            if len(found) >= _GRASPS or len(beyond) >= _MOST_TRIES:
                break
            if any(
                one.tool.distance(other) < _NEAR_M and one.tool.angle(other) < _NEAR_RAD
                for other in known
            ):
                continue
            try:
                alone.solve((ToolTarget(name, one.tool),), near)
            except Failure as failure:
                beyond.append(failure.with_traceback(None))
                known.append(one.tool)
                yield
            else:
                found.append(one)
                if apart:
                    known.append(one.tool)
        if beyond and not found:
            self._beyond = self._beyond or beyond[0]
        return found

    def _with(
        self, chosen: Mapping[str, RankedGrasp], poses: Sequence[Pose], around: bool
    ) -> Generator[None, None, tuple[float, CarryPlan] | _Refusal]:
        """Best conditioned plan with these grasps, with the largest condition number of its path.

        If there is none, the refusal of the branch that came farthest.
        """
        object_pose = poses[0]
        grasps = {name: object_pose.inverse @ one.tool for name, one in chosen.items()}
        widths = {name: one.grasp.width for name, one in chosen.items()}
        checker = GroupChecker(
            self._world, self._kinematics.parts, self._object, grasps, PLANNING_MARGIN_M, widths
        )
        planner = CarryPlanner(self._kinematics, grasps, checker, seed=0)
        near = {name: one.q for name, one in self._proposals.items()}
        refusal: _Refusal | None = None
        best: tuple[float, CarryPlan] | None = None
        branches = self._kinematics.branches(holding(grasps, object_pose), near)
        for q in itertools.islice(branches, _AROUND if around else _BRANCHES):
            yield
            joined = planner.joined(q)
            stage = _Stage.GRASP
            try:
                found = checker.contact(joined)
                if found is not None:
                    raise found.failure()
                approach = self._approach(chosen, q)
                stage = _Stage.PATH
                if around:
                    path = yield from planner.through(poses, joined)
                else:
                    path = planner.along(path_through(poses), joined)
                stage = _Stage.CONDITION
                condition = self._condition(path)
            except Failure as failure:
                if refusal is None or stage > refusal.stage:
                    refusal = _Refusal(stage, failure.with_traceback(None))
                continue
            plan = CarryPlan(
                self._leader, chosen, grasps, self._shares(grasps), approach, self._ports.set_down
            )
            if best is None or condition < best[0]:
                best = condition, plan
            if condition < _GOOD:
                break
        if best is not None:
            return best
        unreachable = Failure("UNREACHABLE", "the grasps are out of reach")
        return refusal or _Refusal(_Stage.GRASP, unreachable)

    def _shares(self, grasps: Mapping[str, Pose]) -> dict[str, float]:
        """Share of the weight that each arm bears with these grasps."""
        shares = shares_of(self._world, self._object, grasps.values())
        return dict(zip(grasps, shares, strict=True))

    def _condition(self, path: CarriedPath) -> float:
        """Largest condition number of an arm along a path.

        Raises:
            Failure: ``SINGULAR``.
        """
        worst = 1.0
        for name, part in self._kinematics.parts.items():
            chain = self._chains[name]
            condition = max(chain.condition(q) for q in path.rows[::_EVERY, part])
            if condition > _BEARABLE:
                raise Failure(
                    "SINGULAR",
                    f"{name} would come too near a singularity",
                    condition=min(condition, 1e12),
                )
            worst = max(worst, condition)
        return worst

    def _approach(
        self, chosen: Mapping[str, RankedGrasp], q: Mapping[str, Vector]
    ) -> dict[str, Matrix]:
        """Straight approaches that end in a configuration, each of shape (n, dof), rad.

        Raises:
            Failure: An arm cannot follow its own, or would be too near something on it, such as
                another arm: the guard stops arms there that group motions allow to be nearer.
        """
        found = {}
        out = Pose.from_rpy((0.0, 0.0, -self._ports.standoff))
        for name, one in chosen.items():
            poses = line(one.tool, one.tool @ out).poses
            alone = MultiArmKinematics({
                name: (self._world.robots[name], self._world.arms[name].base)
            })  # fmt: skip
            rows = alone.follow_on([[ToolTarget(name, pose)] for pose in poses], {name: q[name]})
            found[name] = rows[name][::-1].copy()
        for name, own in found.items():
            others = sorted(found.keys() - {name})
            standoff = self._approach_checker(name, others, PLANNING_MARGIN_M)
            straight = self._approach_checker(name, others, RESTING_MARGIN_M)
            # A plan leads to the standoff; from there, any arm may be the first at its end.
            for checker, end, path in (
                (standoff, 0, own[:1]),
                (straight, 0, own),
                (straight, -1, own[-1:]),
            ):
                for other in others:
                    checker.move_other(self._world.arms[other], found[other][end])
                contact = checker.first_contact(path)
                if contact is not None:
                    raise contact[1].failure()
        return found

    def _approach_checker(
        self, name: str, others: Sequence[str], margin: float
    ) -> CollisionChecker:
        """Checker of an arm whose open hand may touch the object; with margins to other arms, m."""
        checker = CollisionChecker(self._world, name, dict.fromkeys(others, margin))
        hand = list(self._world.arms[name].tool_geom_ids)
        its = list(self._world.object_geoms(self._object))
        checker.least[np.ix_(hand, its)] = checker.least[np.ix_(its, hand)] = -np.inf
        gripper = self._world.grippers.get(name)
        if gripper is not None and gripper.gripper.fingers:
            checker.open_fingers(gripper.gripper.stroke)
        return checker


def shares_of(world: World, obj: str, grasps: Iterable[Pose]) -> list[float]:
    """Share of an object's weight that each of several grasps, in the object's frame, bears."""
    center = world.loaded_center(obj)
    return shares_at([grasp.position - center for grasp in grasps])


def _poses_of(object_pose: Pose, goals: Sequence[Pose], ports: CarryPorts) -> list[Pose]:
    """Poses of the object from where it lies to where it is lowered by touch."""
    end = [goals[-1].raised(ports.height), goals[-1].raised(FREE_M)] if ports.set_down else []
    return [object_pose, object_pose.raised(ports.lift), *goals[:-1], *(end or [goals[-1]])]
