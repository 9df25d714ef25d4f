"""Convex parts of a mesh: they contain all of it and have volume, even if the mesh has holes."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from bt_dualarm.core.triangles import cut_at
from bt_dualarm.robots import meshes
from tests.families import some

BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)


def shell(*boxes: tuple[tuple[float, float, float], tuple[float, float, float]]) -> np.ndarray:
    """Triangles, of shape (n, 3, 3), of boxes given by a corner and their edges, in m."""
    hulls = [scipy.spatial.ConvexHull(np.array(at) + BOX * edges) for at, edges in boxes]
    return np.concatenate([hull.points[hull.simplices] for hull in hulls])


ELBOW = shell(((0.0, 0.0, 0.0), (0.1, 0.1, 0.5)), ((0.0, 0.0, 0.5), (0.5, 0.1, 0.1)))


@pytest.mark.parametrize("seed", some(range(40), 3))
def test_every_part_has_a_volume_and_all_points_are_contained(seed: int) -> None:
    """The mesh has holes: some triangles are left out, as in broken meshes."""
    rng = np.random.default_rng(seed)
    triangles = ELBOW[rng.random(len(ELBOW)) < rng.uniform(0.4, 1.0)]
    hulls = [scipy.spatial.ConvexHull(part) for part in meshes.convex_parts(triangles)]
    assert all(hull.volume > 0.0 for hull in hulls)
    points = triangles.reshape(-1, 3)
    outside = [(points @ h.equations[:, :3].T + h.equations[:, 3]).max(axis=1) for h in hulls]
    assert np.min(outside, axis=0).max() < 1e-9


def test_an_elbow_is_cut_at_its_bend() -> None:
    parts = meshes.convex_parts(ELBOW)
    volume = sum(scipy.spatial.ConvexHull(part).volume for part in parts)
    assert len(parts) == 2
    assert volume == pytest.approx(0.1 * 0.1 * 0.5 * 2, rel=0.2)


def volume_of(triangles: np.ndarray) -> float:
    """Volume of the convex hull, m³; 0 if it is flat."""
    try:
        return float(scipy.spatial.ConvexHull(triangles.reshape(-1, 3)).volume)
    except (scipy.spatial.QhullError, ValueError):
        return 0.0


@pytest.mark.parametrize("seed", range(12))
def test_no_cut_saves_more_than_the_chosen_one(seed: int) -> None:
    """The test tries every plane; the code rules most of them out by bounds."""
    rng = np.random.default_rng(seed)
    boxes = [(rng.uniform(0, 0.4, 3), rng.uniform(0.02, 0.3, 3)) for _ in range(3)]
    triangles = shell(*((tuple(at), tuple(edges)) for at, edges in boxes))
    low = triangles.min(axis=(0, 1))
    high = triangles.max(axis=(0, 1))
    whole = volume_of(triangles)
    saved = [
        whole - sum(volume_of(half) for half in cut_at(triangles, axis, float(offset)))
        for axis in range(3)
        for offset in np.linspace(low[axis], high[axis], meshes._STEPS + 1)[1:-1]
    ]
    worth = meshes._MIN_SAVING * whole
    cut = meshes._best_cut(triangles, None, worth)
    assert cut.volume == pytest.approx(whole)
    assert cut.saved == pytest.approx(max(saved) if max(saved) >= worth else 0.0)
