"""Generated cells of two to six arms, and the behavior of each arm when it is alone.

Robots, base poses and tasks are random but feasible: each arm's tree succeeds while it is alone,
arms keep clear of each other's rest configurations, and only arms that cannot meet others have
tasks that do not wait for them, such as tool paths and tracking.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.crowd_members import Member, file_text, tasks_of, tracking_tasks
from benchmarks.measured_robots import MEASURED
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.behaviors.report import StatusChange
from bt_dualarm.collision.distance import ArmDistance, BoundingSpheres, apart
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.pose import Matrix
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.outcome import ArmResult, Outcome
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry

ROOM_M = 0.2
"""Arms cannot meet if their paths when alone are at least this far apart at all times, m."""

REST_M = 0.06
"""Smallest distance between any two rest configurations of two arms, m."""

_BASES_M = 0.4  # smallest distance between two bases
_TRIES = 20  # attempts to add one arm
_SAMPLE_S = 0.05


@dataclass(frozen=True, eq=False)
class Solo:
    """Behavior of an arm when it is alone.

    Attributes:
        member: The arm.
        result: Its result.
        path: Configurations along its motion, of shape (n, dof), rad.
        rests: Configurations at rest between its tasks, of shape (k, dof), rad.
    """

    member: Member
    result: ArmResult
    path: Matrix
    rests: Matrix


class ConfigurationLog(IdleObserver):
    """Configurations of the only arm, sampled over time and at the ends of its leaves."""

    def __init__(self, world: World) -> None:
        (self._body,) = world.arms.values()
        self.path = [self._body.q]
        self.rests = [self._body.q]

    def on_event(self, change: StatusChange) -> None:
        """Record the configuration at the end of a leaf."""
        if change.new == "SUCCESS":
            self.rests.append(self._body.q)

    def after_step(self, time: float) -> None:
        """Sample the configuration."""
        if time >= len(self.path) * _SAMPLE_S:
            self.path.append(self._body.q)


def crowd(seed: int, registry: Registry) -> list[Solo]:
    """The arms of a generated cell; arms are added one by one."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 7))
    side = float(rng.uniform(0.4, 1.3)) * np.sqrt(count)
    solos: list[Solo] = []
    for number in range(1, count + 1):
        for attempt in range(_TRIES):
            waits = attempt >= _TRIES // 2 or bool(rng.random() < 0.5)
            member = _draw(f"arm{number}", side, waits, rng, solos)
            solo = None if member is None else _run_alone(member, solos, registry)
            if solo is not None and _fits(solo, solos):
                solos.append(solo)
                break
    return solos if len(solos) > 1 else crowd(seed + 1_000_000, registry)


def cannot_meet(first: Solo, second: Solo) -> bool:
    """Whether two arms keep `ROOM_M` apart in any combination of their configurations."""
    world = _pair(first, second)
    spheres = []
    for solo in (first, second):
        hull = BoundingSpheres(world, solo.member.name)
        body = world.arms[solo.member.name]
        rows = solo.path[:: max(len(solo.path) // 60, 1)]
        around = []
        for q in (*rows, *solo.rests):
            world.data.qpos[body.qpos_ids] = q
            world.sense()
            around.append(hull.spheres())
        spheres.append(np.vstack(around))
    return apart(*spheres) > ROOM_M


def _draw(
    name: str, side: float, waits: bool, rng: np.random.Generator, others: Sequence[Solo]
) -> Member | None:
    """A random arm with tasks in a square; None if another base is too near."""
    robot = str(rng.choice(MEASURED))
    x, y = rng.uniform(-side / 2, side / 2, 2).round(3).tolist()
    if any(np.hypot(x - one.member.xyz[0], y - one.member.xyz[1]) < _BASES_M for one in others):
        return None
    share = round(float(rng.uniform(0.3, 1.0)), 2)
    looks = robot == "panda" and not waits and rng.random() < 0.7
    yaw = round(float(rng.choice((0, 90, 180, -90)) if looks else rng.uniform(-180, 180)), 1)
    member = Member(name, robot, (x, y, 0.3), yaw, share, waits=waits)
    tasks, cube = tracking_tasks(member) if looks else tasks_of(member, rng)
    return replace(member, tasks=tasks, cube=cube)


def _run_alone(member: Member, others: Sequence[Solo], registry: Registry) -> Solo | None:
    """Behavior of an arm alone, with the others' cubes present; None if it does not succeed."""
    text = file_text([member], [member, *(other.member for other in others)])
    try:
        run = Run(load_tree_file(text, registry.kinds), registry)
    except DualArmError:
        return None
    with run:
        log = ConfigurationLog(run.world)
        run.watch(log)
        result = run.finish().arms[member.name]
    if result.outcome != Outcome.SUCCESS:
        return None
    return Solo(member, result, np.array(log.path), np.array(log.rests))


def _fits(solo: Solo, others: Sequence[Solo]) -> bool:
    """Whether an arm and the others do not obstruct each other."""
    return all(
        cannot_meet(solo, other)
        if not (solo.member.waits and other.member.waits)
        else _rests_are_free(solo, other)
        for other in others
    )


def _rests_are_free(first: Solo, second: Solo) -> bool:
    world = _pair(first, second)
    separation = ArmDistance(world, first.member.name)
    return all(
        separation.gap({first.member.name: a, second.member.name: b}, 2 * REST_M).meters > REST_M
        for a, b in itertools.product(first.rests, second.rests)
    )


def _pair(first: Solo, second: Solo) -> World:
    """A world with two arms at their bases."""
    members = [first.member, second.member]
    return World(load_tree_file(file_text(members, members), Registry.load().kinds))
