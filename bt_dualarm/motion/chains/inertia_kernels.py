"""The equations of motion of a chain: ``M(q) a + bias(q, v) = torque``.

In the world's axes: the recursion of Newton and Euler for the bias, composite bodies for the
inertia matrix (Featherstone, Rigid Body Dynamics Algorithms, 5 and 6).
"""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.chains.kernel_rows import CENTER, INERTIA, MASS, ROTOR
from bt_dualarm.motion.chains.place_kernels import place
from bt_dualarm.motion.chains.triple_kernels import add, cross, dot, scale, sub, triple, turned
from bt_dualarm.pose import Matrix, Vector


@kernel
def equations(
    links: Matrix, gravity: Vector, q: Vector, v: Vector, inertia: Matrix, bias: Vector
) -> None:
    """Enter the inertia matrix, of shape (dof, dof), and the bias, of shape (dof,).

    Args:
        links: Links of the chain, see `kernel_rows`.
        gravity: Acceleration of gravity in the world, of shape (3,), m/s².
        q: Positions of the joints, of shape (dof,), rad.
        v: Their velocities, of shape (dof,), rad/s.
        inertia: Inertia matrix, kg m².
        bias: Torques of gravity and of velocity, N m.
    """
    dof = len(q)
    turns, tensors = np.empty((dof, 9)), np.empty((dof, 9))
    axes, anchors, centers = np.empty((dof, 3)), np.empty((dof, 3)), np.empty((dof, 3))
    place(links, q, turns, axes, anchors)
    for i in range(dof):
        arm = turned(turns, i, 0, triple(links, i, CENTER))
        for axis in range(3):
            centers[i, axis] = anchors[i, axis] + arm[axis]
        _turn_tensor(links, turns, tensors, i)
    _enter_bias(links, gravity, v, axes, anchors, centers, tensors, bias)
    _enter_inertia(links, axes, anchors, centers, tensors, inertia)


@kernel
def _turn_tensor(links: Matrix, turns: Matrix, tensors: Matrix, i: int) -> None:
    """Enter a link's inertia about its centre in the world's axes: ``R I Rᵀ``."""
    for row in range(3):
        a, b, c = triple(turns, i, 3 * row)
        mixed = (
            a * links[i, INERTIA] + b * links[i, INERTIA + 3] + c * links[i, INERTIA + 6],
            a * links[i, INERTIA + 1] + b * links[i, INERTIA + 4] + c * links[i, INERTIA + 7],
            a * links[i, INERTIA + 2] + b * links[i, INERTIA + 5] + c * links[i, INERTIA + 8],
        )
        for column in range(3):
            tensors[i, 3 * row + column] = dot(mixed, triple(turns, i, 3 * column))


@kernel
def _enter_bias(
    links: Matrix,
    gravity: Vector,
    v: Vector,
    axes: Matrix,
    anchors: Matrix,
    centers: Matrix,
    tensors: Matrix,
    bias: Vector,
) -> None:
    """Forces that links need to go on as they do, outwards; what joints bear of them, inwards."""
    dof = len(v)
    forces, moments = np.empty((dof, 3)), np.empty((dof, 3))
    spin, spin_rate = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    rate = (-gravity[0], -gravity[1], -gravity[2])
    for i in range(dof):
        if i:
            arm = sub(triple(anchors, i, 0), triple(anchors, i - 1, 0))
            rate = add(rate, add(cross(spin_rate, arm), cross(spin, cross(spin, arm))))
        turning = scale(triple(axes, i, 0), v[i])
        spin_rate = add(spin_rate, cross(spin, turning))
        spin = add(spin, turning)
        arm = sub(triple(centers, i, 0), triple(anchors, i, 0))
        fall = add(rate, add(cross(spin_rate, arm), cross(spin, cross(spin, arm))))
        force = scale(fall, links[i, MASS])
        whirl = cross(spin, turned(tensors, i, 0, spin))
        moment = add(add(turned(tensors, i, 0, spin_rate), whirl), cross(arm, force))
        for axis in range(3):
            forces[i, axis], moments[i, axis] = force[axis], moment[axis]
    force, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(dof - 1, -1, -1):
        if i < dof - 1:
            arm = sub(triple(anchors, i + 1, 0), triple(anchors, i, 0))
            moment = add(moment, cross(arm, force))
        force, moment = add(force, triple(forces, i, 0)), add(moment, triple(moments, i, 0))
        bias[i] = dot(triple(axes, i, 0), moment)


@kernel
def _enter_inertia(
    links: Matrix, axes: Matrix, anchors: Matrix, centers: Matrix, tensors: Matrix, inertia: Matrix
) -> None:
    """What moves with a joint is one body: force and moment that turn it, at the joints before."""
    dof = len(axes)
    mass, center = 0.0, (0.0, 0.0, 0.0)
    whole = np.zeros((1, 9))
    for j in range(dof - 1, -1, -1):
        own, own_center = links[j, MASS], triple(centers, j, 0)
        both = mass + own
        # Two bodies about their common centre: the distance counts with the reduced mass.
        apart = sub(own_center, center)
        reduced = mass * own / both if both > 0.0 else 0.0
        if both > 0.0:
            center = add(center, scale(apart, own / both))
        square = dot(apart, apart)
        for row in range(3):
            for column in range(3):
                steiner = (square if row == column else 0.0) - apart[row] * apart[column]
                whole[0, 3 * row + column] += tensors[j, 3 * row + column] + reduced * steiner
        mass = both
        axis = triple(axes, j, 0)
        force = scale(cross(axis, sub(center, triple(anchors, j, 0))), mass)
        moment = turned(whole, 0, 0, axis)
        for i in range(j + 1):
            at = add(moment, cross(sub(center, triple(anchors, i, 0)), force))
            inertia[i, j] = inertia[j, i] = dot(triple(axes, i, 0), at)
        inertia[j, j] += links[j, ROTOR]


@kernel
def times(matrix: Matrix, given: Vector, product: Vector) -> None:
    """Enter the product of a matrix, of shape (n, n), and a vector, of shape (n,)."""
    for i in range(len(given)):
        total = 0.0
        for j in range(len(given)):
            total += matrix[i, j] * given[j]
        product[i] = total


@kernel
def solve(matrix: Matrix, given: Vector, found: Vector) -> None:
    """Enter x of ``matrix x = given``: symmetric, positive definite, of shape (n, n)."""
    solve_rows(matrix, given.reshape(-1, 1), found.reshape(-1, 1))


@kernel
def solve_rows(matrix: Matrix, given: Matrix, found: Matrix) -> None:
    """The same for many columns at once, each of shape (n, m) (Cholesky)."""
    n = len(given)
    root = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            rest = matrix[i, j]
            for k in range(j):
                rest -= root[i, k] * root[j, k]
            root[i, j] = math.sqrt(rest) if i == j else rest / root[j, j]
    for column in range(given.shape[1]):
        for i in range(n):
            rest = given[i, column]
            for k in range(i):
                rest -= root[i, k] * found[k, column]
            found[i, column] = rest / root[i, i]
        for i in range(n - 1, -1, -1):
            rest = found[i, column]
            for k in range(i + 1, n):
                rest -= root[k, i] * found[k, column]
            found[i, column] = rest / root[i, i]
