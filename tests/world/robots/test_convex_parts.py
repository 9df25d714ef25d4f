"""Parts of a mesh hold all of it and have a volume each, also where the mesh has holes."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from bt_dualarm.world.robots.convex_parts import convex_parts

BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)


def shell(*boxes: tuple[tuple[float, float, float], tuple[float, float, float]]) -> np.ndarray:
    """Triangles, of shape (n, 3, 3), of boxes given by a corner and their edges, in m."""
    hulls = [scipy.spatial.ConvexHull(np.array(at) + BOX * edges) for at, edges in boxes]
    return np.concatenate([hull.points[hull.simplices] for hull in hulls])


ELBOW = shell(((0.0, 0.0, 0.0), (0.1, 0.1, 0.5)), ((0.0, 0.0, 0.5), (0.5, 0.1, 0.1)))


@pytest.mark.parametrize("seed", range(40))
def test_every_part_has_a_volume_and_all_points_are_held(seed: int) -> None:
    """Holes are made by leaving out triangles, as broken meshes do."""
    rng = np.random.default_rng(seed)
    triangles = ELBOW[rng.random(len(ELBOW)) < rng.uniform(0.4, 1.0)]
    hulls = [scipy.spatial.ConvexHull(part) for part in convex_parts(triangles)]
    assert all(hull.volume > 0.0 for hull in hulls)
    points = triangles.reshape(-1, 3)
    outside = [(points @ h.equations[:, :3].T + h.equations[:, 3]).max(axis=1) for h in hulls]
    assert np.min(outside, axis=0).max() < 1e-9


def test_an_elbow_is_cut_at_its_bend() -> None:
    parts = convex_parts(ELBOW)
    volume = sum(scipy.spatial.ConvexHull(part).volume for part in parts)
    assert len(parts) == 2
    assert volume == pytest.approx(0.1 * 0.1 * 0.5 * 2, rel=0.2)
