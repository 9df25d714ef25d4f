"""Short ways to declare worlds in Python."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bt_dualarm.robots.robot_description import robot_names
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ArmSpec, ObjectSpec, TreeFile, WorldSpec
from bt_dualarm.spec.node_types import NodeSpec
from bt_dualarm.spec.values import PoseSpec

WORLD = Path(__file__).parents[1]
"""The folder below which the pages of further robots lie."""

PAGES = tuple(f"robots/{path.name}" for path in sorted((WORLD / "robots").glob("*.yaml")))
"""Catalog pages beside this file, of arms that no code mentions."""

ROBOTS = (*robot_names(), *PAGES)
"""Every arm: those of the catalog and those beside this file."""

WIDE = ("panda", "ur10", "ur3", "ur5", "xarm7")
"""Arms on their own that go everywhere before them with the tool pointing down: a test whose
motions need that takes these, and so does one that would take too long over all of them."""

Place = tuple[float, float, float]


def arm(robot: str, xyz: Place = (0.0, 0.0, 0.4), yaw: float = 0.0, **fields: Any) -> ArmSpec:
    """An arm whose base stands at ``xyz`` (m), turned by ``yaw`` (degrees)."""
    tree = NodeSpec(kind="succeed", name="succeed", ports={})  # the world never looks at it
    return ArmSpec(robot=robot, base=PoseSpec(xyz=xyz, rpy=(0.0, 0.0, yaw)), tree=tree, **fields)


def box(xyz: Place, edge: float = 0.05, **fields: Any) -> ObjectSpec:
    """A cube of 100 g unless said otherwise."""
    fields = {"mass": 0.1} | fields
    return ObjectSpec(shape="box", size=(edge, edge, edge), pose=PoseSpec(xyz=xyz), **fields)


def file_of(
    arms: dict[str, ArmSpec], objects: dict[str, ObjectSpec] | None = None, **world: Any
) -> TreeFile:
    """A tree file in the folder of these tests."""
    return TreeFile(
        name="test",
        world=WorldSpec(**({"scene": "empty"} | world)),
        objects=objects or {},
        arms=arms,
        path=WORLD / "test.yaml",
    )


def world_with(robot: str, **fields: Any) -> World:
    """A world with this robot as ``arm1``, its base 0.4 m above the ground."""
    return World(file_of({"arm1": arm(robot, **fields)}))
