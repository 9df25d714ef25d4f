"""Worlds declared in Python, for tests below the layer that reads YAML."""

from __future__ import annotations

from typing import Any

import pytest

from bt_dualarm.spec.document import ArmSpec, CameraSpec, ObjectSpec, TreeFile, WorldSpec
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.values import PoseSpec


def idle_tree() -> NodeSpec:
    """Any tree: the world never looks at it."""
    return NodeSpec(kind="succeed", name="succeed", ports={})


@pytest.fixture
def file() -> TreeFile:
    """A UR5 and a Panda (not there yet), a cube and a ball (not there yet)."""

    def thing(**fields: Any) -> ObjectSpec:
        return ObjectSpec(mass=0.1, **fields)

    return TreeFile(
        name="test",
        world=WorldSpec(scene="empty"),
        objects={
            "cube": thing(
                shape="box", size=(0.05, 0.05, 0.05), pose=PoseSpec(xyz=(0.5, 0.4, 0.025))
            ),
            "ball": thing(
                shape="sphere", size=(0.03,), pose=PoseSpec(xyz=(0.5, 0.6, 0.2)), spawned=False
            ),
        },
        arms={
            "arm1": ArmSpec(robot="ur5", base=PoseSpec(xyz=(0.0, 0.0, 0.4)), tree=idle_tree()),
            "arm2": ArmSpec(
                robot="panda",
                base=PoseSpec(xyz=(1.6, 0.0, 0.0), rpy=(0.0, 0.0, 180.0)),
                camera=CameraSpec(),
                spawned=False,
                tree=idle_tree(),
            ),
        },
    )
