"""Compiled rigid-body chain of an arm: link poses, tool Jacobian, equations of motion.

Joint and link frames have world axes with all joints at zero, so that a joint is described by an
axis and a position alone (product of exponentials; Lynch and Park, Modern Robotics, 4.1). Array
layouts are in `chain_kernel_arrays`. Vectors are tuples of three floats, which compiled code keeps
in registers.
"""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.kinematics.chain_kernel_arrays import (
    AXIS,
    CENTER,
    INERTIA,
    MASS,
    ROTOR,
    STEP,
    Triple,
)


@kernel
def place(links: Matrix, q: Vector, turns: Matrix, axes: Matrix, anchors: Matrix) -> None:
    """Write the forward kinematics of all links.

    Args:
        links: Links of the chain, of shape (dof, LINK).
        q: Joint positions, of shape (dof,), rad.
        turns: Output: rotation of each link, row by row, of shape (dof, 9).
        axes: Output: joint axes in the world, of shape (dof, 3).
        anchors: Output: joint positions in the world, of shape (dof, 3), m.
    """
    for i in range(len(q)):
        axis = triple(links, i, AXIS)
        step = triple(links, i, STEP)
        x, y, z = axis
        cos = math.cos(q[i])
        sin = math.sin(q[i])
        rest = 1.0 - cos
        # Rodrigues' formula: rotation by q about the joint axis.
        own = (
            (cos + rest * x * x, rest * x * y - sin * z, rest * x * z + sin * y),
            (rest * y * x + sin * z, cos + rest * y * y, rest * y * z - sin * x),
            (rest * z * x - sin * y, rest * z * y + sin * x, cos + rest * z * z),
        )
        if i == 0:
            for row in range(3):
                for column in range(3):
                    turns[0, 3 * row + column] = own[row][column]
        else:
            for row in range(3):
                a, b, c = triple(turns, i - 1, 3 * row)
                for column in range(3):
                    value = a * own[0][column] + b * own[1][column] + c * own[2][column]
                    turns[i, 3 * row + column] = value
            # A joint's own turn leaves its axis and its anchor in place.
            axis = rotate(turns, i - 1, 0, axis)
            step = rotate(turns, i - 1, 0, step)
        for column in range(3):
            axes[i, column] = axis[column]
            anchors[i, column] = step[column] + (anchors[i - 1, column] if i else 0.0)


@kernel
def tool_pose_and_jacobian(links: Matrix, q: Vector, frames: Matrix, jacobian: Matrix) -> None:
    """Write the tool frame and its Jacobian.

    Args:
        links: Links of the chain, of shape (dof, LINK).
        q: Joint positions, of shape (dof,), rad.
        frames: Tool frames, rotation row by row, then position, of shape (3, 12). The second row is
            output; the third is the frame relative to the last joint with all joints at zero.
        jacobian: Output: Jacobian of the tool in the world, linear first, of shape (6, dof).
    """
    dof = len(q)
    turns = np.empty((dof, 9))
    axes = np.empty((dof, 3))
    anchors = np.empty((dof, 3))
    place(links, q, turns, axes, anchors)
    arm = rotate(turns, dof - 1, 0, triple(frames, 2, 9))
    tool = add(triple(anchors, dof - 1, 0), arm)
    for row in range(3):
        frames[1, 9 + row] = tool[row]
        for column in range(3):
            total = 0.0
            for between in range(3):
                total += turns[dof - 1, 3 * row + between] * frames[2, 3 * between + column]
            frames[1, 3 * row + column] = total
    for i in range(dof):
        axis = triple(axes, i, 0)
        velocity = cross(axis, sub(tool, triple(anchors, i, 0)))
        for row in range(3):
            jacobian[row, i] = velocity[row]
            jacobian[3 + row, i] = axis[row]


@kernel
def equations_of_motion(
    links: Matrix, gravity: Vector, q: Vector, v: Vector, inertia: Matrix, bias: Vector
) -> None:
    """Write inertia matrix M and bias of ``M(q) a + bias(q, v) = torque``.

    The bias follows from the recursive Newton-Euler algorithm, the inertia matrix from the
    composite-rigid-body algorithm, both in world axes (Featherstone, Rigid Body Dynamics
    Algorithms, chapters 5 and 6).

    Args:
        links: Links of the chain, of shape (dof, LINK).
        gravity: Acceleration of gravity in the world, of shape (3,), m/s².
        q: Joint positions, of shape (dof,), rad.
        v: Joint velocities, of shape (dof,), rad/s.
        inertia: Output: inertia matrix, of shape (dof, dof), kg m².
        bias: Output: gravity, Coriolis and centrifugal torques, of shape (dof,), N m.
    """
    dof = len(q)
    turns = np.empty((dof, 9))
    tensors = np.empty((dof, 9))
    axes = np.empty((dof, 3))
    anchors = np.empty((dof, 3))
    centers = np.empty((dof, 3))
    place(links, q, turns, axes, anchors)
    for i in range(dof):
        arm = rotate(turns, i, 0, triple(links, i, CENTER))
        for axis in range(3):
            centers[i, axis] = anchors[i, axis] + arm[axis]
        _write_tensor(links, turns, tensors, i)
    _write_bias(links, gravity, v, axes, anchors, centers, tensors, bias)
    _write_inertia(links, axes, anchors, centers, tensors, inertia)


