"""Where several arms hold one object: near its ends, at its rims, each with its share."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.grasping.grasp import Box, Capsule, Cylinder, Grasp
from bt_dualarm.grasping.sections import HALF_M, sections, shares_at


def grasp(closing: tuple[float, float, float], approach: tuple[float, float, float]) -> Grasp:
    """A grasp in the section's frame."""
    x = np.cross(closing, approach)
    rows = list(zip(x, closing, approach, strict=True))
    return Grasp(Pose.from_axes(np.zeros(3), rows), 0.05, 40.0, 2.0)


def test_the_ends_of_a_beam_are_held_across_it_and_not_from_within() -> None:
    left, right = sections(Box(np.array((0.6, 0.025, 0.025))), 2, 1.0)
    assert left.pose.position[0] == pytest.approx(-(0.6 - HALF_M))
    assert right.pose.position[0] == pytest.approx(0.6 - HALF_M)
    assert left.allows(grasp((0, 1, 0), (0, 0, -1)))
    assert left.allows(grasp((0, 1, 0), (1, 0, 0)))  # from beyond the end
    assert not left.allows(grasp((0, 1, 0), (-1, 0, 0)))  # through the beam
    assert not left.allows(grasp((1, 0, 0), (0, 0, -1)))  # along it, where the beam goes on


def test_three_arms_hold_the_middle_as_well() -> None:
    *_, right = found = sections(Cylinder(0.02, 0.5), 3, 0.8)
    assert len(found) == 3
    assert right.pose.position[2] == pytest.approx(0.8 * (0.5 - HALF_M))
    assert not found[1].outward.any()


def test_a_disk_is_held_at_its_rims() -> None:
    left, _ = sections(Cylinder(0.2, 0.01), 2, 1.0)
    assert left.allows(grasp((0, 0, 1), (1, 0, 0)))
    assert not left.allows(grasp((0, 1, 0), (0, 0, -1)))


def test_things_without_two_ends_have_none() -> None:
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
