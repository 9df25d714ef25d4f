"""Generated cells of two to six arms, and what each of their arms does when it is alone.

Robots, places and tasks are drawn by a seed. Only what can be done is drawn: each arm's tree
succeeds while it is alone, arms leave one another's resting places free, and what does not wait
for others, a tool path or a followed camera image, is left to arms that have room for it.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.crowd_members import Member, file_text, looking, tasks_of
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
"""Arms whose paths, as each goes its own alone, are that far apart at any two times cannot meet."""

REST_M = 0.06
"""Distance in meters between any two configurations in which two arms rest."""

_BASES_M = 0.4  # meters between two bases
_TRIES = 20  # arms drawn for one place in a cell
_SAMPLE_S = 0.05


@dataclass(frozen=True, eq=False)
class Solo:
    """What an arm does alone.

    Attributes:
        member: The arm.
        result: Its result.
        path: Configurations on its way, of shape (n, dof), rad.
        rests: Configurations in which it rests between its tasks, of shape (k, dof), rad.
    """

    member: Member
    result: ArmResult
    path: Matrix
    rests: Matrix


class Diary(IdleObserver):
    """Configurations of the only arm: every so often, and where its leaves end."""

    def __init__(self, world: World) -> None:
        (self._body,) = world.arms.values()
        self.path = [self._body.q]
        self.rests = [self._body.q]

    def on_event(self, change: StatusChange) -> None:
        """Note where a leaf has ended."""
        if change.new == "SUCCESS":
            self.rests.append(self._body.q)

    def after_step(self, time: float) -> None:
        """Note where the arm is."""
        if time >= len(self.path) * _SAMPLE_S:
            self.path.append(self._body.q)


def crowd(seed: int, registry: Registry) -> list[Solo]:
    """The arms of a generated cell; the first ones drawn keep their places."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 7))
    side = float(rng.uniform(0.4, 1.3)) * np.sqrt(count)
    solos: list[Solo] = []
    for number in range(1, count + 1):
        for attempt in range(_TRIES):
            waits = attempt >= _TRIES // 2 or bool(rng.random() < 0.5)
            member = _drawn(f"arm{number}", side, waits, rng, solos)
            solo = None if member is None else _alone(member, solos, registry)
            if solo is not None and _fits(solo, solos):
                solos.append(solo)
                break
    return solos if len(solos) > 1 else crowd(seed + 1_000_000, registry)


def cannot_meet(first: Solo, second: Solo) -> bool:
    """Whether two arms keep `ROOM_M` apart, whatever the one does while the other does what."""
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


def _drawn(
    name: str, side: float, waits: bool, rng: np.random.Generator, others: Sequence[Solo]
) -> Member | None:
    """An arm somewhere in a square, with tasks; None where another one stands."""
    robot = str(rng.choice(MEASURED))
    x, y = rng.uniform(-side / 2, side / 2, 2).round(3).tolist()
    if any(np.hypot(x - one.member.xyz[0], y - one.member.xyz[1]) < _BASES_M for one in others):
        return None
    share = round(float(rng.uniform(0.3, 1.0)), 2)
    looks = robot == "panda" and not waits and rng.random() < 0.7
    yaw = round(float(rng.choice((0, 90, 180, -90)) if looks else rng.uniform(-180, 180)), 1)
    member = Member(name, robot, (x, y, 0.3), yaw, share, waits=waits)
    tasks, cube = looking(member) if looks else tasks_of(member, rng)
    return replace(member, tasks=tasks, cube=cube)


def _alone(member: Member, others: Sequence[Solo], registry: Registry) -> Solo | None:
    """What an arm does alone, None if it does not succeed; the others' cubes are there."""
    text = file_text([member], [member, *(other.member for other in others)])
    try:
        run = Run(load_tree_file(text, registry.kinds), registry)
    except DualArmError:
        return None
    with run:
        diary = Diary(run.world)
        run.watch(diary)
        result = run.finish().arms[member.name]
    if result.outcome != Outcome.SUCCESS:
        return None
    return Solo(member, result, np.array(diary.path), np.array(diary.rests))


def _fits(solo: Solo, others: Sequence[Solo]) -> bool:
    """Whether an arm leaves the others what they need, and they leave it what it needs."""
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
    """A world with two arms, where each stands."""
    members = [first.member, second.member]
    return World(load_tree_file(file_text(members, members), Registry.load().kinds))
