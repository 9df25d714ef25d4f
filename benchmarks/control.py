"""Cost of a control update and of a physics step: python -m benchmarks.control.

Prints microseconds of the fastest of several rounds, for the two arms of the demo, one of them with
a load. Then prints the cost of the guard per set-point while an arm moves, averaged over a motion
and over a stream, and its share of the update: with the other arm far away, at 0.3 m as in the
demo, and near.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from bt_dualarm.control.controller import JointController
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.path_timing import point_to_point
from bt_dualarm.trajectory.set_points import SetPoint
from tests.sim.worlds import arm, box, file_of

CALLS = 500
ROUNDS = 30


def microseconds(action: Callable[[], object]) -> float:
    """Time of one call in the fastest round, which other processes disturb least."""
    rounds = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        for _ in range(CALLS):
            action()
        rounds.append((time.perf_counter() - start) / CALLS * 1e6)
    return min(rounds)


def cost_of_guard(x: float, kind: str) -> tuple[float, float]:
    """Microseconds per set-point of the guard and of the whole update.

    Args:
        x: Position of the other arm's base along x, m.
        kind: ``motion`` or ``stream``.
    """
    arms = {"arm1": arm("ur5", posture="present"), "arm2": arm("panda", (x, 0.0, 0.3), 180.0)}
    world = World(file_of(arms))
    period = 2 * world.timestep
    controller = JointController(world, "arm1", period, Reservations())
    start = controller.setpoint.q
    limits = world.robots["arm1"].limits.scaled(0.3)
    motion = point_to_point(
        start, start + np.array((0.5, -0.1, 0.1, 0.0, 0.0, 0.5)), limits, period
    )
    controller.stop()  # the guard reads the world's shapes once
    if kind == "motion":
        controller.follow(motion)
    else:
        controller.stream(lambda time: SetPoint(*motion.at(time)))
    spent = {"guard": 0.0, "update": 0.0}
    guard = controller._guard
    for method in ("look", "permits"):
        setattr(guard, method, timed(getattr(guard, method), spent, "guard"))
    update = timed(controller.update, spent, "update")
    count = len(motion)
    for _ in range(count):
        update(world.time)
        world.step()
        world.step()
    return spent["guard"] / count * 1e6, spent["update"] / count * 1e6


def timed(action: Callable[..., Any], spent: dict[str, float], name: str) -> Callable[..., Any]:
    """The same action, which adds its duration in s to ``spent``."""

    def run(*args: object) -> object:
        start = time.perf_counter()
        result = action(*args)
        spent[name] += time.perf_counter() - start
        return result

    return run


def main() -> None:
    """Print a line for each part."""
    cube = box((0.487, 0.109, 0.79))
    world = World(
        file_of({"arm1": arm("ur5"), "arm2": arm("panda", (1.6, 0.0, 0.28))}, {"cube": cube})
    )
    world.attach("arm1", "cube")
    reservations = Reservations()
    controllers = {
        name: JointController(world, name, world.timestep, reservations) for name in world.arms
    }

    def everything() -> None:
        for controller in controllers.values():
            controller.update(world.time)
        world.step()

    everything()
    model = world.model
    data = world.data
    print(f"mj_step                  {microseconds(lambda: mujoco.mj_step(model, data)):6.1f} µs")
    for name, controller in controllers.items():
        limiter = controller._limiter
        rest = controller.setpoint
        hold = SetPoint(rest.q, rest.v, rest.a)
        update = microseconds(lambda c=controller: c.update(world.time))  # type: ignore[misc]
        print(f"{name} update, holding     {update:6.1f} µs")
        gate = microseconds(lambda g=limiter, h=hold: g.send(h))  # type: ignore[misc]
        print(f"  of it the gate         {gate:6.1f} µs")
        dynamics = controller._torque
        torque = microseconds(lambda d=dynamics, r=hold: d.command(r, 0.0))  # type: ignore[misc]
        print(f"  of it the torques      {torque:6.1f} µs")
    step = microseconds(world.step)
    whole = microseconds(everything)
    print(f"World.step               {step:6.1f} µs")
    print(f"both updates and a step  {whole:6.1f} µs")
    for name, x in (("3 m away", 4.0), ("0.3 m away", 1.3), ("0.1 m away", 1.08)):
        for kind in ("motion", "stream"):
            guard, update = min(cost_of_guard(x, kind) for _ in range(5))
            share = f"{100 * guard / update:3.0f} % of the update"
            print(f"guard, {kind}, {name:10}  {guard:6.1f} µs per set-point, {share}")


if __name__ == "__main__":
    main()
