"""Conditions on the true world that a file declares: goals to reach, and invariants to keep.

The trees know nothing of them. They are a referee: a run whose trees report SUCCESS without meeting
the goals is a false success.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Final, Self, TypeAlias

from pydantic import Field, model_validator

from bt_dualarm.spec.cell import CellSpec
from bt_dualarm.spec.joints import moved_name
from bt_dualarm.spec.node_types import port
from bt_dualarm.spec.problems import Name, Problem, suggestion
from bt_dualarm.spec.values import Duration, JointPosition, PoseSpec, Value
from bt_dualarm.spec.yaml_reader import Source

CONDITIONS: Final = ("at", "in_zone", "on", "tilt", "height", "held_by", "held", "speed", "force",
                     "distance_to", "joint")  # fmt: skip
"""Fields of which a condition has at least one; all that are given must hold."""

_Bounds: TypeAlias = tuple[
    Annotated[float, Field(ge=-100.0, le=100.0)], Annotated[float, Field(ge=-100.0, le=100.0)]
]


class ConditionSpec(Value):
    """Condition on an object, or on the tool of an arm."""

    object: str | None = port(None, "Object that the condition is about")
    tool: str | None = port(None, "Arm whose tool the condition is about")
    at: PoseSpec | None = port(None, "Pose in the world; the orientation counts only if given")
    within: float = port(0.01, "Largest distance from `at`", unit="m", gt=0.0, le=10.0)
    angle: float = port(5.0, "Largest angle from `at`", unit="deg", gt=0.0, le=180.0)
    in_zone: str | None = port(None, "Zone of the cell in which its center is")
    on: str | None = port(None, "Object on which it stands: it touches it from above")
    tilt: float | None = port(
        None,
        "Largest angle of its z axis from the vertical, up to the symmetry of an object",
        unit="deg",
        ge=0.0,
        le=180.0,
    )
    height: _Bounds | None = port(None, "Smallest and largest height of its center", unit="m")
    held_by: str | None = port(None, "Arm that holds it")
    held: bool | None = port(None, "Whether any arm holds it")
    speed: float | None = port(None, "Largest speed of its center", unit="m/s", ge=0.0, le=100.0)
    force: float | None = port(
        None, "Largest contact force of an arm on other things", unit="N", ge=0.0, le=1e5
    )
    distance_to: str | None = port(None, "Object or arm from which its center keeps `apart`")
    apart: float = port(0.1, "Smallest distance from `distance_to`", unit="m", gt=0.0, le=100.0)
    joint: str | None = port(None, "Joint of the object whose position is `between` two others")
    between: tuple[JointPosition, JointPosition] | None = port(
        None, "Minimum and maximum position of `joint`, in degrees or in meters"
    )
    lasting: Duration = port(0.0, "Time for which it must hold until the end of the run", le=3600.0)

    @model_validator(mode="after")
    def _is_complete(self) -> Self:
        if (self.object is None) == (self.tool is None):
            raise ValueError("give either an object or the tool of an arm")
        given = [name for name in CONDITIONS if getattr(self, name) is not None]
        if not given:
            raise ValueError(f"gives no condition: {', '.join(CONDITIONS)}")
        if self.object is None:
            for name in ("on", "held_by", "held", "joint"):
                if getattr(self, name) is not None:
                    raise ValueError(f"{name} is about an object, not about a tool")
        elif self.force is not None:
            raise ValueError("force is about the tool of an arm")
        if (self.joint is None) != (self.between is None):
            raise ValueError("joint and between go together: {joint: hinge, between: [80, 90]}")
        if self.between is not None and self.between[0] > self.between[1]:
            low, high = self.between
            raise ValueError(f"between goes from {low:g} down to {high:g}")
        if self.height is not None and self.height[0] > self.height[1]:
            raise ValueError(f"the height goes from {self.height[0]:g} down to {self.height[1]:g}")
        return self


Conditions: TypeAlias = Annotated[dict[Name, ConditionSpec], Field(max_length=100)]
"""Conditions by a name of the author's choice."""

SECTIONS: Final = ("goal", "always", "never")
"""Sections of a file that have conditions."""


def condition_problems(
    sections: Mapping[str, Mapping[str, ConditionSpec]],
    source: Source,
    cell: CellSpec,
    objects: frozenset[str],
    arms: frozenset[str],
) -> Iterator[Problem]:
    """Yields every name in the conditions that the file does not declare.

    Args:
        sections: Conditions by section and name.
        source: Source of the file.
        cell: Cell of the file, which declares the zones.
        objects: Names of the objects.
        arms: Names of the arms.
    """
    declared = {
        "object": ("object", objects),
        "tool": ("arm", arms),
        "in_zone": ("zone", frozenset(cell.zones)),
        "on": ("object", objects),
        "held_by": ("arm", arms),
        "distance_to": ("object or arm", objects | arms),
    }
    for section, conditions in sections.items():
        for name, condition in conditions.items():
            for field, (noun, names) in declared.items():
                given = getattr(condition, field)
                if given is not None and given not in names:
                    message = f"there is no {noun} '{given}'"
                    hint = suggestion(given, names, noun)
                    yield source.problem((section, name, field), message, hint)
            wanted = moved_name(condition.object or "", condition.joint or "")
            if condition.joint is not None and wanted not in objects:
                message = f"'{condition.object}' has no joint '{condition.joint}'"
                yield source.problem((section, name, "joint"), message)
            if section != "goal" and condition.lasting:
                message = "an invariant holds at all times: lasting is for goals"
                yield source.problem((section, name, "lasting"), message)
