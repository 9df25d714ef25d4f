"""Worlds declared in Python, for tests below the layer that reads YAML."""

from __future__ import annotations

import pytest

from bt_dualarm.spec.document import CameraSpec, ObjectSpec, TreeFile
from bt_dualarm.spec.values import PoseSpec
from tests.sim.worlds import arm, box, file_of


@pytest.fixture
def file() -> TreeFile:
    """A UR5 and a Panda (not spawned yet), a cube and a ball (not spawned yet)."""
    ball = ObjectSpec(
        shape="sphere", size=(0.03,), mass=0.1, pose=PoseSpec(xyz=(0.5, 0.6, 0.2)), spawned=False
    )
    panda = arm("panda", (1.6, 0.0, 0.0), 180.0, camera=CameraSpec(), spawned=False)
    return file_of(
        {"arm1": arm("ur5"), "arm2": panda}, {"cube": box((0.5, 0.4, 0.025)), "ball": ball}
    )
