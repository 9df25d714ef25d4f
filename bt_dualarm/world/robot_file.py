"""A robot's page in the catalogue: what its YAML file may say, and where it is wrong."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NoReturn, TypeAlias

import numpy as np
from pydantic import Field, ValidationError, model_validator

from bt_dualarm.errors import CatalogueError
from bt_dualarm.pose import Pose
from bt_dualarm.spec.explain import explain
from bt_dualarm.spec.problems import SpecError
from bt_dualarm.spec.reader import read_file
from bt_dualarm.spec.source import Path as Place
from bt_dualarm.spec.source import Source, with_tuples
from bt_dualarm.spec.values import Value, Vector3

_Positive: TypeAlias = Annotated[float, Field(gt=0.0)]
_Share: TypeAlias = Annotated[float, Field(ge=0.0, le=1.0)]
Color: TypeAlias = tuple[_Share, _Share, _Share, _Share]
"""Red, green, blue, opacity."""


@dataclass(frozen=True)
class ToolShape:
    """A cylinder along the tool's z axis: what the arm touches objects with. Metres."""

    radius: float
    length: float


class ToolEntry(Value):
    """The tool frame in its link, and a shape that ends in it; metres, degrees."""

    link: str
    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy: Vector3 = (0.0, 0.0, 0.0)
    radius: Annotated[float | None, Field(gt=0.0, le=0.5)] = None
    length: Annotated[float | None, Field(gt=0.0, le=1.0)] = None

    @property
    def pose(self) -> Pose:
        """The tool frame in its link."""
        roll, pitch, yaw = np.deg2rad(self.rpy)
        return Pose.from_rpy(self.xyz, (roll, pitch, yaw))

    @property
    def shape(self) -> ToolShape | None:
        """The shape, if there is one."""
        if self.radius is None or self.length is None:
            return None
        return ToolShape(self.radius, self.length)


class CameraEntry(Value):
    """A place for a camera on a link: where it is, where it looks, what is up in its image."""

    link: str
    xyz: Vector3
    forward: Vector3
    up: Vector3

    @model_validator(mode="after")
    def _spans_an_image(self) -> CameraEntry:
        if np.linalg.norm(np.cross(self.forward, self.up)) < 1e-6:
            raise ValueError("forward and up must be two different directions")
        return self

    @property
    def pose(self) -> Pose:
        """The camera in its link: x right, y down, z forward."""
        forward = np.asarray(self.forward) / np.linalg.norm(self.forward)
        right = np.cross(forward, self.up)
        right /= np.linalg.norm(right)
        matrix = np.eye(4)
        matrix[:3, :3] = np.column_stack((right, np.cross(forward, right), forward))
        matrix[:3, 3] = self.xyz
        return Pose.from_matrix(matrix)


class LimitEntry(Value):
    """One value for all joints or one for each, and who says so."""

    value: _Positive | tuple[_Positive, ...]
    source: Annotated[str, Field(min_length=8)]


class LimitsEntry(Value):
    """Limits in rad/s, rad/s², rad/s³ and N m; velocity and effort only where the URDF errs."""

    acceleration: LimitEntry
    jerk: LimitEntry
    velocity: LimitEntry | None = None
    effort: LimitEntry | None = None


class RobotEntry(Value):
    """A page of the catalogue.

    Attributes:
        urdf: In the example-robot-data package, or beside the page; likewise ``srdf``.
        joints: Of the arm, base to tip; all others are locked.
        locked: Where a sliding joint is locked if not at zero, metres.
        postures: Joint angles in degrees; ``home`` is required.
        exclude: Pairs of links whose contacts do not count, beside those of the SRDF.
    """

    title: str
    urdf: str
    srdf: str | None = None
    base_link: str
    tool: ToolEntry
    joints: Annotated[tuple[str, ...], Field(min_length=1)]
    locked: dict[str, float] = Field(default_factory=dict)
    limits: LimitsEntry
    postures: dict[str, tuple[float, ...]]
    cameras: dict[str, CameraEntry] = Field(default_factory=dict)
    exclude: tuple[tuple[str, str], ...] = ()
    colors: dict[str, Color] = Field(default_factory=dict)


class RobotFile:
    """A page that was read, and the text that messages point into.

    Raises:
        CatalogueError: Every place where the file is wrong.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._source: Source = read_file(path)
            self.entry = RobotEntry.model_validate(with_tuples(self._source.data))
        except SpecError as error:
            raise CatalogueError(str(error)) from error
        except ValidationError as error:
            data = self._source.data
            found = [
                self._source.problem(f.path, f.message, f.hint, key=f.at_key)
                for f in explain(error, RobotEntry, data, "field")
            ]
            raise CatalogueError("\n".join(str(problem) for problem in sorted(found))) from error

    def refuse(self, place: Place, message: str, hint: str = "") -> NoReturn:
        """Say what is wrong at a place of the file.

        Raises:
            CatalogueError: Always.
        """
        raise CatalogueError(str(self._source.problem(place, message, hint)))
