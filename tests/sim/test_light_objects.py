"""Contacts of light objects are as stiff as those of heavier ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt

PRESSED_N = 20.0
"""Approximate force of an arm that presses its held object on a support, before detection, N."""


def _cube_on_plate(mass: float) -> dict[str, Any]:
    cube = {"shape": "box", "size": [0.032, 0.032, 0.032], "mass": mass}
    plate = {"shape": "box", "size": [0.2, 0.2, 0.02], "fixed": True}
    return {
        "bt_dualarm": 1,
        "name": "pressed",
        "world": {"scene": "empty", "time_limit": 2},
        "objects": {
            "plate": plate | {"pose": {"xyz": [0.5, 0.0, 0.01]}},
            "cube": cube | {"pose": {"xyz": [0.5, 0.0, 0.036]}},
        },
        "arms": {"arm1": {"robot": "ur5", "gripper": "robotiq_2f85", "tree": {"wait": 2}}},
    }


@pytest.mark.parametrize("mass", [0.0016, 0.005, 0.01, 0.3])
def test_pressed_object_hardly_penetrates_its_support(mass: float) -> None:
    """A cube of 1.6 g penetrated by 2.5 mm: fingers slid along it, and no arm felt the support."""
    with bt.open(_cube_on_plate(mass)) as run:
        run.step(0.5)
        rests = run.world.object_pose("cube").position
        assert rests[2] == pytest.approx(0.036, abs=2e-4)
        body = run.world.model.body("cube").id
        run.world.data.xfrc_applied[body, 2] = -PRESSED_N
        run.step(0.5)
        pressed = run.world.object_pose("cube")
        assert rests[2] - pressed.position[2] < 6.5e-4  # 0.57 mm with 10 g, by stock contacts
        assert np.linalg.norm((pressed.position - rests)[:2]) < 1e-3
        run.world.data.xfrc_applied[body, 2] = 0.0
        run.step(0.5)
        assert run.world.object_pose("cube").position == pytest.approx(rests, abs=5e-4)
        assert float(np.linalg.norm(run.world.object_velocity("cube")[3:])) < 1e-3
