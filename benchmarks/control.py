"""What a control update and a physics step cost: python benchmarks/control.py.

Two arms, the main job's, one of them with a load; microseconds, the fastest of several rounds.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import mujoco

from bt_dualarm.motion.controller import JointController
from bt_dualarm.motion.limiter import SetPoint
from bt_dualarm.world.world import World
from tests.world.worlds import arm, box, file_of

CALLS = 500
ROUNDS = 30


def microseconds(action: Callable[[], object]) -> float:
    """What one call costs in the fastest round: the others had the machine to share."""
    rounds = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        for _ in range(CALLS):
            action()
        rounds.append((time.perf_counter() - start) / CALLS * 1e6)
    return min(rounds)


def main() -> None:
    """Print a line for each part."""
    cube = box((0.487, 0.109, 0.79))
    world = World(
        file_of({"arm1": arm("ur5"), "arm2": arm("panda", (1.6, 0.0, 0.28))}, {"cube": cube})
    )
    world.attach("arm1", "cube")
    controllers = {name: JointController(world, name, world.timestep) for name in world.arms}

    def everything() -> None:
        for controller in controllers.values():
            controller.update(world.time)
        world.step()

    everything()
    model, data = world.model, world.data
    print(f"mj_step                  {microseconds(lambda: mujoco.mj_step(model, data)):6.1f} µs")
    for name, controller in controllers.items():
        limiter, rest = controller._limiter, controller.setpoint
        hold = SetPoint(rest.q, rest.v, rest.a)
        update = microseconds(lambda c=controller: c.update(world.time))  # type: ignore[misc]
        print(f"{name} update, holding     {update:6.1f} µs")
        gate = microseconds(lambda g=limiter, h=hold: g.send(h))  # type: ignore[misc]
        print(f"  of it the gate         {gate:6.1f} µs")
        torque = microseconds(lambda c=controller, a=rest.a: c._torque(a))  # type: ignore[misc]
        print(f"  of it the torques      {torque:6.1f} µs")
    step, whole = microseconds(world.step), microseconds(everything)
    print(f"World.step               {step:6.1f} µs")
    print(f"both updates and a step  {whole:6.1f} µs")


if __name__ == "__main__":
    main()
