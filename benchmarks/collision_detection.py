"""Collision detection: detection delay, and false alarms in free motion.

    python -m benchmarks.collision_detection [--hits 20] [--free 60] [--robots ur5 panda ...]
                                             [--sets lab rough]

An arm moves with a tool speed of 0.1 to 0.5 m/s and runs into a fixed ball of 0.1 m that it does
not know of. The delay is the time from the first contact in the simulator to the fault of the
controller. Then ten robots share ``--free`` simulated seconds of free motion at half and at full
speed, in which every detection is a false alarm. A seed is one robot with its own deviations from
the model and its own motions. Goals: all collisions detected within 20 ms, no false alarm in an
hour in `rough`.
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
"""Range of the tool speed, m/s."""

REACTS: Final = {"stop": True}

_RADIUS = 0.05
# rad: random ranges of the start, the goal and the free motions
_AROUND = 0.3
_STEP = 0.5
_FREE = 0.4
_FREE_ROBOTS = 10


@dataclass(frozen=True)
class Collision:
    """One collision.

    Attributes:
        speed: Speed of the tool in m/s.
        felt_s: Detection delay, s; None if it was not detected.
        reason: Fault of the controller.
        by_link: Whether a contact switch of a link detected it, not the torques.
    """

    speed: float
    felt_s: float | None
    reason: str
    by_link: bool = False


class Bench:
    """One robot, alone in an empty world.

    Args:
        name: Robot.
        reality: Name of its reality.
        seed: Seed of the robot's deviations from the model and of its motions.
        kinds: Node types.
        ball: Position at which a ball can be spawned, in the world, m; None for no ball.
        collision: Reaction to a collision, as in a tree file.
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

    def follow(self, motion: Trajectory) -> Iterator[float]:
        """Follow a motion; yields the time of each period until it ends, also by a fault."""
        self.controller.follow(motion)
        while self.controller.motion is not None and self.controller.fault is None:
            self.controller.update(self.world.time)
            yield self.world.time
            for _ in range(round(PERIOD / self.world.timestep)):
                self.world.step()

    def is_clear(self, motion: Trajectory) -> bool:
        """Whether a motion is free of contacts in the current world."""
        checker = CollisionChecker(self.world, "arm1")
        return all(checker.contact(q) is None for q in motion.q[::10])

    def to(self, goal: Vector, share: float) -> Trajectory:
        """Motion to a configuration with a fraction of the limits."""
        limits = self.world.robots["arm1"].limits.scaled(share)
        return point_to_point(self.controller.setpoint.q, goal, limits, PERIOD)


SOON_S = 0.02 + 1e-9
"""Largest detection delay that meets the goal, s."""


def hit(
    name: str,
    reality: str,
    seed: int,
    kinds: Mapping[str, NodeType],
    collision: Mapping[str, float | bool] = REACTS,
) -> Collision:
    """Make one robot run into a ball."""
    robot = load_robot(name)
    rng = np.random.default_rng([seed, 3])
    kinematics = Kinematics(robot, Pose.identity())
    target_speed = float(rng.uniform(SLOWEST, FASTEST))
    while True:
        start = robot.postures["home"] + rng.uniform(-_AROUND, _AROUND, robot.dof)
        goal = start + rng.uniform(-_STEP, _STEP, robot.dof)
        share = 1.0
        speed = np.inf
        while speed > target_speed and share > 0.02:
            share *= min(1.0, max(0.5, target_speed / speed)) if np.isfinite(speed) else 1.0
            motion = point_to_point(start, goal, robot.limits.scaled(share), PERIOD)
            tool = np.array([kinematics.forward(q).position for q in motion.q])
            speeds = np.linalg.norm(np.diff(tool, axis=0), axis=1) / PERIOD
            speed = float(speeds.max()) * 0.999
        middle = int(np.flatnonzero(speeds > 0.9 * speeds.max()).mean())
        ahead = tool[middle + 1] - tool[middle]
        ball = tool[middle] + _RADIUS * ahead / np.linalg.norm(ahead)
        bench = Bench(name, reality, seed, kinds, ball, collision)
        for _ in bench.follow(bench.to(start, 0.5)):
            pass
        if bench.controller.fault is not None or not bench.is_clear(motion):
            continue  # it would collide with itself
        try:
            bench.world.spawn_object("ball")
        except OverlapError:
            continue
        found = _run_into(bench, motion, float(speeds[middle]))
        if found is not None:
            return found


def _run_into(bench: Bench, motion: Trajectory, speed: float) -> Collision | None:
    """Follow a motion until the collision is detected or 0.2 s old; None without a contact."""
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
            collide = (
                isinstance(fault, CollisionFailure | CollisionDetectedFailure) and began is not None
            )
            late = bench.world.time - began if began is not None else 0.0
            by_link = isinstance(fault, CollisionFailure)
            return Collision(speed, late if collide else None, str(fault), by_link)
        for _ in range(round(PERIOD / bench.world.timestep)):
            bench.world.step()
            if began is None and (bench.world.data.contact.geom == ball).any():
                began = bench.world.time
    return None if began is None else Collision(speed, None, "")


def free(
    name: str, reality: str, seed: int, seconds: float, kinds: Mapping[str, NodeType]
) -> list[str]:
    """False alarms in ``seconds`` simulated seconds of free motion, as sentences."""
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
        for _ in bench.follow(motion):
            pass
        if isinstance(bench.controller.fault, CollisionDetectedFailure):
            alarms.append(str(bench.controller.fault))
        while not bench.controller.at_rest and bench.controller.fault is not None:
            bench.controller.update(bench.world.time)
            for _ in range(round(PERIOD / bench.world.timestep)):
                bench.world.step()
    return alarms


def collide(name: str, reality: str, seed: int) -> dict[str, Any]:
    """Result of one collision."""
    found = hit(name, reality, seed, registry().kinds)
    late = found.felt_s
    outcome = "FAILURE" if late is None or late > SOON_S else "SUCCESS"
    return {"outcome": outcome, "code": "LATE" if late else "", "hit": asdict(found)}


def move_freely(name: str, reality: str, seed: int, seconds: float) -> dict[str, Any]:
    """False alarms in free motion."""
    alarms = free(name, reality, seed, seconds, registry().kinds)
    return {"outcome": "FAILURE" if alarms else "SUCCESS", "code": "", "alarms": alarms}


def main() -> None:
    """Print two lines per robot and reality."""
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
    """Make a robot collide and move freely, and print the detections."""
    settings = {"name": name, "reality": reality}
    seeds = range(arguments.first, arguments.first + arguments.hits)
    cases = [{**settings, "seed": seed} for seed in seeds]
    hits = [Collision(**found["hit"]) for _, found in campaign.run(collide, cases)]
    times = [one.felt_s for one in hits if one.felt_s is not None]
    soon = sum(late <= SOON_S for late in times)
    slowest = min((one.speed for one in hits), default=0.0)
    switched = sum(one.by_link for one in hits)
    late_ms = 1e3 * np.array(times or [np.nan])
    print(
        f"{name:6} {reality:6} {soon} of {len(hits)} detected within 20 ms, {len(times)} at all "
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
        runs = [{**settings, "seed": seed, "seconds": share} for seed in batch]
        for _, found in campaign.run(move_freely, runs):
            alarms += len(found["alarms"])
            for alarm in found["alarms"]:
                print(f"    {alarm}")
        print(f"{name:6} {reality:6} {alarms} false alarms in {arguments.free:g} s", flush=True)


if __name__ == "__main__":
    main()
