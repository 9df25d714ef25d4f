"""Our splines against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import interpolate

from bt_dualarm.motion.splines.cubic_spline import CubicSpline


@pytest.mark.parametrize("periodic", [False, True], ids=["open", "closed"])
@pytest.mark.parametrize("count", [2, 3, 4, 5, 17, 60])
def test_it_is_scipys(count: int, periodic: bool) -> None:
    """Coefficients, values and derivatives, at its knots, between and beyond them."""
    rng = np.random.default_rng(count)
    for columns in (1, 3, 7):
        knots = np.cumsum(rng.uniform(0.001, 1.0, count))
        points = rng.normal(size=(count, columns))
        if periodic:
            points[-1] = points[0]
        ours = CubicSpline(knots, points, periodic=periodic)
        theirs = interpolate.CubicSpline(
            knots, points, bc_type="periodic" if periodic else "not-a-knot"
        )
        scale = np.abs(theirs.c).max()
        assert np.abs(ours.pieces - theirs.c.swapaxes(0, 1)).max() <= 1e-12 * scale
        reach = float(np.ptp(knots))
        between = rng.uniform(knots[0] - 0.3 * reach, knots[-1] + 0.3 * reach, 200)
        for order in (0, 1, 2):
            for places in (knots, between):
                wanted = theirs(places, order)
                most = float(np.abs(wanted).max())
                assert ours(places, order) == pytest.approx(wanted, abs=1e-11 * most)


def test_it_refuses_what_is_no_spline() -> None:
    """Knots that do not rise, too few points, a closed curve that is open."""
    points = np.zeros((3, 2))
    with pytest.raises(ValueError, match="knots that rise"):
        CubicSpline(np.array((0.0, 1.0, 1.0)), points)
    with pytest.raises(ValueError, match="as many points"):
        CubicSpline(np.array((0.0, 1.0)), points)
    with pytest.raises(ValueError, match="as many points"):
        CubicSpline(np.zeros(1), points[:1])
    with pytest.raises(ValueError, match="not the first"):
        CubicSpline(np.array((0.0, 1.0, 2.0)), np.eye(3), periodic=True)
