"""Descriptions of nodes: every type, bound and default as an author would write it."""

from __future__ import annotations

from typing import Literal

import pytest

from bt_dualarm.behaviors.language import LANGUAGE
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.node_types import NodeType, PortModel, port
from bt_dualarm.spec.reference import PortDescription, describe, ports_of
from bt_dualarm.spec.values import Angle, Duration, ObjectOrArmName, PoseSpec, Speed


class Ports(PortModel):
    radius: float = port(0.1, "radius", unit="m", ge=0.005, le=2)
    tilt: Angle | None = port(None, "lean", gt=-60)
    pause: Duration = port(..., "pause", gt=0)
    speed: Speed = port(1, "share")
    way: tuple[PoseSpec, ...] = port(..., "poses", min_length=1, max_length=9)
    axis: Literal["x", "y"] | tuple[float, float, float] = port("x", "axis")
    at: ObjectOrArmName = port("cube", "thing")
    code: str = port("A", "code", pattern="^[A-Z]$")
    deep: dict[str, tuple[bool, int]] = port({}, "anything")
    points: tuple[tuple[float, float], ...] = port(..., "curve", unit="m")
    things: tuple[ObjectOrArmName, ...] = port((), "several")
    heights: list[float] = port([], "heights")


@pytest.mark.parametrize(
    "expected",
    [
        PortDescription("radius", "number", "m", "≥ 0.005, ≤ 2", "0.1", "radius", False),
        PortDescription("tilt", "angle", "deg", "> -60, ≤ 3600", "", "lean", False),
        PortDescription("pause", "duration", "s", "> 0, ≤ 86400", "", "pause", True),
        PortDescription("speed", "number", "", "≥ 0.001, ≤ 1", "1", "share", False),
        PortDescription("way", "list of poses", "", "length 1 to 9", "", "poses", True),
        PortDescription("axis", "x or y or list of 3 numbers", "", "", "x", "axis", False),
        PortDescription("at", "name of an object or arm", "", "", "cube", "thing", False),
        PortDescription("points", "list of lists of 2 numbers", "m", "", "", "curve", True),
        PortDescription(
            "things", "list of names of an object or arm", "", "", "[]", "several", False
        ),
        PortDescription("heights", "list of numbers", "", "", "[]", "heights", False),
        PortDescription("code", "text", "", "matches ^[A-Z]$", "A", "code", False),
    ],
    ids=lambda expected: expected.name,
)
def test_description_of_a_port(expected: PortDescription) -> None:
    assert expected in ports_of(Ports)


def node_types() -> list[NodeType]:
    return [*LANGUAGE.values(), *Registry.load().kinds.values()]


@pytest.mark.parametrize("kind", node_types(), ids=lambda kind: kind.name)
def test_no_type_is_described_in_python_notation(kind: NodeType) -> None:
    """A type without a description would show brackets or dots."""
    description = describe(kind)
    assert [
        port for port in description.ports + description.outputs if set(port.type) & set("[].<_")
    ] == [
        port
        for port in description.ports
        if port.name == "relation"  # its choices have underscores
    ]
    assert all(port.description for port in description.ports + description.outputs)


def test_children_are_described_by_their_slot() -> None:
    assert describe(LANGUAGE["if"]).children == {
        "condition": "a node",
        "then": "a node",
        "else": "a node, or none",
    }
    assert set(describe(LANGUAGE["switch"]).children) == {"cases", "default"}
