"""Sections at which several arms hold one object, near its ends or at its rim, and load shares."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.grasping.grasp import Box, Capsule, CompoundSolid, Cylinder, Grasp, MeshSolid
from bt_dualarm.grasping.sections import HALF_M, farthest_apart, section_at, sections, shares_at


def grasp(closing: tuple[float, float, float], approach: tuple[float, float, float]) -> Grasp:
    """A grasp in the section's frame."""
    x = np.cross(closing, approach)
    rows = list(zip(x, closing, approach, strict=True))
    return Grasp(Pose.from_axes(np.zeros(3), rows), 0.05, 40.0, 2.0)


def test_ends_of_a_beam_are_grasped_across_and_not_from_the_middle() -> None:
    left, right = sections(Box(np.array((0.6, 0.025, 0.025))), 2, 1.0)
    assert left.pose.position[0] == pytest.approx(-(0.6 - HALF_M))
    assert right.pose.position[0] == pytest.approx(0.6 - HALF_M)
    assert left.allows(grasp((0, 1, 0), (0, 0, -1)))
    assert left.allows(grasp((0, 1, 0), (1, 0, 0)))  # from beyond the end
    assert not left.allows(grasp((0, 1, 0), (-1, 0, 0)))  # through the beam
    assert not left.allows(grasp((1, 0, 0), (0, 0, -1)))  # along it, where the beam continues


def test_third_arm_holds_the_middle() -> None:
    *_, right = found = sections(Cylinder(0.02, 0.5), 3, 0.8)
    assert len(found) == 3
    assert right.pose.position[2] == pytest.approx(0.8 * (0.5 - HALF_M))
    assert not found[1].outward.any()


def test_disk_is_grasped_at_its_rim_from_outside() -> None:
    left, right = sections(Cylinder(0.2, 0.01), 2, 1.0)
    assert left.pose.position == pytest.approx((-(0.2 - HALF_M), 0, 0))
    assert right.pose.position == pytest.approx((0.2 - HALF_M, 0, 0))
    for section in (left, right):  # their x axes point outward
        assert section.allows(grasp((0, 0, 1), (-1, 0, 0)))
        assert not section.allows(grasp((0, 0, 1), (1, 0, 0)))
        assert not section.allows(
            grasp((0, 0, 1), (0, 1, 0))
        )  # along the rim: the palm would touch it
        assert not section.allows(grasp((0, 1, 0), (0, 0, -1)))


@pytest.mark.parametrize("count", [2, 3])
def test_sections_of_a_disk_face_the_arms(count: int) -> None:
    """The order of the arms, here at equal angles around the disk from 40°, does not matter."""
    angles = np.radians(40.0) + 2.0 * np.pi * np.arange(count) / count
    bases = [np.array((np.cos(angle), np.sin(angle), -0.3)) for angle in angles[::-1]]
    found = sections(Cylinder(0.2, 0.01), count, 1.0, bases)
    places = sorted(tuple(one.pose.position.round(9)) for one in found)
    expected = sorted(tuple((0.2 - HALF_M) * base[:2]) for base in bases)
    assert np.array(places)[:, :2] == pytest.approx(np.array(expected))


def test_parts_that_are_farthest_apart_are_found() -> None:
    centers = {
        "plate": np.zeros(3),
        "left": np.array((-0.3, 0.0, 0.0)),
        "right": np.array((0.3, 0.0, 0.0)),
        "back": np.array((0.0, 0.25, 0.0)),
    }
    assert farthest_apart(centers, 2) == ("left", "right")
    assert set(farthest_apart(centers, 3)) == {"left", "right", "back"}
    assert farthest_apart(centers, 5) == ()
    assert farthest_apart({name: 0.1 * at for name, at in centers.items()}, 2) == ()


def test_section_at_a_part_is_centered_there_and_keeps_the_other_parts() -> None:
    bar, handle = Box(np.array((0.3, 0.1, 0.01))), Box(np.array((0.01, 0.05, 0.03)))
    center = np.array((0.27, 0.0, 0.04))
    there = Pose.from_rpy((0.27, 0.0, 0.04))
    surfaces = (np.zeros((1, 3)), center[None])
    whole = CompoundSolid(((bar, Pose.identity()), (handle, there)), (), (1,), surfaces)
    section = section_at(whole, center)
    assert isinstance(section.solid, CompoundSolid)
    (_, bar_at), (_, handle_at) = section.solid.parts
    assert section.pose.position == pytest.approx(center)
    assert handle_at.position == pytest.approx((0, 0, 0))
    assert bar_at.position == pytest.approx(-center)
    assert [points[0].tolist() for points in section.solid.surfaces] == [
        (-center).tolist(),
        [0] * 3,
    ]
    assert section.allows(grasp((1, 0, 0), (0, 0, -1)))


@pytest.mark.parametrize("corner", [(0.0, 0.0, 0.0), (-0.6, -0.025, -0.025)])
def test_sections_of_a_convex_mesh_are_slices_of_it(corner: tuple[float, float, float]) -> None:
    """Wherever its frame is; here it becomes narrower toward one end."""
    ends = np.array([(x, y, z) for x in (-0.6, 0.6) for y in (-1, 1) for z in (-1, 1)])
    ends[:, 1:] *= np.where(ends[:, :1] < 0.0, 0.025, 0.015)
    left, right = sections(MeshSolid.hull_of(ends - corner), 2, 1.0)
    assert left.pose.position == pytest.approx(np.array((-(0.6 - HALF_M), 0, 0)) - corner)
    assert right.pose.position == pytest.approx(np.array((0.6 - HALF_M, 0, 0)) - corner)
    assert right.outward == pytest.approx((1, 0, 0))
    x, y = np.eye(3)[:2]
    assert right.solid.reach(x) == pytest.approx(HALF_M)
    assert right.solid.reach(y) == pytest.approx(0.015 + 0.01 * 2.0 * HALF_M / 1.2)
    assert right.solid.distance(np.zeros((1, 3)))[0] < 0.0


def test_objects_without_two_ends_have_no_sections() -> None:
    assert sections(Box(np.full(3, 0.03)), 2, 1.0) == []
    assert sections(Capsule(0.1), 2, 1.0) == []


@pytest.mark.parametrize(
    ("places", "shares"),
    [((-0.5, 0.5), (0.5, 0.5)), ((-0.25, 0.5), (2 / 3, 1 / 3)), ((-0.5, 0.0, 0.5), (1 / 3,) * 3)],
)
def test_shares_follow_from_the_law_of_the_lever(
    places: tuple[float, ...], shares: tuple[float, ...]
) -> None:
    found = shares_at([np.array((place, 0.0, 0.0)) for place in places])
    assert found == pytest.approx(shares, abs=1e-3)
