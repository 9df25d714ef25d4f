"""An arm's links and joints as a URDF of our own: the only one that MuJoCo and PlaCo ever read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from bt_dualarm.world.urdf.attributes import Origin
from bt_dualarm.world.urdf.link import Inertial
from bt_dualarm.world.urdf.part import Part

ROOT = "world"
"""Link above the base: MuJoCo takes the first link of a URDF for its world."""

_ENTITIES: Final = str.maketrans(
    {
        "&": "&amp;",
        "<": "&lt;",
        ">": "&gt;",
        '"': "&quot;",
        "\n": "&#10;",
        "\r": "&#13;",
        "\t": "&#9;",
    }
)
"""What an attribute's value cannot hold as it is; the standard library's own way to write it brings
in what downloads web pages."""

_NOTHING = Inertial(0.0, Origin(), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


def kinematic_text(parts: Iterable[Part]) -> str:
    """A URDF without shapes: links, inertias, joints with their limits."""
    lines = [f"<link name={_quoted(ROOT)}/>"]
    for part in parts:
        lines += _link(part)
    for part in parts:
        lines += _joint(part)
    return "\n".join(['<robot name="arm">', *lines, "</robot>"])


def _link(part: Part) -> Iterator[str]:
    """A link; without an inertia MuJoCo would put the centre of mass somewhere else."""
    yield f"<link name={_quoted(part.link)}>{_inertial(part.inertial or _NOTHING)}</link>"


def _inertial(inertial: Inertial) -> str:
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    pairs = zip(names, inertial.moments, strict=True)
    moments = " ".join(f'{name}="{moment!r}"' for name, moment in pairs)
    mass = f'<mass value="{inertial.mass!r}"/>'
    return f"<inertial>{_origin(inertial.origin)}{mass}<inertia {moments}/></inertial>"


def _joint(part: Part) -> Iterator[str]:
    """The joint of a link; that of a fixed one has a name that no URDF can have."""
    kind = "fixed" if part.joint is None else "revolute"
    name = f"{part.link}/fixed" if part.joint is None else part.joint.name
    yield f'<joint name={_quoted(name)} type="{kind}">{_origin(part.origin)}'
    yield f"<parent link={_quoted(part.parent or ROOT)}/><child link={_quoted(part.link)}/>"
    if part.axis is not None and part.stops is not None:
        stops, axis = part.stops, part.axis.tolist()
        yield f'<axis xyz="{_numbers(axis)}"/><limit lower="{stops.lower!r}" '
        yield f'upper="{stops.upper!r}" velocity="{stops.velocity!r}" effort="{stops.effort!r}"/>'
    yield "</joint>"


def _quoted(value: str) -> str:
    """The value of an attribute (XML 1.0, 2.3 and 3.3.3)."""
    return f'"{value.translate(_ENTITIES)}"'


def _origin(origin: Origin) -> str:
    return f'<origin xyz="{_numbers(origin.xyz)}" rpy="{_numbers(origin.rpy)}"/>'


def _numbers(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
