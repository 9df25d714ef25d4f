"""One link of a URDF: what it weighs, and its shapes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from bt_dualarm.pose import Matrix, Pose
from bt_dualarm.world.urdf.attributes import Complaints, Origin, Range
from bt_dualarm.world.urdf.xml_source import Element

MASS: Final = Range(0.0, 10_000.0, "kg")
_MOMENT: Final = Range(-1e6, 1e6, "kg m²")
_SIZE: Final = Range(0.0, 1000.0, "m", above=True)
_SCALE: Final = Range(-1e4, 1e4)
_ROUNDING: Final = 1e-6  # share of the largest moment by which a moment may be below zero
_MOMENTS: Final = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")

MeshFinder = Callable[[str], Path]
"""From the name of a mesh in a URDF to its file; raises ValueError with the reason if it cannot."""


@dataclass(frozen=True)
class Inertial:
    """Mass (kg), centre of mass with the axes of the moments, and ixx, iyy, izz, ixy, ixz, iyz."""

    mass: float
    origin: Origin
    moments: tuple[float, float, float, float, float, float]

    @property
    def tensor(self) -> Matrix:
        """Inertia about the centre of mass along the axes of the origin, of shape (3, 3), kg m²."""
        xx, yy, zz, xy, xz, yz = self.moments
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@dataclass(frozen=True, eq=False)
class Shape:
    """One shape of a link.

    Attributes:
        kind: ``box``, ``cylinder``, ``sphere`` or ``mesh``.
        size: Full lengths of a box, radius and length of a cylinder, radius of a sphere (m); the
            scale of a mesh.
        pose: Pose in the link.
        mesh: File of a mesh.
        element: Element of the URDF that says so.
    """

    kind: str
    size: tuple[float, ...]
    pose: Pose
    mesh: Path | None
    element: Element


_ANYTHING: Final = Inertial(1.0, Origin(), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
"""What a link weighs of which that was refused already."""


def inertial_of(link: Element, complaints: Complaints) -> Inertial | None:
    """What a link weighs; None if it weighs nothing, anything sound after a complaint."""
    element = link.find("inertial")
    if element is None:
        return None
    mass, inertia = element.find("mass"), element.find("inertia")
    for tag, found in (("mass", mass), ("inertia", inertia)):
        if found is None:
            complaints.add(element, f"<inertial> lacks a <{tag}>")
    if mass is None or inertia is None:
        return _ANYTHING
    before = len(complaints.problems)
    kilograms = complaints.number(mass, "value", MASS)
    zero = dict.fromkeys(_MOMENTS[3:], 0.0)
    xx, yy, zz, xy, xz, yz = (
        complaints.number(inertia, name, _MOMENT, zero.get(name)) for name in _MOMENTS
    )
    inertial = Inertial(kilograms, complaints.origin(element), (xx, yy, zz, xy, xz, yz))
    principal = np.linalg.eigvalsh(inertial.tensor)
    if principal[0] < -_ROUNDING * abs(principal[2]):
        shown = ", ".join(f"{moment:.3g}" for moment in principal)
        hint = f"no body has negative moments; its principal ones are {shown} kg m²"
        complaints.add(inertia, "<inertia> is that of no body", hint)
    sound = inertial if kilograms > 0 else None
    return _ANYTHING if len(complaints.problems) > before else sound


def shapes_of(
    link: Element, tag: str, mesh_file: MeshFinder, complaints: Complaints
) -> tuple[Shape, ...]:
    """The shapes of a link; ``tag`` is ``"visual"`` or ``"collision"``."""
    found = (_shape(element, mesh_file, complaints) for element in link.all(tag))
    return tuple(shape for shape in found if shape is not None)


def _shape(element: Element, mesh_file: MeshFinder, complaints: Complaints) -> Shape | None:
    geometry = element.find("geometry")
    if geometry is None or len(geometry.children) != 1:
        what = "lacks a <geometry>" if geometry is None else "needs one shape in its <geometry>"
        complaints.add(element, f"<{element.tag}> {what}", f"one of {', '.join(_SIZES)} or mesh")
        return None
    shape, pose = geometry.children[0], complaints.origin(element).pose
    if shape.tag == "mesh":
        return _mesh(shape, pose, mesh_file, complaints)
    if shape.tag not in _SIZES:
        hint = f"one of {', '.join(_SIZES)} or mesh"
        complaints.add(shape, f"shape <{shape.tag}> is not understood", hint)
        return None
    return Shape(shape.tag, _SIZES[shape.tag](shape, complaints), pose, None, shape)


def _box(shape: Element, complaints: Complaints) -> tuple[float, ...]:
    return complaints.vector(shape, "size", _SIZE)


def _cylinder(shape: Element, complaints: Complaints) -> tuple[float, ...]:
    return complaints.number(shape, "radius", _SIZE), complaints.number(shape, "length", _SIZE)


def _sphere(shape: Element, complaints: Complaints) -> tuple[float, ...]:
    return (complaints.number(shape, "radius", _SIZE),)


_SIZES: Final = {"box": _box, "cylinder": _cylinder, "sphere": _sphere}


def _mesh(
    shape: Element, pose: Pose, mesh_file: MeshFinder, complaints: Complaints
) -> Shape | None:
    scale = complaints.vector(shape, "scale", _SCALE, (1.0, 1.0, 1.0))
    if 0.0 in scale and "scale" in shape.attributes:
        complaints.add(shape, "<mesh> scale: a mesh that is scaled by 0 is flat", "", "scale")
    if "filename" not in shape.attributes:
        complaints.add(shape, "<mesh> lacks the attribute 'filename'")
        return None
    try:
        mesh = mesh_file(shape.attributes["filename"])
    except ValueError as error:
        message, _, hint = str(error).partition("; ")
        complaints.add(shape, message, hint, "filename")
        return None
    return Shape("mesh", scale, pose, mesh, shape)
