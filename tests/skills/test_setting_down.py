"""Things are set down lightly: what the ground truly bears is held against it."""

from __future__ import annotations

import argparse

import numpy as np
import pytest

from benchmarks.placing import run, task

MOST_N = 15.0


@pytest.mark.parametrize(
    ("robot", "gripper", "reality", "seed"),
    [
        ("ur5", "robotiq_2f85", "lab", 3),
        ("panda", "panda_hand", "rough", 1),
        ("xarm7", "suction_cup", "rough", 2),
        ("ur3", "panda_hand", "lab", 4),
    ],
)
def test_the_ground_bears_little_more_than_the_thing(
    robot: str, gripper: str, reality: str, seed: int
) -> None:
    """The impact is under 15 N, and it stands within 2 mm and 1° of its goal."""
    file = task(argparse.Namespace(robot=robot, gripper=gripper, reality=reality), seed)
    leaf, ground = run(file)
    assert (leaf.skill, leaf.status) == ("place", "SUCCESS"), leaf.reason
    assert 0.5 < ground.pressed < MOST_N
    assert ground.after < 9.81 * file["objects"]["thing"]["mass"] + MOST_N
    assert float(leaf.metrics["impact_n"]) < MOST_N
    assert float(leaf.metrics["placed_error_m"]) < 2e-3
    assert float(leaf.metrics["placed_turned_rad"]) < np.radians(1.0)
