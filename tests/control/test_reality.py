"""On robots that deviate from their description, the tool follows its plan and comes to rest."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.path_reality import PERIOD, curves, measured, world_of
from bt_dualarm.control.controller import JointController
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.skill.registry import Registry
from tests.families import some

NODE_TYPES = Registry.load().kinds
LIMITS = {"ideal": (0.02, 0.06), "lab": (0.10, 0.30), "rough": (0.30, 1.00)}
"""Largest allowed RMS and maximum error, mm."""


def check_curves(robot: str, reality: str, load: str, seed: int) -> None:
    """Checks the errors along all curves, and at rest after them."""
    rms, worst = LIMITS[reality]
    for tool, motion, planned in curves(robot):
        world = world_of(robot, tool, reality, load, seed, NODE_TYPES)
        found = measured(world, motion, planned)
        assert found.fault == ""
        assert (found.rms <= rms, found.worst <= worst) == (True, True), found
        assert found.rest <= 0.3


@pytest.mark.parametrize("robot", ["ur5", "panda"])
@pytest.mark.parametrize("reality", LIMITS)
def test_curves_at_full_speed_are_within_the_limits(robot: str, reality: str) -> None:
    """The robot has sampled friction, masses, drives and encoders."""
    check_curves(robot, reality, "none", 3)


def test_arm_with_noisy_encoders_is_at_rest() -> None:
    """Single velocities from a neglected robot's encoders exceed the limit for rest."""
    robot = "panda"
    tool = next(curves(robot))[0]
    world = world_of(robot, tool, "rough", "none", 1, NODE_TYPES)
    controller = JointController(world, "arm1", PERIOD, Reservations())
    fast = resting = 0
    for step in range(500):
        controller.update(world.time)
        for _ in range(2):
            world.step()
        fast += bool(np.abs(world.hardware["arm1"].v).max() > 5e-3)
        resting += controller.at_rest and step >= 250
    assert fast > 100
    assert resting == 250


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "reality", "load"),
    some(
        [
            ("ur5", "lab", "known"),
            ("panda", "lab", "known"),
            ("ur5", "rough", "unknown"),
            ("panda", "rough", "unknown"),
        ],
        3,
    ),
)
def test_curves_with_a_kilogram_are_within_the_limits(robot: str, reality: str, load: str) -> None:
    for seed in (1, 2):
        check_curves(robot, reality, load, seed)
