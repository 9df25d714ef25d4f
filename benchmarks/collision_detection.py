"""Hits: how soon an arm feels them, and how often it feels one where nothing is.

    python -m benchmarks.collision_detection [--hits 20] [--free 60] [--robots ur5 panda ...]
                                             [--sets lab rough]

An arm moves as fast as its tool is to be, 0.1 to 0.5 m/s, and a fixed ball of 0.1 m is in its way
that nobody has told it of. Counted is from the first contact in the simulator to the fault of its
controller. Then ten robots of the batch share so many simulated seconds of motions at half and at
full speed where nothing is, and every hit that one feels is a false alarm. A seed is one robot of
the batch and other motions.
Asked for: all within 20 ms, no false alarm in an hour in `rough`.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from benchmarks.campaign import Campaign, add_options, registry
from benchmarks.measured_robots import MEASURED
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.control.controller import JointController
from bt_dualarm.core.errors import CollisionDetectedFailure, CollisionFailure, OverlapError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.robot_description import load_robot, robot_names
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.sim.world import World
from bt_dualarm.spec.node_types import NodeType
from bt_dualarm.trajectory.path_timing import point_to_point
from bt_dualarm.trajectory.trajectory import Trajectory

PERIOD = 0.004
SLOWEST = 0.1
FASTEST = 0.5
"""Speeds of the tool in m/s."""

REACTS: Final = {"stop": True}

_RADIUS = 0.05
# rad: the postures of the motions
_AROUND = 0.3
_STEP = 0.5
_FREE = 0.4
_FREE_ROBOTS = 10


@dataclass(frozen=True)
class Hit:
    """One hit.

    Attributes:
        speed: Speed of the tool in m/s.
        felt_s: Seconds until the arm stopped for it; None if it did not.
        reason: Why it stopped.
        by_link: Whether a switch on a link told it, not the torques.
    """

    speed: float
    felt_s: float | None
    reason: str
    by_link: bool = False


class Bench:
    """One robot of the batch, alone in an empty world.

    Args:
        name: Robot.
        reality: Name of its reality.
        seed: Seed of what the robot is and of its motions.
        kinds: Skills and words.
        ball: Where a ball may be put, in the world; None for nowhere.
        collision: What the arm does when it is hit, as in the file.
    """

    def __init__(
        self,
        name: str,
        reality: str,
        seed: int,
        kinds: Mapping[str, NodeType],
        ball: Vector | None = None,
        collision: Mapping[str, float | bool] = REACTS,
    ) -> None:
        tree = {
            "bt_dualarm": 1,
            "name": "hits",
            "world": {"scene": "empty", "seed": seed, "reality": reality},
            "arms": {"arm1": {"robot": name, "collision": dict(collision), "tree": "succeed"}},
        }
        if ball is not None:
            obj = {"shape": "sphere", "size": [_RADIUS], "mass": 5.0, "fixed": True}
            tree["objects"] = {"ball": {**obj, "spawned": False, "pose": {"xyz": ball.tolist()}}}
        self.world = World(load_tree_file(tree, kinds), seed)
        self.controller = JointController(self.world, "arm1", PERIOD, Reservations())

    def moved(self, motion: Trajectory) -> Iterator[float]:
        """Follow a motion; yields the time of each period until it ends or a fault does it."""
        self.controller.follow(motion)
        while self.controller.motion is not None and self.controller.fault is None:
            self.controller.update(self.world.time)
            yield self.world.time
            for _ in range(round(PERIOD / self.world.timestep)):
                self.world.step()

    def is_clear(self, motion: Trajectory) -> bool:
        """Whether a motion touches nothing that is there now."""
        checker = CollisionChecker(self.world, "arm1")
        return all(checker.contact(q) is None for q in motion.q[::10])

    def to(self, goal: Vector, share: float) -> Trajectory:
        """The motion to a configuration at a share of the limits."""
        limits = self.world.robots["arm1"].limits.scaled(share)
        return point_to_point(self.controller.setpoint.q, goal, limits, PERIOD)


SOON_S = 0.02 + 1e-9
"""Time after which a hit is felt too late, s."""


def hit(
    name: str,
    reality: str,
    seed: int,
    kinds: Mapping[str, NodeType],
    collision: Mapping[str, float | bool] = REACTS,
) -> Hit:
    """Let one robot of the batch run into a ball."""
    robot = load_robot(name)
    rng = np.random.default_rng([seed, 3])
    kinematics = Kinematics(robot, Pose.identity())
    wanted = float(rng.uniform(SLOWEST, FASTEST))
    while True:
        start = robot.postures["home"] + rng.uniform(-_AROUND, _AROUND, robot.dof)
        goal = start + rng.uniform(-_STEP, _STEP, robot.dof)
        share = 1.0
        speed = np.inf
        while speed > wanted and share > 0.02:
            share *= min(1.0, max(0.5, wanted / speed)) if np.isfinite(speed) else 1.0
            motion = point_to_point(start, goal, robot.limits.scaled(share), PERIOD)
            tool = np.array([kinematics.forward(q).position for q in motion.q])
            speeds = np.linalg.norm(np.diff(tool, axis=0), axis=1) / PERIOD
            speed = float(speeds.max()) * 0.999
        middle = int(np.flatnonzero(speeds > 0.9 * speeds.max()).mean())
        ahead = tool[middle + 1] - tool[middle]
        ball = tool[middle] + _RADIUS * ahead / np.linalg.norm(ahead)
        bench = Bench(name, reality, seed, kinds, ball, collision)
        for _ in bench.moved(bench.to(start, 0.5)):
            pass
        if bench.controller.fault is not None or not bench.is_clear(motion):
            continue  # it would meet itself
        try:
            bench.world.spawn_object("ball")
        except OverlapError:
            continue
        found = _run_into(bench, motion, float(speeds[middle]))
        if found is not None:
            return found


def _run_into(bench: Bench, motion: Trajectory, speed: float) -> Hit | None:
    """Follow a motion until the hit is felt or over; None where nothing was touched."""
    began = None
    ball = bench.world.object_geom("ball")
    for _ in range(round(0.3 / PERIOD)):  # at rest before it begins
        bench.controller.update(bench.world.time)
        for _ in range(round(PERIOD / bench.world.timestep)):
            bench.world.step()
    bench.controller.follow(motion)
    while bench.controller.motion is not None:
        bench.controller.update(bench.world.time)
        fault = bench.controller.fault
        if fault is not None or (began is not None and bench.world.time - began > 0.2):
            felt = (
                isinstance(fault, CollisionFailure | CollisionDetectedFailure) and began is not None
            )
            late = bench.world.time - began if began is not None else 0.0
            by_link = isinstance(fault, CollisionFailure)
            return Hit(speed, late if felt else None, str(fault), by_link)
        for _ in range(round(PERIOD / bench.world.timestep)):
            bench.world.step()
            if began is None and (bench.world.data.contact.geom == ball).any():
                began = bench.world.time
    return None if began is None else Hit(speed, None, "")


def free(
    name: str, reality: str, seed: int, seconds: float, kinds: Mapping[str, NodeType]
) -> list[str]:
    """Hits that an arm feels where nothing is, in so many simulated seconds, as sentences."""
    bench = Bench(name, reality, seed, kinds)
    robot = load_robot(name)
    rng = np.random.default_rng([seed, 4])
    alarms = []
    limits = robot.limits
    while bench.world.time < seconds:
        goal = robot.postures["home"] + rng.uniform(-_FREE, _FREE, robot.dof)
        goal = np.clip(goal, limits.lower, limits.upper)
        motion = bench.to(goal, float(rng.choice((0.5, 1.0))))
        if not bench.is_clear(motion):
            continue
        for _ in bench.moved(motion):
            pass
        if isinstance(bench.controller.fault, CollisionDetectedFailure):
            alarms.append(str(bench.controller.fault))
        while not bench.controller.at_rest and bench.controller.fault is not None:
            bench.controller.update(bench.world.time)
            for _ in range(round(PERIOD / bench.world.timestep)):
                bench.world.step()
    return alarms


def felt(name: str, reality: str, seed: int) -> dict[str, Any]:
    """What came of a hit."""
    found = hit(name, reality, seed, registry().kinds)
    late = found.felt_s
    outcome = "FAILURE" if late is None or late > SOON_S else "SUCCESS"
    return {"outcome": outcome, "code": "LATE" if late else "", "hit": asdict(found)}


def alarmed(name: str, reality: str, seed: int, seconds: float) -> dict[str, Any]:
    """False alarms of a free motion."""
    alarms = free(name, reality, seed, seconds, registry().kinds)
    return {"outcome": "FAILURE" if alarms else "SUCCESS", "code": "", "alarms": alarms}


def main() -> None:
    """Print two lines a robot and reality."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--robots", nargs="+", default=MEASURED, choices=robot_names())
    parser.add_argument("--sets", nargs="+", default=["lab", "rough"])
    parser.add_argument("--hits", type=int, default=20)
    parser.add_argument("--free", type=float, default=60.0)
    parser.add_argument("--first", type=int, default=0)
    add_options(parser)
    arguments = parser.parse_args()
    with Campaign(arguments) as campaign:
        for name, reality in itertools.product(arguments.robots, arguments.sets):
            report(name, reality, arguments, campaign)


