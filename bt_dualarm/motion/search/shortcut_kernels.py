"""Paths made shorter: straight ways between two places on them, where these are free."""

from __future__ import annotations

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.search.kernel_arrays import Draws, Numbers, Swept
from bt_dualarm.motion.search.sweep_kernels import WHOLE, free_share
from bt_dualarm.motion.search.tree_kernels import uniform, way_between
from bt_dualarm.pose import Matrix, Vector


@kernel
def shorten(
    swept: Swept,
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
        radii: Metres that the arm moves per radian of each joint, of shape (dof,).
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
        one, other = uniform(draws) * length, uniform(draws) * length
        count = _cut(swept, corners, count, radii, min(one, other), max(one, other), hints, spent)
    return count


@kernel
def _cut(
    swept: Swept,
    corners: Matrix,
    count: int,
    radii: Vector,
    leave: float,
    arrive: float,
    hints: Matrix,
    spent: Numbers,
) -> int:
    """Replace what lies between two places, given by the metres until there, if that is free."""
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
    swept: Swept, corners: Matrix, count: int, hints: Matrix, spent: Numbers
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
