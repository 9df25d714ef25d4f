"""RRT-Connect and shortcuts: compiled."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from bt_dualarm.collision.kernel_arrays import Draws, Numbers, Query, SweptArm, Trees
from bt_dualarm.collision.swept_kernels import WHOLE, free_share
from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector

# RRT-Connect (Kuffner and LaValle 2000): two trees that grow toward each other.


_WORTH: Final = 0.05
"""Meters that a branch grows at least: shorter ones are left away."""

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
    """Length of a straight way in meters that the arm moves, the joints' shares squared."""
    square = 0.0
    for k in range(len(a)):
        square += ((b[k] - a[k]) * radii[k]) ** 2
    return math.sqrt(square)


@kernel
def connect(
    swept: SweptArm, query: Query, trees: Trees, hints: Matrix, draws: Draws, spent: Numbers
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
    swept: SweptArm,
    query: Query,
    trees: Trees,
    side: int,
    target: Vector,
    hints: Matrix,
    spent: Numbers,
) -> bool:
    """Grow a tree toward a place as far as it gets; tells whether it gets there."""
    while spent[0] < query.checks and trees.counts[side] < trees.nodes.shape[1]:
        left = _grown(swept, query, trees, side, target, hints, spent)
        if left < 0.0:
            return False
        if left == 0.0:
            return True
    return False


@kernel
def _grown(
    swept: SweptArm,
    query: Query,
    trees: Trees,
    side: int,
    target: Vector,
    hints: Matrix,
    spent: Numbers,
) -> float:
    """Add a branch toward a place; meters that are left to it, -1 where none could be added."""
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


# Paths made shorter: straight ways between two places on them, where these are free.


@kernel
def shorten(
    swept: SweptArm,
    corners: Matrix,
    count: int,
    radii: Vector,
    tries: int,
    hints: Matrix,
    draws: Draws,
    spent: Numbers,
) -> int:
    """Replace parts of a path by straight ways between random places on it (Geraerts 2007).

    Args:
        swept: The arm in its world.
        corners: Corners of the path, with room for others, of shape (m, dof), rad; renewed.
        count: Number of corners.
        radii: Meters that the arm moves per radian of each joint, of shape (dof,).
        tries: Number of tries.
        hints: As of `free_share`.
        draws: State of what is random.
        spent: As of `free_share`.

    Returns:
        How many corners there are now.
    """
    for _ in range(tries):
        if count < 3:
            break
        length = 0.0
        for i in range(count - 1):
            length += way_between(corners[i], corners[i + 1], radii)
        one = uniform(draws) * length
        other = uniform(draws) * length
        count = _cut(swept, corners, count, radii, min(one, other), max(one, other), hints, spent)
    return count


@kernel
def _cut(
    swept: SweptArm,
    corners: Matrix,
    count: int,
    radii: Vector,
    leave: float,
    arrive: float,
    hints: Matrix,
    spent: Numbers,
) -> int:
    """Replace what lies between two places, given by the meters until there, if that is free."""
    first, start = _at(corners, count, radii, leave)
    last, end = _at(corners, count, radii, arrive)
    if first == last or count + 2 > len(corners):
        return count
    if free_share(swept, start, end, WHOLE, hints, spent) < 1.0:
        return count
    # Between are corners first + 1 ... last; in their place come the two new ones.
    shift = 2 - (last - first)
    if shift > 0:
        for i in range(count - 1, last, -1):
            corners[i + shift] = corners[i]
    elif shift < 0:
        for i in range(last + 1, count):
            corners[i + shift] = corners[i]
    corners[first + 1] = start
    corners[first + 2] = end
    return count + shift


@kernel
def _at(corners: Matrix, count: int, radii: Vector, way: float) -> tuple[int, Vector]:
    """The corner before a place on a path, and the place."""
    for i in range(count - 1):
        length = way_between(corners[i], corners[i + 1], radii)
        if way < length or i == count - 2:
            share = min(way / length, 1.0) if length > 0.0 else 0.0
            return i, corners[i] + share * (corners[i + 1] - corners[i])
        way -= length
    return 0, corners[0].copy()


@kernel
def without_idle_corners(
    swept: SweptArm, corners: Matrix, count: int, hints: Matrix, spent: Numbers
) -> int:
    """Leave those corners out that the path gets along without; tells how many are left."""
    i = 0
    while i < count - 2:
        j = count - 1
        while j > i + 1 and free_share(swept, corners[i], corners[j], WHOLE, hints, spent) < 1.0:
            j -= 1
        shift = j - i - 1
        if shift > 0:
            for k in range(j, count):
                corners[k - shift] = corners[k]
            count -= shift
        i += 1
    return count
