"""Positions at which `insert` searches for a hole."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_dualarm.core.pose import Matrix
from bt_dualarm.skill.inserting import InsertingPorts, positions

radii = st.floats(0.0, 0.004)
pitches = st.floats(2e-4, 1e-3)


def first_pass(radius: float, pitch: float) -> Matrix:
    """Lattice positions around the center, of shape (n, 2), m."""
    found: Matrix = np.array(positions(radius, pitch))
    numbers = found / pitch @ np.linalg.inv(BASIS)
    lattice: Matrix = found[np.abs(numbers - np.round(numbers)).max(axis=1) < 1e-6]
    return lattice


BASIS = np.array(((1.0, 0.0), (0.5, np.sqrt(0.75))))
"""Neighbors of the center of a lattice of unit pitch, one a row."""


@settings(max_examples=30)
@given(radius=radii, pitch=pitches)
def test_search_proceeds_outward_from_the_center(radius: float, pitch: float) -> None:
    """Each position is new and within the radius, and no ring is followed by an inner one."""
    found = np.array(positions(radius, pitch))
    assert (found[0] == 0.0).all()
    assert np.linalg.norm(found, axis=1).max() <= radius + 1e-8
    apart = np.linalg.norm(found[:, None] - found, axis=2) + np.eye(len(found))
    assert apart.min() > 0.5 * pitch
    distances = np.linalg.norm(first_pass(radius, pitch), axis=1)
    ring = pitch * (1.0 - np.cos(np.pi / 6.0)) * (1.0 + radius / pitch)
    assert (distances >= np.maximum.accumulate(distances) - ring - 1e-9).all()


@given(pitch=pitches, angle=st.floats(0.0, 2.0 * np.pi), fraction=st.floats(0.0, 1.0))
def test_every_hole_is_near_a_search_position(pitch: float, angle: float, fraction: float) -> None:
    """A position of the first pass is within the pitch divided by the square root of three."""
    radius = 0.003
    hole = fraction * (radius - pitch) * np.array((np.cos(angle), np.sin(angle)))
    nearest = np.linalg.norm(first_pass(radius, pitch) - hole, axis=1).min()
    assert nearest <= pitch / np.sqrt(3.0) + 1e-9


def test_consecutive_positions_are_mostly_neighbors() -> None:
    """The median hop is one pitch long; longer hops would take more time."""
    ports = InsertingPorts.model_fields
    pitch = float(ports["pitch"].default)
    found = first_pass(float(ports["radius"].default), pitch)
    hops = np.linalg.norm(np.diff(found, axis=0), axis=1)
    assert np.median(hops) == pytest.approx(pitch)
    assert hops.max() < 4.0 * pitch
