"""Sets fingers and their encoder for a test."""

from __future__ import annotations

from bt_dualarm.robots.gripper import FINGERS, gripper_names, load_gripper
from bt_dualarm.sim.kernel_arrays import SENSED_S, WIDTH
from bt_dualarm.sim.world import World

FINGERED = tuple(name for name in gripper_names() if load_gripper(name).fingers)


def opened(world: World, width: float, sensed: float | None = None) -> None:
    """Sets the fingers of ``arm1`` to an opening in m, and the encoder to the same or another."""
    for finger in FINGERS:
        world.data.joint(f"arm1/{finger}").qpos[0] = 0.5 * width
    hardware = world.grippers["arm1"]
    hardware._readings[SENSED_S] = -1.0
    world.restore(world.state())
    if sensed is not None:
        hardware._readings[WIDTH] = sensed
