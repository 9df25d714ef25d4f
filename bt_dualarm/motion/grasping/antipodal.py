"""Pairs of opposite points: where two fingers may close on a solid."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import singledispatch

import numpy as np

from bt_dualarm.motion.grasping.mesh_solid import MeshSolid
from bt_dualarm.motion.grasping.solids import Box, Capsule, Cylinder, Solid
from bt_dualarm.pose import Vector

AZIMUTHS = 6
"""Directions around an axis of revolution, of half a turn: the other half is the same pair."""

_PITCHES = np.deg2rad([0.0, 30.0, -30.0, 60.0, -60.0])
_LARGE = 0.02  # m: half of an edge that has room for pads beside its middle
_SAMPLES = 48  # of a mesh


@dataclass(frozen=True, eq=False)
class Pinch:
    """A line on which two pads close.

    Attributes:
        center: Place between the pads, of shape (3,), m.
        axis: Direction of the line, of unit length, of shape (3,).
        around: Direction square to it from which approaches are turned, likewise.
    """

    center: Vector
    axis: Vector
    around: Vector


@singledispatch
def pinches(
    solid: Solid,
    down: Vector,  # noqa: ARG001 - of the functions below, that stand for this one
    rng: np.random.Generator,  # noqa: ARG001 - as above
) -> Iterator[Pinch]:
    """Lines along which a solid's surface is opposite itself, in its own frame.

    Args:
        solid: Solid that is to be taken.
        down: Direction of gravity, of unit length, of shape (3,): of what has no sides of its own,
            lines that lie level come first.
        rng: Generator for what is sampled, of meshes.

    Raises:
        TypeError: Nothing is known of this kind of solid.
    """
    raise TypeError(f"no pinches are known of a {type(solid).__name__}")


@pinches.register
def _(solid: Box, down: Vector, rng: np.random.Generator) -> Iterator[Pinch]:  # noqa: ARG001 - as above
    axes = np.eye(3)
    for i in range(3):
        for j in ((i + 1) % 3, (i + 2) % 3):
            shares = (0.0, 0.5, -0.5) if solid.half[j] > _LARGE else (0.0,)
            for share in shares:
                if share or j == (i + 1) % 3:  # the middle once
                    yield Pinch(share * solid.half[j] * axes[j], axes[i], axes[(i + 1) % 3])


@pinches.register
def _(solid: Cylinder, down: Vector, rng: np.random.Generator) -> Iterator[Pinch]:  # noqa: ARG001 - as above
    axis = np.array([0.0, 0.0, 1.0])
    yield from _diameters(axis, down, solid.half_length)
    for around in _half_turn(axis, down):
        yield Pinch(np.zeros(3), axis, around)


@pinches.register
def _(solid: Capsule, down: Vector, rng: np.random.Generator) -> Iterator[Pinch]:  # noqa: ARG001 - as above
    if solid.half_length > 0.0:
        axis = np.array([0.0, 0.0, 1.0])
        yield from _diameters(axis, down, solid.half_length)
        yield Pinch(np.zeros(3), axis, square_to(axis, down))
        return
    yield Pinch(np.zeros(3), down, square_to(down, np.array([1.0, 0.0, 0.0])))
    for level in _half_turn(down, np.array([1.0, 0.0, 0.0])):
        for pitch in _PITCHES:
            axis = np.cos(pitch) * level + np.sin(pitch) * down
            yield Pinch(np.zeros(3), axis, square_to(axis, down))


@pinches.register
def _(solid: MeshSolid, down: Vector, rng: np.random.Generator) -> Iterator[Pinch]:
    """Sampled points, each with what lies opposite: Chen and Burdick, ICRA 1993."""
    points, normals = solid.sample(_SAMPLES, rng)
    for point, normal in zip(points, normals, strict=True):
        found = solid.farthest_hit(point, -normal)
        if found is not None:
            yield Pinch(0.5 * (point + found[0]), normal, square_to(normal, down))


def square_to(axis: Vector, wanted: Vector) -> Vector:
    """The unit vector square to ``axis`` that is nearest to one wanted; any if none is nearest."""
    across = wanted - (wanted @ axis) * axis
    if np.linalg.norm(across) < 1e-6:
        across = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    unit: Vector = across / np.linalg.norm(across)
    return unit


def _diameters(axis: Vector, down: Vector, half_length: float) -> Iterator[Pinch]:
    """Lines through an axis of revolution, level ones first."""
    shares = (0.0, 0.5, -0.5) if half_length > _LARGE else (0.0,)
    level = np.asarray(np.cross(axis, down), dtype=float)
    for across in _half_turn(axis, level):
        for share in shares:
            yield Pinch(share * half_length * axis, across, axis)


def _half_turn(axis: Vector, wanted: Vector) -> Iterator[Vector]:
    """Directions around an axis over half a turn, that nearest to one wanted first."""
    first = square_to(axis, wanted)
    second = np.cross(axis, first)
    for angle in np.arange(AZIMUTHS) * np.pi / AZIMUTHS:
        yield np.cos(angle) * first + np.sin(angle) * second
