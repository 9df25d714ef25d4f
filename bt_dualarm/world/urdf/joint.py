"""One joint of a URDF: where it is, what it turns about, how far."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from bt_dualarm.pose import Vector
from bt_dualarm.spec.problems import nearest
from bt_dualarm.world.urdf.attributes import Complaints, Origin, Range
from bt_dualarm.world.urdf.xml_source import Element

TURNING: Final = ("revolute", "continuous")
KINDS: Final = (*TURNING, "prismatic", "fixed", "floating", "planar")
ONE_TURN: Final = 2 * math.pi
"""How far a joint without stops turns either way, rad."""

LEAST_SPAN: Final = 0.05
"""What a joint of an arm turns at least, rad: planners keep a little away from both ends."""

_STOP: Final = Range(-math.inf, math.inf, "rad")
_NO_STOP: Final = 1000.0  # rad; what a URDF writes for a joint that turns on and on
_VELOCITY: Final = Range(0.0, 1e5, "rad/s")
_EFFORT: Final = Range(0.0, 1e7, "N m")
_AXIS: Final = Range(-1e6, 1e6)


@dataclass(frozen=True, eq=False)
class Joint:
    """What hangs on what, as far as every joint of a file says.

    Attributes:
        kind: One of `KINDS`.
        element: Element of the URDF.
    """

    name: str
    kind: str
    parent: str
    child: str
    element: Element

    @property
    def turns(self) -> bool:
        """Whether it could be a joint of an arm."""
        return self.kind in TURNING and self.element.find("mimic") is None


@dataclass(frozen=True)
class Stops:
    """Limits of a joint: rad, rad/s, N m; zero where the URDF gives no velocity or effort."""

    lower: float
    upper: float
    velocity: float
    effort: float


def joint_of(element: Element, complaints: Complaints) -> Joint:
    """What hangs on what; empty names where that is not said."""
    name, kind = complaints.name(element), element.attributes.get("type", "")
    if kind not in KINDS:
        near = nearest(kind, KINDS)
        hint = f"did you mean '{near}'?" if near else f"one of {', '.join(KINDS)}"
        what = f"there is no joint type {kind!r}" if kind else "<joint> lacks the attribute 'type'"
        complaints.add(element, what, hint, "type")
    ends = {}
    for tag in ("parent", "child"):
        found = element.find(tag)
        if found is None:
            complaints.add(element, f"joint '{name}' lacks a <{tag}>", f'<{tag} link="…"/>')
        ends[tag] = complaints.name(found, "link") if found is not None else ""
    return Joint(name, kind, ends["parent"], ends["child"], element)


def origin_of(joint: Joint, complaints: Complaints) -> Origin:
    """The frame of the joint's child, at zero, in its parent's."""
    return complaints.origin(joint.element)


def axis_of(joint: Joint, complaints: Complaints) -> Vector:
    """Direction that it turns about or slides along in its own frame, of shape (3,), length 1."""
    element = joint.element.find("axis")
    if element is None:
        return np.array([1.0, 0.0, 0.0])  # the default of the URDF's specification
    axis = np.array(complaints.vector(element, "xyz", _AXIS, (1.0, 0.0, 0.0)))
    length = float(np.linalg.norm(axis))
    if length < 1e-3:
        complaints.add(element, "<axis> xyz has no direction", "three numbers, not all 0", "xyz")
        return np.array([1.0, 0.0, 0.0])
    return axis / length


def stops_of(joint: Joint, complaints: Complaints) -> Stops:
    """How far and fast a turning joint goes."""
    element = joint.element.find("limit")
    if element is None:
        if joint.kind == "revolute":
            hint = "or type='continuous' if it has no stops"
            complaints.add(joint.element, f"joint '{joint.name}' lacks a <limit>", hint)
        return Stops(-ONE_TURN, ONE_TURN, 0.0, 0.0)
    velocity = complaints.number(element, "velocity", _VELOCITY, 0.0)
    effort = complaints.number(element, "effort", _EFFORT, 0.0)
    if joint.kind == "continuous":
        return Stops(-ONE_TURN, ONE_TURN, velocity, effort)
    before = len(complaints.problems)
    lower = complaints.number(element, "lower", _STOP, 0.0)
    upper = complaints.number(element, "upper", _STOP, 0.0)
    if max(-lower, upper) >= _NO_STOP:
        lower, upper = max(lower, -ONE_TURN), min(upper, ONE_TURN)
    if len(complaints.problems) == before and not upper - lower >= LEAST_SPAN:
        message = f"joint '{joint.name}' turns from {lower:g} to {upper:g} rad"
        complaints.add(element, message, f"'upper' is at least {LEAST_SPAN} above 'lower'")
    return Stops(lower, upper, velocity, effort)