def report(name: str, reality: str, arguments: argparse.Namespace, campaign: Campaign) -> None:
    """Let a robot run into things and move freely, and print what it felt."""
    words = {"name": name, "reality": reality}
    seeds = range(arguments.first, arguments.first + arguments.hits)
    cases = [{**words, "seed": seed} for seed in seeds]
    hits = [Hit(**found["hit"]) for _, found in campaign.run(felt, cases)]
    times = [one.felt_s for one in hits if one.felt_s is not None]
    soon = sum(late <= SOON_S for late in times)
    slowest = min((one.speed for one in hits), default=0.0)
    switched = sum(one.by_link for one in hits)
    late_ms = 1e3 * np.array(times or [np.nan])
    print(
        f"{name:6} {reality:6} {soon} of {len(hits)} felt within 20 ms, {len(times)} at all "
        f"({switched} by a switch on a link), median {np.median(late_ms):.0f} ms, "
        f"at most {late_ms.max():.0f} ms; {slowest:.2f} m/s and faster",
        flush=True,
    )
    missed = [one for one in hits if one.felt_s is None or one.felt_s > SOON_S]
    for one in missed[:4]:
        print(f"    {one}")
    if arguments.free:
        batch = range(arguments.first, arguments.first + _FREE_ROBOTS)
        share = arguments.free / _FREE_ROBOTS
        alarms = 0
        runs = [{**words, "seed": seed, "seconds": share} for seed in batch]
        for _, found in campaign.run(alarmed, runs):
            alarms += len(found["alarms"])
            for alarm in found["alarms"]:
                print(f"    {alarm}")
        print(f"{name:6} {reality:6} {alarms} false alarms in {arguments.free:g} s", flush=True)


if __name__ == "__main__":
    main()
