"""Parts of a gripper from its page: shapes with their mass spread evenly, or links of a URDF."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.world.grippers.gripper import RigidPart, Solid
from bt_dualarm.world.grippers.gripper_entry import PartEntry, ShapeEntry
from bt_dualarm.world.urdf.link import Inertial, Shape
from bt_dualarm.world.urdf.part import Part


def part_of(entry: PartEntry) -> RigidPart:
    """A part that its page describes: its mass is spread evenly over the volumes of its shapes."""
    solids = tuple(Solid(shape.shape, shape.size, shape.pose) for shape in entry.shapes)
    volumes = np.array([_volume(shape) for shape in entry.shapes])
    masses = entry.mass * volumes / volumes.sum()
    bodies = [
        (mass, solid.pose.position, _inertia(solid, mass))
        for mass, solid in zip(masses.tolist(), solids, strict=True)
    ]
    return RigidPart(*together(bodies), solids, ())


def part_of_link(part: Part) -> RigidPart:
    """A part that is a link of a URDF, its shapes and inertia as they stand there."""
    inertial = part.inertial or Inertial(1e-3, part.origin, (1e-6, 1e-6, 1e-6, 0.0, 0.0, 0.0))
    turn = inertial.origin.pose.rotation_matrix
    return RigidPart(
        inertial.mass,
        inertial.origin.pose.position,
        turn @ inertial.tensor @ turn.T,
        tuple(map(_solid, part.collision)),
        tuple(map(_solid, part.visual)),
    )


def together(bodies: Sequence[tuple[float, Vector, Matrix]]) -> tuple[float, Vector, Matrix]:
    """Mass, centre and inertia about it of bodies that hold together (parallel-axis theorem).

    Args:
        bodies: Mass in kg, centre of mass of shape (3,) in m, and inertia about it of shape (3, 3)
            in kg m² of each, all in one frame.
    """
    mass = sum(body[0] for body in bodies)
    center = sum((body[0] * body[1] for body in bodies), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for own, place, about in bodies:
        away = place - center
        inertia += about + own * (away @ away * np.eye(3) - np.outer(away, away))
    return mass, center, inertia


def placed(pose: Pose, part: RigidPart) -> tuple[float, Vector, Matrix]:
    """Mass, centre and inertia of a part in the frame in which it stands at a pose."""
    turn = pose.rotation_matrix
    return part.mass, pose.apply(part.center), turn @ part.inertia @ turn.T


def _solid(shape: Shape) -> Solid:
    return Solid(shape.kind, shape.size, shape.pose, shape.mesh)


def _volume(shape: ShapeEntry) -> float:
    size = shape.size
    if shape.shape == "box":
        return float(np.prod(size))
    if shape.shape == "cylinder":
        return float(np.pi * size[0] ** 2 * size[1])
    return float(4 / 3 * np.pi * size[0] ** 3)


def _inertia(solid: Solid, mass: float) -> Matrix:
    """Of an even body about its centre, along the axes of its part, of shape (3, 3), kg m²."""
    squares = np.square(solid.size)
    if solid.kind == "box":
        x, y, z = squares
        own = np.array([y + z, z + x, x + y]) / 12
    elif solid.kind == "cylinder":
        radius, length = squares
        own = np.array([3 * radius + length, 3 * radius + length, 6 * radius]) / 12
    else:
        own = np.full(3, 0.4 * squares[0])
    turn = solid.pose.rotation_matrix
    inertia: Matrix = turn @ np.diag(mass * own) @ turn.T
    return inertia
