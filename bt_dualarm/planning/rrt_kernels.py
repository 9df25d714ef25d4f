"""RRT-Connect that cuts blocked edges short.

J. J. Kuffner, S. M. LaValle, RRT-Connect: An efficient approach to single-query path planning, ICRA
2000. Edges are checked by `free_share`, which determines how far an edge is free: a blocked
extension is cut short instead of rejected. Distances are weighted by the motion of the arm per
radian.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from bt_dualarm.collision.kernel_arrays import Draws, Numbers, Query, SweptArm, Trees
from bt_dualarm.collision.swept_kernels import free_share
from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector

_WORTH: Final = 0.05
"""Shortest edge that is added to a tree, as motion of the arm, m."""

_FINE: Final = 0.1
"""Resolution of the free share of a blocked edge."""

_BACK: Final = 0.9
"""Used fraction of the free part of a blocked edge: it ends at a distance from obstacles."""

_BESIDE: Final = 0.7
"""Fraction of samples that are drawn near existing nodes, not uniformly: with them, a tree gets out
of narrow passages."""


@kernel
def connect(
    swept: SweptArm, query: Query, trees: Trees, hints: Matrix, draws: Draws, checks: Numbers
) -> bool:
    """Grow two trees until they meet, or the limits of checks or nodes are reached.

    Args:
        swept: The arm in its world.
        query: Sampling bounds and limits.
        trees: Trees with their roots; extended. If they meet, their last nodes are equal.
        hints: As in `free_share`.
        draws: State of the random number generator; updated.
        checks: As in `free_share`.

    Returns:
        Whether the trees have met.
    """
    target = np.empty(query.lower.shape[0])
    most = trees.nodes.shape[1]
    side = 0
    while checks[0] < query.checks and trees.counts[0] < most and trees.counts[1] < most:
        if uniform(draws) < _BESIDE:
            _write_sample_near(query, trees, side, draws, target)
        else:
            for k in range(len(target)):
                target[k] = query.lower[k] + uniform(draws) * (query.upper[k] - query.lower[k])
        if _extended(swept, query, trees, side, target, hints, checks) >= 0.0:
            last = trees.nodes[side, trees.counts[side] - 1]
            if _reached(swept, query, trees, 1 - side, last, hints, checks):
                return True
        # The smaller tree is next, which keeps both balanced.
        side = 0 if trees.counts[0] <= trees.counts[1] else 1
    return False


@kernel
def _reached(
    swept: SweptArm,
    query: Query,
    trees: Trees,
    side: int,
    target: Vector,
    hints: Matrix,
    checks: Numbers,
) -> bool:
    """Extend a tree toward a configuration until blocked ("connect"); True if it is reached."""
    while checks[0] < query.checks and trees.counts[side] < trees.nodes.shape[1]:
        remaining = _extended(swept, query, trees, side, target, hints, checks)
        if remaining < 0.0:
            return False
        if remaining == 0.0:
            return True
    return False


@kernel
def _extended(
    swept: SweptArm,
    query: Query,
    trees: Trees,
    side: int,
    target: Vector,
    hints: Matrix,
    checks: Numbers,
) -> float:
    """Add an edge toward a configuration; returns the remaining distance, m, or -1 if blocked."""
    nearest = _nearest(trees.nodes[side], trees.counts[side], target, query.radii)
    root = trees.nodes[side, nearest]
    length = motion_between(root, target, query.radii)
    if length == 0.0:
        return -1.0
    share = min(query.longest / length, 1.0)
    end = root + share * (target - root)
    free = free_share(swept, root, end, _FINE, hints, checks)
    if free < 1.0:
        free *= _BACK
        if free * share * length < _WORTH:
            return -1.0
        end = root + free * (end - root)
    elif share == 1.0:
        end = target  # exactly: the sum above is subject to rounding, and the trees must meet
    number = trees.counts[side]
    trees.nodes[side, number] = end
    trees.parents[side, number] = nearest
    trees.counts[side] = number + 1
    if free < 1.0:  # a node was added, but the obstacle is right ahead
        return -1.0
    return (1.0 - share) * length


@kernel
def _nearest(nodes: Matrix, count: int, target: Vector, radii: Vector) -> int:
    """Index of the node nearest to a configuration."""
    least = math.inf
    found = 0
    for n in range(count):
        square = 0.0
        for k in range(len(target)):
            square += ((target[k] - nodes[n, k]) * radii[k]) ** 2
        if square < least:
            least = square
            found = n
    return found


@kernel
def _write_sample_near(query: Query, trees: Trees, side: int, draws: Draws, target: Vector) -> None:
    """Draw a sample in a box around a random node, of a random size up to two edges each way."""
    node = trees.nodes[side, int(uniform(draws) * trees.counts[side])]
    width = 2.0 * uniform(draws) * query.longest
    for k in range(len(target)):
        angle = node[k] + width * (2.0 * uniform(draws) - 1.0) / query.radii[k]
        target[k] = min(max(angle, query.lower[k]), query.upper[k])


@kernel
def motion_between(a: Vector, b: Vector, radii: Vector) -> float:
    """Weighted Euclidean distance of two configurations, m."""
    square = 0.0
    for k in range(len(a)):
        square += ((b[k] - a[k]) * radii[k]) ** 2
    return math.sqrt(square)


@kernel
def uniform(draws: Draws) -> float:
    """Random number in [0, 1): xorshift64*, with its state in ``draws``.

    S. Vigna, An experimental exploration of Marsaglia's xorshift generators, scrambled, ACM
    Transactions on Mathematical Software 42(4), 2016.
    """
    x = draws[0]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    draws[0] = x
    # The upper 53 bits, as many as a float's mantissa has.
    return float((x * np.uint64(2685821657736338717)) >> np.uint64(11)) / 9007199254740992.0
