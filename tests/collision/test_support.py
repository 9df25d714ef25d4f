"""Prediction from the shapes below whether an object would stand, tip, slide or roll."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.collision.support import Support, bearing_ahead, support_below
from bt_dualarm.core.pose import Pose
from bt_dualarm.sim.world import World

ABOVE = 0.008
BELOW = 0.015
EDGE_Y = -0.25
"""Edge of the table, whose top is at 0.40 m."""


def fixed(shape: str, size: list[float], xyz: list[float], *rpy: float) -> dict[str, Any]:
    """A fixed object that supports others."""
    pose = {"xyz": xyz, "rpy": list(rpy or (0, 0, 0))}
    return {"shape": shape, "size": size, "mass": 5, "fixed": True, "pose": pose}


def loose(shape: str, size: list[float], y: float) -> dict[str, Any]:
    """An object to place; it lies on the floor, out of the way."""
    return {"shape": shape, "size": size, "mass": 0.1, "pose": {"xyz": [-0.5, y, 0.06]}}


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    """A table with objects to place and objects to place them on."""
    objects = {
        "cube": loose("box", [0.05, 0.05, 0.05], 0.3),
        "ball": loose("sphere", [0.025], 0.4),
        "can": loose("cylinder", [0.025, 0.10], 0.5),
        "pill": loose("capsule", [0.02, 0.06], 0.6),
        "rod": loose("box", [0.2, 0.004, 0.004], 0.8),
        "tube": {"shape": "tube", "size": [0.002, 0.2], "wall": 0.0005}
        | {"mass": 0.1, "pose": {"xyz": [-0.5, 0.9, 0.3]}},
        "offset": {"shape": "compound", "mass": 0.1, "pose": {"xyz": [-0.5, 1.1, 0.06]}}
        | {"parts": {"block": {"shape": "box", "size": [0.05] * 3, "pose": {"xyz": [0, 0.1, 0]}}}},
        "globe": fixed("sphere", [0.03], [0.20, -0.5, 0.43]),
        "ramp": fixed("box", [0.2, 0.2, 0.02], [0.5, -0.4, 0.45], 0, 20, 0),
        "wall": fixed("box", [0.01, 0.1, 0.1], [0.30, -0.6, 0.45]),
        "knife": fixed("box", [0.004, 0.1, 0.1], [0.40, -0.6, 0.45]),
    }
    arm = {"robot": "ur5", "base": {"xyz": [0, 0, 0.4]}, "tree": {"wait": {"seconds": 0.1}}}
    file = {"bt_dualarm": 1, "name": "support", "world": {"scene": "table"}, "objects": objects}
    with bt.open(file | {"arms": {"arm1": arm}}) as run:
        yield run.world


def at(world: World, obj: str, x: float, y: float, z: float, *rpy: float) -> Support | None:
    """The support of an object at a pose in m and degrees."""
    pose = Pose.from_rpy((x, y, z), tuple(np.radians(rpy or (0, 0, 0)).tolist()))
    return support_below(world, obj, pose, ABOVE, BELOW)


@pytest.mark.parametrize("dz", [-0.007, 0.0, 0.014])
def test_cube_stands_on_a_table_whatever_the_intended_height(world: World, dz: float) -> None:
    found = at(world, "cube", 0.35, -0.45, 0.425 + dz)
    assert found is not None
    assert found.below == pytest.approx(dz, abs=1e-4)
    assert found.tilt < math.radians(0.1)
    assert not found.slides
    assert not found.rolls


@pytest.mark.parametrize("yaw", [0.0, 31.0, 45.0, 118.0])
@pytest.mark.parametrize(("obj", "half", "pitch"), [("rod", 0.002, 0.0), ("tube", 0.002, 90.0)])
def test_long_thin_object_is_supported_in_any_direction(
    world: World, obj: str, half: float, pitch: float, yaw: float
) -> None:
    """Hardly any ray of a grid along the axes of the world would hit it."""
    found = at(world, obj, 0.25, -0.38, 0.4 + half + 0.002, 0, pitch, yaw)
    assert found is not None
    assert found.below == pytest.approx(0.002, abs=1e-4)
    assert found.tilt < math.radians(0.1)


def test_support_beyond_the_searched_range_is_not_found(world: World) -> None:
    assert at(world, "cube", 0.35, -0.45, 0.45) is None
    assert at(world, "cube", 0.35, EDGE_Y + 0.03, 0.425) is None


@pytest.mark.parametrize("tilt", [1.0, 4.0, 12.0])
def test_tilt_of_a_cube_is_found(world: World, tilt: float) -> None:
    found = at(world, "cube", 0.35, -0.45, 0.428, tilt, 0, 30)
    assert found is not None
    assert math.degrees(found.tilt) == pytest.approx(tilt, abs=0.1)


@pytest.mark.parametrize(("inside", "stands"), [(0.01, True), (0.007, True), (0.002, False)])
def test_center_of_mass_keeps_three_millimeters_from_an_edge(
    world: World, inside: float, stands: bool
) -> None:
    """In addition, rays are 3.3 mm apart here, and the edge is known no more exactly."""
    found = at(world, "cube", 0.35, EDGE_Y - inside, 0.425)
    assert found is not None
    assert (found.tilt < math.radians(5)) == stands


@pytest.mark.parametrize(("inside", "stands"), [(0.007, True), (0.002, False), (-0.002, False)])
def test_the_center_of_mass_counts_and_not_the_frame(
    world: World, inside: float, stands: bool
) -> None:
    """The frame of a compound or mesh may be anywhere: here 0.1 m beside its only part."""
    found = at(world, "offset", 0.35, EDGE_Y - inside - 0.1, 0.425)
    assert found is not None
    assert (found.tilt < math.radians(5)) == stands


def test_narrow_or_curved_support_bears_only_in_its_middle(world: World) -> None:
    """A wall of 10 mm bears a cube in its middle; a wall of 4 mm or a ball of 30 mm does not."""
    assert at(world, "cube", 0.30, -0.6, 0.525).tilt < math.radians(5)  # type: ignore[union-attr]
    assert at(world, "cube", 0.303, -0.6, 0.525).tilt > math.radians(45)  # type: ignore[union-attr]
    assert at(world, "cube", 0.40, -0.6, 0.525).tilt > math.radians(45)  # type: ignore[union-attr]
    assert at(world, "cube", 0.20, -0.5, 0.485).tilt > math.radians(5)  # type: ignore[union-attr]


def test_cube_stands_along_a_slope_and_a_ball_rolls(world: World) -> None:
    face = Pose.from_rpy((0.5, -0.4, 0.45), (0.0, math.radians(20), 0.0))
    on_it = face @ Pose.from_rpy((0, 0, 0.035))
    along = support_below(world, "cube", on_it, ABOVE, BELOW)
    assert along is not None
    assert along.tilt < math.radians(0.1)
    assert math.degrees(along.slope) == pytest.approx(20, abs=0.1)
    assert not along.slides, "a friction of 0.8 or more holds on 32° less a fifth"
    level = support_below(world, "cube", Pose(on_it.position, np.eye(4)[0]), 0.02, 0.02)
    assert level is not None
    assert math.degrees(level.tilt) == pytest.approx(20, abs=0.5)
    ball = support_below(world, "ball", on_it, ABOVE, BELOW)
    assert ball is not None
    assert ball.rolls
    assert not ball.topples  # on a level support it would stay


def test_round_object_stays_on_a_level_support(world: World) -> None:
    for obj, height, *rpy in (
        ("ball", 0.025),
        ("can", 0.05),
        ("can", 0.025, 90, 0, 30),
        ("pill", 0.02, 90, 0, 30),
    ):
        found = at(world, str(obj), 0.35, -0.45, 0.4 + float(height), *map(float, rpy))
        assert found is not None
        assert not found.rolls
        assert found.tilt < math.radians(1)
    on_ball = at(world, "ball", 0.20, -0.5, 0.485)
    assert on_ball is not None
    assert on_ball.rolls
    upright = at(world, "pill", 0.35, -0.45, 0.45)
    assert upright is not None
    assert upright.rolls
    assert upright.topples  # on any support


@pytest.mark.parametrize("yaw", [0.0, 30.0, 90.0])
def test_side_of_an_upright_box_bears_nothing(world: World, yaw: float) -> None:
    """The normal of an unrotated side has a vertical component of exactly zero."""
    eye = np.array((0.20, -0.35, 0.45))
    to_side = np.array((math.cos(math.radians(yaw)), -math.sin(math.radians(yaw)), 0.0))
    start = np.array((0.30, -0.6, 0.45)) - 0.1 * to_side  # towards the middle of the wall
    assert bearing_ahead(world, start, to_side, ()) is None
    down = np.array((0.0, 0.0, -1.0))
    assert bearing_ahead(world, eye, down, ()) == pytest.approx(0.05, abs=1e-6)
