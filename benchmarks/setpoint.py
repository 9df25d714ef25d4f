"""CPU time of a set-point, guard included, for one arm and for several that cannot meet.

    python -m benchmarks.setpoint [--arms 8] [--rounds 7] [--reality lab]

UR5s and Pandas stand 4 m apart, alternately, and all move at once: between two postures along a
trajectory, or with a stream of set-points from a servo with a circling target. For each kind of
motion, prints the CPU microseconds of all set-points of a period, for one arm and for all of them,
and the ratio: medians over alternating rounds of one motion each.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from statistics import median
from typing import TypeAlias

import numpy as np

from bt_dualarm.control.controller import JointController
from bt_dualarm.control.planar_servo import PlanarServo, PlaneTarget
from bt_dualarm.core.pose import Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.path_timing import point_to_point
from tests.sim.worlds import arm, file_of

_SECONDS = 1.5
_DISTANCE_M = 4.0
_POSTURES = {"ur5": "present", "panda": "look_out"}
_ROBOTS = tuple(_POSTURES)
_PLANE = np.array(((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
# m, rad/s
_RADIUS = 0.02
_SPIN = 3.0

Begin: TypeAlias = Callable[[World, str, JointController], None]
"""Begins a motion of an arm."""


def world_of(robots: tuple[str, ...], reality: str) -> World:
    """A world with arms in a row, each in its working posture."""
    arms = {
        f"arm{i}": arm(robot, (0.0, _DISTANCE_M * i, 0.4), posture=_POSTURES[robot])
        for i, robot in enumerate(robots)
    }
    return World(file_of(arms, reality=reality), 1)


def swing(world: World, name: str, controller: JointController) -> None:
    """Move back and forth along a trajectory."""
    here = controller.setpoint.q
    limits = world.robots[name].limits.scaled(0.5)
    there = here + 0.2 * np.cos(np.arange(len(here)))
    forth = point_to_point(here, there, limits, controller.period)
    back = point_to_point(there, here, limits, controller.period)
    controller.follow(forth.then(back))


def follow(world: World, name: str, controller: JointController) -> None:
    """Follow a stream of set-points from a servo with a circling target."""
    kinematics = Kinematics(world.robots[name], world.arms[name].base)
    limits = world.robots[name].limits
    start = controller.setpoint
    period = controller.period
    controller.stream(
        PlanarServo(kinematics, limits, period, start, _PLANE, _circling_target, 60.0)
    )


def _circling_target(time: float, displacement: Vector) -> PlaneTarget:  # noqa: ARG001 - given
    sine = _RADIUS * math.sin(_SPIN * time)
    cosine = _RADIUS * math.cos(_SPIN * time)
    return PlaneTarget(
        np.array((sine, _RADIUS - cosine)),
        np.array((_SPIN * cosine, _SPIN * sine)),
        np.array((-(_SPIN**2) * sine, _SPIN**2 * cosine)),
    )


def cost(robots: tuple[str, ...], reality: str, begin: Begin) -> float:
    """Mean CPU time of the set-points of a period over a motion, µs."""
    world = world_of(robots, reality)
    reservations = Reservations()
    period = 2 * world.timestep
    arms = {name: JointController(world, name, period, reservations) for name in world.arms}
    for controller in arms.values():
        controller.update(world.time)
        controller.stop()  # the guard reads the world's shapes once
    for name, controller in arms.items():
        begin(world, name, controller)
    spent = 0.0
    count = round(_SECONDS / period)
    for _ in range(count):
        world.step()
        world.step()
        now = world.time
        began = time.thread_time()
        for controller in arms.values():
            controller.update(now)
        spent += time.thread_time() - began
    faults = [controller.fault for controller in arms.values() if controller.fault is not None]
    if faults:
        raise faults[0]
    return 1e6 * spent / count


def main() -> None:
    """Print a line for each kind of motion."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--arms", type=int, default=8)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--reality", default="lab")
    arguments = parser.parse_args()
    many = tuple(_ROBOTS[i % len(_ROBOTS)] for i in range(arguments.arms))
    kinds: dict[str, Begin] = {"trajectory": swing, "stream": follow}
    for kind, begin in kinds.items():
        rounds = []
        for _ in range(arguments.rounds):
            alone = [cost((robot,), arguments.reality, begin) for robot in _ROBOTS]
            rounds.append((*alone, cost(many, arguments.reality, begin)))
        ratio = median(2.0 * all_arms / (one + other) for one, other, all_arms in rounds)
        each = [f"{median(row):.1f}" for row in zip(*rounds, strict=True)]
        print(
            f"{kind:10} {_ROBOTS[0]} {each[0]} us, {_ROBOTS[1]} {each[1]} us, "
            f"{len(many)} arms {each[2]} us: {ratio:.2f} x one; "
            f"fastest {min(row[0] for row in rounds):.1f} us",
            flush=True,
        )


if __name__ == "__main__":
    main()
