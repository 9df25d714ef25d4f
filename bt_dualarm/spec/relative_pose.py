"""Poses relative to what an arm knows, and the types of ports that take a pose.

A tree file may give a pose in the world, `PoseSpec`, or relative to an object, an arm or the tool,
`RelativePose`. A leaf resolves a relative pose when it starts, so a skill only ever receives a
`PoseSpec`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Final, Literal, TypeAlias

import numpy as np
from pydantic import ConfigDict, Discriminator, Tag, ValidationError, model_validator

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.spec.node_types import port
from bt_dualarm.spec.problems import meant_by, nearest
from bt_dualarm.spec.values import Goal, Point, PoseSpec, Refers, Turn, Value
from bt_dualarm.spec.yaml_reader import Data, Json, with_tuples

FRAME_WORDS: Final = ("tool", "base")
"""Words of ``in_frame``: the tool and the base of the arm that runs the leaf."""

RELATIONS: Final = ("above", "on", "beside", "in_frame")
"""Fields of which a relative pose has exactly one."""

ThingOrPart: TypeAlias = Annotated[str, Refers(("object", "object part"))]
"""Name of an object, or of a part of one: ``OBJECT.PART``."""

Side: TypeAlias = Literal["+x", "-x", "+y", "-y"]


def _with_one_relation(schema: Json) -> None:
    schema["anyOf"] = [{"required": [name]} for name in RELATIONS]


class RelativePose(Value):
    """Pose relative to an object, an arm or the tool, by what the arm knows when a leaf starts."""

    model_config = ConfigDict(json_schema_extra=_with_one_relation)

    above: ThingOrPart | None = port(
        None, "Object, or part of one (`OBJECT.PART`), above whose top it is, by the distance `by`"
    )
    on: ThingOrPart | None = port(
        None, "Object, or part of one, on whose top it is, or on whose inner floor"
    )
    beside: ThingOrPart | None = port(
        None, "Object, or part of one, beside which it is, on its side `side`, at the same height"
    )
    in_frame: Annotated[str, Refers(("object", "arm", "object part"), FRAME_WORDS)] | None = port(
        None,
        "Frame of `xyz` and of the orientation: `tool`, `base`, an object, a part of one "
        "(`OBJECT.PART`), or an arm's base",
    )
    side: Side | None = port(None, "Side for `beside`, along an axis of the world")
    by: float = port(
        0.0,
        "Distance for `above` and `beside`, between the two surfaces: a tool counts as a point",
        unit="m",
        ge=0.0,
        le=10.0,
    )
    xyz: Point = port(
        (0.0, 0.0, 0.0),
        "Position in the frame of `in_frame`; otherwise an offset along the world's axes",
        unit="m",
    )
    rpy: tuple[Turn, Turn, Turn] | None = port(
        None,
        "Roll, pitch, yaw about the fixed axes x, y, z of the frame of `in_frame`, otherwise of "
        "the world; by default the current orientation",
        unit="deg",
    )
    quat: tuple[float, float, float, float] | None = port(
        None, "Quaternion w, x, y, z of unit length instead of `rpy`"
    )

    @model_validator(mode="after")
    def _has_one_relation(self) -> RelativePose:
        given = [name for name in RELATIONS if getattr(self, name) is not None]
        if len(given) != 1:
            here = f"given: {' and '.join(given)}" if given else "none is given"
            raise ValueError(f"give exactly one of: {', '.join(RELATIONS)}; {here}")
        if self.beside is not None and self.side is None:
            raise ValueError("'side' is missing: beside an object, on its side +x, -x, +y or -y")
        if self.beside is None and self.side is not None:
            raise ValueError("'side' goes with 'beside'")
        if self.by and self.above is None and self.beside is None:
            hint = ": above an object, write 'above'" if self.on is not None else ""
            raise ValueError(f"'by' goes with 'above' or 'beside'{hint}")
        # One notation of the orientation, of the right length, as for every pose.
        PoseSpec(xyz=self.xyz, rpy=self.rpy, quat=self.quat)
        return self

    @property
    def reference(self) -> str:
        """Name of the object, arm, tool or base to which it is relative."""
        return self.above or self.on or self.beside or self.in_frame or ""

    @property
    def direction(self) -> Vector:
        """Unit vector in the world, of shape (3,), from the reference object to the position."""
        if self.side is None:
            return np.array((0.0, 0.0, 1.0))
        axis = np.eye(3)["xy".index(self.side[1])]
        sign = -1.0 if self.side[0] == "-" else 1.0
        return np.asarray(sign * axis, float)

    @property
    def is_oriented(self) -> bool:
        """Whether an orientation is given."""
        return self.rpy is not None or self.quat is not None

    @property
    def local(self) -> Pose:
        """Position and orientation as given, without what they are relative to."""
        return PoseSpec(xyz=self.xyz, rpy=self.rpy, quat=self.quat).pose


_OWN_WORDS: Final = tuple(RelativePose.model_fields.keys() - PoseSpec.model_fields.keys())


def _notation(value: object) -> str:
    """Returns the discriminator of a pose: ``relative``, or ``pose`` for one in the world."""
    if isinstance(value, RelativePose):
        return "relative"
    if not isinstance(value, dict):
        return "pose"
    unknown = value.keys() - PoseSpec.model_fields.keys()
    # A misspelled word decides as well, so that the message suggests the right one.
    words = {*_OWN_WORDS, *PoseSpec.model_fields}
    is_relative = any(
        nearest(str(name), words) in _OWN_WORDS or meant_by(str(name), _OWN_WORDS)
        for name in unknown
    )
    return "relative" if is_relative else "pose"


@dataclass(frozen=True)
class PoseOf:
    """Metadata of a port with a pose in the world, which may be given relative to something.

    Attributes:
        what: What has this pose: ``"tool"``; ``"held"``, the held object that the port ``object``
            names, by default the only one; ``"object"``, the object that this port names; or
            ``"point"``, of which only the position counts.
    """

    what: Literal["tool", "held", "object", "point"]


if TYPE_CHECKING:
    # What a skill receives: its leaf has resolved the relative ones.
    WorldPose: TypeAlias = PoseSpec
else:
    WorldPose = Annotated[
        Annotated[PoseSpec, Tag("pose")] | Annotated[RelativePose, Tag("relative")],
        Discriminator(_notation),
    ]
"""A pose in the world, or one relative to what the arm knows."""

ToolPose: TypeAlias = Annotated[WorldPose, PoseOf("tool"), Goal()]
"""Target pose of the tool in the world; the check warns if it is out of reach."""

CarriedPose: TypeAlias = Annotated[WorldPose, PoseOf("held"), Goal(carried=True)]
"""Target pose of a held object in the world; the check warns if it is out of reach."""

ObjectPose: TypeAlias = Annotated[WorldPose, PoseOf("object")]
"""Pose in the world of the object that the port ``object`` names."""

PointPose: TypeAlias = Annotated[WorldPose, PoseOf("point")]
"""Pose in the world of which only the position counts."""


def relative_pose(value: Data) -> RelativePose | None:
    """Returns a pose in YAML notation if it is a valid relative one, else None."""
    if not isinstance(value, dict) or _notation(value) != "relative":
        return None
    try:
        return RelativePose.model_validate(with_tuples(value))
    except ValidationError:
        return None
