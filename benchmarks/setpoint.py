"""What a set-point costs, guard included, of one arm and of several that can never meet.

    python -m benchmarks.setpoint [--arms 8] [--rounds 7] [--reality lab]

UR5s and Pandas by turns stand 4 m apart and move, all at once: from posture to posture and back
along a trajectory, or after a stream of set-points from a servo whose target circles. A line has,
for one kind of motion, microseconds of CPU for all set-points of a period, one arm alone and all of
them, and the ratio: medians of rounds that alternate, a motion each.
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
_APART_M = 4.0
_POSTURES = {"ur5": "present", "panda": "look_out"}
_ROBOTS = tuple(_POSTURES)
_PLANE = np.array(((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
# m, rad/s
_RADIUS = 0.02
_SPIN = 3.0

Begin: TypeAlias = Callable[[World, str, JointController], None]
"""Begins a motion of an arm."""


def world_of(robots: tuple[str, ...], reality: str) -> World:
    """Arms in a row, each in the posture in which it shows something."""
    arms = {
        f"arm{i}": arm(robot, (0.0, _APART_M * i, 0.4), posture=_POSTURES[robot])
        for i, robot in enumerate(robots)
    }
    return World(file_of(arms, reality=reality), 1)


def swing(world: World, name: str, controller: JointController) -> None:
    """There and back along a trajectory."""
    here = controller.setpoint.q
    limits = world.robots[name].limits.scaled(0.5)
    there = here + 0.2 * np.cos(np.arange(len(here)))
    way = point_to_point(here, there, limits, controller.period)
    back = point_to_point(there, here, limits, controller.period)
    controller.follow(way.then(back))


def follow(world: World, name: str, controller: JointController) -> None:
    """A stream of set-points, from a servo whose target circles."""
    kinematics = Kinematics(world.robots[name], world.arms[name].base)
    limits = world.robots[name].limits
    start = controller.setpoint
    period = controller.period
    controller.stream(PlanarServo(kinematics, limits, period, start, _PLANE, _circling, 60.0))


def _circling(time: float, displacement: Vector) -> PlaneTarget:  # noqa: ARG001 # it is known
    sine = _RADIUS * math.sin(_SPIN * time)
    cosine = _RADIUS * math.cos(_SPIN * time)
    return PlaneTarget(
        np.array((sine, _RADIUS - cosine)),
        np.array((_SPIN * cosine, _SPIN * sine)),
        np.array((-(_SPIN**2) * sine, _SPIN**2 * cosine)),
    )


def cost(robots: tuple[str, ...], reality: str, begin: Begin) -> float:
    """Microseconds of CPU for the set-points of a period, on average over a motion."""
    world = world_of(robots, reality)
    reservations = Reservations()
    period = 2 * world.timestep
    arms = {name: JointController(world, name, period, reservations) for name in world.arms}
    for controller in arms.values():
        controller.update(world.time)
        controller.stop()  # the guard looks at the world's shapes once
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
        ratio = median(2.0 * every / (one + other) for one, other, every in rounds)
        each = [f"{median(row):.1f}" for row in zip(*rounds, strict=True)]
        print(
            f"{kind:10} {_ROBOTS[0]} {each[0]} us, {_ROBOTS[1]} {each[1]} us, "
            f"{len(many)} arms {each[2]} us: {ratio:.2f} x one; "
            f"fastest {min(row[0] for row in rounds):.1f} us",
            flush=True,
        )


if __name__ == "__main__":
    main()
