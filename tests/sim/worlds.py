"""Helpers to declare worlds in Python."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bt_dualarm.robots.robot_description import robot_names
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ArmSpec, ObjectSpec, TreeFile, WorldSpec
from bt_dualarm.spec.node_types import NodeSpec
from bt_dualarm.spec.values import PoseSpec

WORLD = Path(__file__).parents[1]
"""Folder that contains the descriptions of further robots."""

PAGES = tuple(f"robots/{path.name}" for path in sorted((WORLD / "robots").glob("*.yaml")))
"""Robot descriptions of the tests, which no code mentions by name."""

ROBOTS = (*robot_names(), *PAGES)
"""Every arm of the catalog and of the tests."""

WIDE = ("panda", "ur10", "ur3", "ur5", "xarm7")
"""Single arms that reach everywhere in front of them with the tool pointing down, for tests whose
motions need that, and for tests that would take too long with all robots."""

Place = tuple[float, float, float]


def arm(robot: str, xyz: Place = (0.0, 0.0, 0.4), yaw: float = 0.0, **fields: Any) -> ArmSpec:
    """An arm with its base at ``xyz`` (m), rotated by ``yaw`` (degrees)."""
    tree = NodeSpec(kind="succeed", name="succeed", ports={})  # not used by the world
    return ArmSpec(robot=robot, base=PoseSpec(xyz=xyz, rpy=(0.0, 0.0, yaw)), tree=tree, **fields)


def box(xyz: Place, edge: float = 0.05, **fields: Any) -> ObjectSpec:
    """A cube, by default of 100 g."""
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
