"""Numbers and names in the attributes of XML elements, each refused at its own place."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final

from bt_dualarm.pose import Pose
from bt_dualarm.spec.problems import Problem, nearest
from bt_dualarm.world.urdf.xml_source import Element

_NUMBER: Final = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:inf|nan)\w*", re.I)
_LONGEST_NAME: Final = 128
_STRAIGHT: Final = 1e-9  # cosine of a pitch at which roll and yaw turn about one axis


@dataclass(frozen=True)
class Range:
    """What a number may be, both ends included.

    Attributes:
        unit: Unit of the number, for messages.
        above: Whether the lower end itself is excluded.
    """

    least: float
    most: float
    unit: str = ""
    above: bool = False

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        if self.above:
            return f"greater than {self.least:g}{unit} and at most {self.most:g}{unit}"
        return f"from {self.least:g} to {self.most:g}{unit}"

    def holds(self, number: float) -> bool:
        """Whether the number lies within; NaN lies nowhere."""
        return self.least < number <= self.most if self.above else self.least <= number <= self.most


LENGTH: Final = Range(-1000.0, 1000.0, "m")
ANGLE: Final = Range(-1000.0, 1000.0, "rad")


@dataclass(frozen=True)
class Origin:
    """Where a frame is in its parent: metres, and roll, pitch, yaw in radians."""

    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def of(cls, pose: Pose) -> Origin:
        """The same as angles about fixed axes; looking straight up or down, yaw is 0."""
        turn = pose.rotation_matrix
        pitch = math.atan2(-turn[2, 0], math.hypot(turn[0, 0], turn[1, 0]))
        if math.hypot(turn[0, 0], turn[1, 0]) > _STRAIGHT:
            roll, yaw = math.atan2(turn[2, 1], turn[2, 2]), math.atan2(turn[1, 0], turn[0, 0])
        else:
            roll, yaw = math.atan2(-turn[1, 2], turn[1, 1]), 0.0
        x, y, z = (float(part) for part in pose.position)
        return cls((x, y, z), (roll, pitch, yaw))

    @property
    def pose(self) -> Pose:
        """The same as a transform."""
        return Pose.from_rpy(self.xyz, self.rpy)


class Complaints:
    """Reads attributes and notes what is wrong; what it returns then is of no use but harmless."""

    def __init__(self) -> None:
        self.problems: list[Problem] = []

    def add(
        self, element: Element, message: str, hint: str = "", attribute: str | None = None
    ) -> None:
        """Note an error at an element, or at one of its attributes."""
        self.problems.append(element.problem(message, hint, attribute))

    def number(
        self, element: Element, attribute: str, within: Range, default: float | None = None
    ) -> float:
        """A number; the default, or a complaint if there is none, where it is not given."""
        text = element.attributes.get(attribute)
        if text is None:
            return self._missing(element, attribute) if default is None else default
        found = self._numbers(element, attribute, text, 1, within)
        return found[0] if found else 0.0

    def vector(
        self,
        element: Element,
        attribute: str,
        within: Range,
        default: tuple[float, float, float] | None = None,
    ) -> tuple[float, float, float]:
        """Three numbers; likewise."""
        text = element.attributes.get(attribute)
        if text is None:
            if default is None:
                self._missing(element, attribute)
            return default or (0.0, 0.0, 0.0)
        found = self._numbers(element, attribute, text, 3, within)
        return (found[0], found[1], found[2]) if found else default or (0.0, 0.0, 0.0)

    def name(self, element: Element, attribute: str = "name") -> str:
        """A name that can stand in a world beside those of other arms; empty if it cannot."""
        name = element.attributes.get(attribute)
        if name is None:
            self._missing(element, attribute)
            return ""
        wrong = (
            "is empty" if not name.strip() else
            f"is longer than {_LONGEST_NAME} characters" if len(name) > _LONGEST_NAME else
            "holds a slash" if "/" in name else
            "holds a character that cannot be printed" if not name.isprintable() else ""
        )  # fmt: skip
        if wrong:
            hint = "a slash parts the names of an arm and its links" if "slash" in wrong else ""
            self.add(element, f"<{element.tag}> {attribute} {wrong}", hint, attribute)
        return "" if wrong else name

    def origin(self, element: Element) -> Origin:
        """The ``<origin>`` of an element; none is the parent's frame itself."""
        found = element.find("origin")
        if found is None:
            return Origin()
        zero = (0.0, 0.0, 0.0)
        return Origin(
            self.vector(found, "xyz", LENGTH, zero), self.vector(found, "rpy", ANGLE, zero)
        )

    def _missing(self, element: Element, attribute: str) -> float:
        near = nearest(attribute, element.attributes)
        hint = f"is '{near}' meant?" if near else ""
        self.add(element, f"<{element.tag}> lacks the attribute '{attribute}'", hint)
        return 0.0

    def _numbers(
        self, element: Element, attribute: str, text: str, count: int, within: Range
    ) -> tuple[float, ...]:
        """So many numbers; none after a complaint."""
        words = text.split()
        what = f"<{element.tag}> {attribute}"
        wrong = next((word for word in words if not _NUMBER.fullmatch(word)), None)
        if wrong is not None or len(words) != count:
            wanted = "a number" if count == 1 else f"{count} numbers"
            given = repr(text[:40]) if wrong is not None else f"{len(words)}"
            self.add(element, f"{what}: expected {wanted}, not {given}", _advice(wrong), attribute)
            return ()
        numbers = tuple(float(word) for word in words)
        outside = next((number for number in numbers if not within.holds(number)), None)
        if outside is not None:
            self.add(element, f"{what}: must be {within}, not {outside:g}", "", attribute)
            return ()
        return numbers


def _advice(word: str | None) -> str:
    if word and re.fullmatch(r"[+-]?\d+,\d+", word):
        return f"write {word.replace(',', '.')}: the decimal mark is a point"
    if word and "${" in word:
        return "this is a template: run xacro on it first"
    return ""
