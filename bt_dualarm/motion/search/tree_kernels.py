"""RRT-Connect (Kuffner and LaValle 2000): two trees that grow towards each other."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.search.kernel_arrays import Draws, Numbers, Query, Swept, Trees
from bt_dualarm.motion.search.sweep_kernels import free_share
from bt_dualarm.pose import Matrix, Vector

_WORTH: Final = 0.05
"""Metres that a branch grows at least: shorter ones are left away."""

_FINE: Final = 0.1
"""Least share of a branch by which it is worth to know better how far it gets."""

_BACK: Final = 0.9
"""Share of the free way up to something that a branch takes."""

_BESIDE: Final = 0.7
"""Share of the places to grow to that are drawn beside a node, not anywhere: from there a tree
finds its way out of narrow places."""


@kernel
def uniform(draws: Draws) -> float:
    """A random number from 0 to below 1 (xorshift64*, Vigna 2016); ``draws`` is its state."""
    x = draws[0]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    draws[0] = x
    return float((x * np.uint64(2685821657736338717)) >> np.uint64(11)) / 9007199254740992.0


@kernel
def way_between(a: Vector, b: Vector, radii: Vector) -> float:
    """Length of a straight way in metres that the arm moves, the joints' shares squared."""
    square = 0.0
    for k in range(len(a)):
        square += ((b[k] - a[k]) * radii[k]) ** 2
    return math.sqrt(square)


@kernel
def connect(
    swept: Swept, query: Query, trees: Trees, hints: Matrix, draws: Draws, spent: Numbers
) -> bool:
    """Grow both trees until they meet, the smaller one each time; tells whether they have.

    Args:
        swept: The arm in its world.
        query: Where to search, and for how long.
        trees: The trees; their roots are in them. The last branches of both end at one place.
        hints: As of `free_share`.
        draws: State of what is random.
        spent: As of `free_share`.
    """
    target = np.empty(query.lower.shape[0])
    most = trees.nodes.shape[1]
    side = 0
    while spent[0] < query.checks and trees.counts[0] < most and trees.counts[1] < most:
        if uniform(draws) < _BESIDE:
            _enter_place_beside(query, trees, side, draws, target)
        else:
            for k in range(len(target)):
                target[k] = query.lower[k] + uniform(draws) * (query.upper[k] - query.lower[k])
        if _grown(swept, query, trees, side, target, hints, spent) >= 0.0:
            last = trees.nodes[side, trees.counts[side] - 1]
            if _reached(swept, query, trees, 1 - side, last, hints, spent):
                return True
        side = 0 if trees.counts[0] <= trees.counts[1] else 1
    return False


@kernel
def _enter_place_beside(
    query: Query, trees: Trees, side: int, draws: Draws, target: Vector
) -> None:
    """Draw a place about as far from a node of a tree, near or less near, as branches are long."""
    node = trees.nodes[side, int(uniform(draws) * trees.counts[side])]
    wide = 2.0 * uniform(draws) * query.longest
    for k in range(len(target)):
        place = node[k] + wide * (2.0 * uniform(draws) - 1.0) / query.radii[k]
        target[k] = min(max(place, query.lower[k]), query.upper[k])


@kernel
def _reached(
    swept: Swept,
    query: Query,
    trees: Trees,
    side: int,
    target: Vector,
    hints: Matrix,
    spent: Numbers,
) -> bool:
    """Grow a tree towards a place as far as it gets; tells whether it gets there."""
    while spent[0] < query.checks and trees.counts[side] < trees.nodes.shape[1]:
        left = _grown(swept, query, trees, side, target, hints, spent)
        if left < 0.0:
            return False
        if left == 0.0:
            return True
    return False


@kernel
def _grown(
    swept: Swept,
    query: Query,
    trees: Trees,
    side: int,
    target: Vector,
    hints: Matrix,
    spent: Numbers,
) -> float:
    """Add a branch towards a place; metres that are left to it, -1 where none could be added."""
    nearest = _nearest(trees.nodes[side], trees.counts[side], target, query.radii)
    root = trees.nodes[side, nearest]
    length = way_between(root, target, query.radii)
    if length == 0.0:
        return -1.0
    share = min(query.longest / length, 1.0)
    end = root + share * (target - root)
    free = free_share(swept, root, end, _FINE, hints, spent)
    if free < 1.0:
        free *= _BACK
        if free * share * length < _WORTH:
            return -1.0
        end = root + free * (end - root)
    elif share == 1.0:
        end = target
    number = trees.counts[side]
    trees.nodes[side, number] = end
    trees.parents[side, number] = nearest
    trees.counts[side] = number + 1
    if free < 1.0:
        return -1.0
    return (1.0 - share) * length


@kernel
def _nearest(nodes: Matrix, count: int, target: Vector, radii: Vector) -> int:
    """Number of the node that is nearest to a place."""
    least, found = math.inf, 0
    for n in range(count):
        square = 0.0
        for k in range(len(target)):
            square += ((target[k] - nodes[n, k]) * radii[k]) ** 2
        if square < least:
            least, found = square, n
    return found