@kernel
def _write_tensor(links: Matrix, turns: Matrix, tensors: Matrix, i: int) -> None:
    """Write a link's inertia about its center of mass in world axes: ``R I Rᵀ``."""
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
def _write_bias(
    links: Matrix,
    gravity: Vector,
    v: Vector,
    axes: Matrix,
    anchors: Matrix,
    centers: Matrix,
    tensors: Matrix,
    bias: Vector,
) -> None:
    """Write the bias: link accelerations from base to tip, then joint torques from tip to base."""
    dof = len(v)
    forces = np.empty((dof, 3))
    moments = np.empty((dof, 3))
    spin = (0.0, 0.0, 0.0)
    spin_rate = (0.0, 0.0, 0.0)
    # An upward acceleration of the base stands in for gravity.
    rate = (-gravity[0], -gravity[1], -gravity[2])
    for i in range(dof):
        if i:
            # Acceleration of this joint's anchor as a point of the previous link.
            arm = sub(triple(anchors, i, 0), triple(anchors, i - 1, 0))
            rate = add(rate, add(cross(spin_rate, arm), cross(spin, cross(spin, arm))))
        # The spin of the previous link turns the axis, hence the cross product. The joint's own
        # acceleration is zero: it belongs to M(q) a.
        turning = scale(triple(axes, i, 0), v[i])
        spin_rate = add(spin_rate, cross(spin, turning))
        spin = add(spin, turning)
        arm = sub(triple(centers, i, 0), triple(anchors, i, 0))
        center_rate = add(rate, add(cross(spin_rate, arm), cross(spin, cross(spin, arm))))
        force = scale(center_rate, links[i, MASS])
        # Euler's equation about the center of mass, then shifted to the joint.
        gyroscopic = cross(spin, rotate(tensors, i, 0, spin))
        moment = add(add(rotate(tensors, i, 0, spin_rate), gyroscopic), cross(arm, force))
        for axis in range(3):
            forces[i, axis] = force[axis]
            moments[i, axis] = moment[axis]
    force = (0.0, 0.0, 0.0)
    moment = (0.0, 0.0, 0.0)
    # Each joint carries all links beyond it.
    for i in range(dof - 1, -1, -1):
        if i < dof - 1:
            arm = sub(triple(anchors, i + 1, 0), triple(anchors, i, 0))
            moment = add(moment, cross(arm, force))
        force = add(force, triple(forces, i, 0))
        moment = add(moment, triple(moments, i, 0))
        bias[i] = dot(triple(axes, i, 0), moment)


@kernel
def _write_inertia(
    links: Matrix, axes: Matrix, anchors: Matrix, centers: Matrix, tensors: Matrix, inertia: Matrix
) -> None:
    """Write the inertia matrix.

    All links beyond joint j form one rigid body. Column j is the wrench that gives it a unit
    acceleration about joint j, as torques at joints 0 to j.
    """
    dof = len(axes)
    mass = 0.0
    center = (0.0, 0.0, 0.0)
    whole = np.zeros((1, 9))
    # From the tip, so that the composite body grows by one link at a time.
    for j in range(dof - 1, -1, -1):
        own = links[j, MASS]
        own_center = triple(centers, j, 0)
        both = mass + own
        # Inertia of two bodies about their common center of mass: the parallel-axis terms of both
        # add up to that of the reduced mass at their distance.
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
        moment = rotate(whole, 0, 0, axis)
        for i in range(j + 1):
            at = add(moment, cross(sub(center, triple(anchors, i, 0)), force))
            inertia[i, j] = inertia[j, i] = dot(triple(axes, i, 0), at)
        inertia[j, j] += links[j, ROTOR]


@kernel
def multiply(matrix: Matrix, given: Vector, product: Vector) -> None:
    """Write the product of a matrix, of shape (n, n), and a vector, of shape (n,)."""
    for i in range(len(given)):
        total = 0.0
        for j in range(len(given)):
            total += matrix[i, j] * given[j]
        product[i] = total


@kernel
def solve(matrix: Matrix, given: Vector, found: Vector) -> None:
    """Write x of ``matrix x = given``; the matrix is symmetric positive definite, (n, n)."""
    solve_rows(matrix, given.reshape(-1, 1), found.reshape(-1, 1))


@kernel
def solve_rows(matrix: Matrix, given: Matrix, found: Matrix) -> None:
    """Solve as `solve` for several columns, of shape (n, m), by Cholesky decomposition."""
    n = len(given)
    root = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            rest = matrix[i, j]
            for k in range(j):
                rest -= root[i, k] * root[j, k]
            # Positive for a positive definite matrix: no pivoting is needed.
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


@kernel
def triple(rows: Matrix, row: int, first: int) -> Triple:
    """Three consecutive elements of a row as a vector."""
    return rows[row, first], rows[row, first + 1], rows[row, first + 2]


@kernel
def add(a: Triple, b: Triple) -> Triple:
    """Sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel
def sub(a: Triple, b: Triple) -> Triple:
    """Difference of two vectors."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def scale(a: Triple, factor: float) -> Triple:
    """Vector times a scalar."""
    return a[0] * factor, a[1] * factor, a[2] * factor


@kernel
def dot(a: Triple, b: Triple) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a: Triple, b: Triple) -> Triple:
    """Cross product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@kernel
def rotate(rows: Matrix, row: int, first: int, a: Triple) -> Triple:
    """Vector rotated by a matrix of which a row has the 9 elements, row by row."""
    return (
        rows[row, first] * a[0] + rows[row, first + 1] * a[1] + rows[row, first + 2] * a[2],
        rows[row, first + 3] * a[0] + rows[row, first + 4] * a[1] + rows[row, first + 5] * a[2],
        rows[row, first + 6] * a[0] + rows[row, first + 7] * a[1] + rows[row, first + 8] * a[2],
    )
