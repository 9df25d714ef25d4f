"""A camera that turns to face its target, in space."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bt_dualarm.core.pose import Vector
from tests.plays import Stage
from tests.skills.scenarios import Tree
from tests.skills.test_track import carried, scenario

SIDE = 0.05
BALL = {
    "ball": {
        "shape": "sphere",
        "size": [SIDE / math.sqrt(math.pi)],
        "mass": 0.1,
        "color": "yellow",
        "fixed": True,
    }
}
FACING: Tree = {
    "track": {
        "plane": "free",
        "orientation": "facing",
        "target_size": SIDE,
        "duration": 6.0,
        "reach": 1.0,
        "score": "cube",
    }
}


def around(time: float) -> Vector:
    """By 30° around the vertical through the origin, in 4 s, after a second at rest."""
    share = min(1.0, max(0.0, (time - 1.0) / 4.0))
    angle = math.radians(30.0) * share**3 * (10 - 15 * share + 6 * share**2)
    c, s = math.cos(angle), math.sin(angle)
    return np.array((0.68 * c - 0.11 * s - 0.68, 0.68 * s + 0.11 * c - 0.11, 0.0))


def test_a_facing_camera_turns_with_a_target_around_the_arm(stage: Stage) -> None:
    """It aims within half a degree, and ends on the other side of the arm."""
    where = scenario(
        {"fps": 60, "latency": 0.02}, cube=BALL["ball"] | {"pose": {"xyz": [0.68, 0.11, 0.70]}}
    )
    play = stage.play(where.file(FACING))
    play.watchers.append(carried(around))
    play.run()
    leaf = play.leaf("track")
    print(leaf.status, leaf.code, leaf.reason, leaf.metrics)
    assert leaf.status == "SUCCESS", leaf.reason
