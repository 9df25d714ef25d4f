"""Ports: literals are checked at once, references when they have a value."""

from __future__ import annotations

import pytest
from pydantic import ValidationError, model_validator

from bt_dualarm.behaviors.leaf import Log
from bt_dualarm.spec.node_types import (
    PortModel,
    as_text,
    dynamic_ports,
    miscounted,
    only,
    port,
    reference_of,
    templates_of,
    unit_of,
    validate_literals,
    validated,
)
from bt_dualarm.spec.values import Angle


class Ports(PortModel):
    low: float = port(..., "Lower end", unit="m", ge=0)
    high: float = port(1.0, "Upper end", unit="m", le=2)
    turn: Angle = port(0, "Turn")

    @model_validator(mode="after")
    def _ascending(self) -> Ports:
        if self.low > self.high:
            raise ValueError("low is above high")
        return self


def test_references_are_found_and_left_out_of_the_early_check() -> None:
    ports = {"low": "{a}", "high": 2}
    assert dynamic_ports(Ports, ports) == {"low"}
    assert reference_of(ports["low"]) == "a"
    validate_literals(Ports, ports)


def test_the_other_ports_are_checked_beside_a_reference() -> None:
    with pytest.raises(ValidationError, match="less than or equal to 2"):
        validate_literals(Ports, {"low": "{a}", "high": 3})


def test_an_unknown_port_is_unknown_as_a_reference_too() -> None:
    with pytest.raises(ValidationError, match="lwo"):
        validate_literals(Ports, {"lwo": "{a}", "low": 1})


def test_rules_over_several_ports_wait_for_all_of_them() -> None:
    validate_literals(Ports, {"low": "{a}", "high": 0.5})
    with pytest.raises(ValidationError, match="low is above high"):
        validated(Ports, {"low": 1, "high": 0.5})


class Choice(PortModel):
    exactly_one_of = ("to", "by")

    to: float | None = port(None, "Where to", unit="m")
    by: float | None = port(None, "How far", unit="m")


def test_exactly_one_of_several_ports_is_given() -> None:
    validated(Choice, {"to": 1})
    for ports in ({}, {"by": None}, {"to": 1, "by": 2}):
        with pytest.raises(ValidationError, match="give exactly one of: to, by"):
            validated(Choice, ports)


class Alternatives(PortModel):
    at_most_one_of = ("to", "path")

    to: float | None = port(None, "Where to", unit="m")
    path: float | None = port(None, "Along what", unit="m")


def test_at_most_one_of_several_ports_is_given() -> None:
    for ports in ({}, {"to": 1}, {"path": 1}):
        validated(Alternatives, ports)
    with pytest.raises(ValidationError, match="give at most one of: to, path; given: to and path"):
        validated(Alternatives, {"to": 1, "path": 2})


def test_a_reference_counts_as_given() -> None:
    assert miscounted(Choice, {"to": "{a}"}) == ""
    assert miscounted(Choice, {"to": "{a}", "by": 1}).endswith("given: to and by")
    assert miscounted(Choice, {}).endswith("none is given")


@pytest.mark.parametrize("value", ["1", True, None, [1], {"a": 1}])
def test_types_are_strict(value: object) -> None:
    with pytest.raises(ValidationError):
        validated(Ports, {"low": value})


def test_lists_are_tuples_inside() -> None:
    class Listing(PortModel):
        items: tuple[int, ...] = port(..., "Items")

    assert validated(Listing, {"items": [1, 2]}) == Listing(items=(1, 2))


def test_one_port_can_be_validated_alone() -> None:
    with pytest.raises(ValidationError):
        validated(only(Ports, "high"), {"high": 3})
    validated(only(Ports, "high"), {"high": 2})


def test_units_of_ports() -> None:
    assert unit_of(Ports.model_fields["low"]) == "m"
    assert unit_of(Ports.model_fields["turn"]) == "deg"


def test_a_text_with_keys_in_it_is_no_reference() -> None:
    assert templates_of(Log.Ports) == {"message"}
    assert dynamic_ports(Log.Ports, {"message": "{a}", "level": "{b}"}) == {"level"}
    assert reference_of("{b}") == "b"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("as it is", "as it is"),
        (3, "3"),
        (True, "true"),
        (None, "null"),
        (2.0, "2.0"),
        (0.30009954502009384, "0.3001"),
        (123456.75, "123456.75"),
        ({"xyz": [0.1234567, 0.0, -1.0], "rpy": None}, "{xyz: [0.12346, 0.0, -1.0]}"),
        ([], "[]"),
    ],
)
def test_a_value_in_a_text(value: object, text: str) -> None:
    """It is for people: five digits, and no fields that are not given."""
    assert as_text(value) == text
