"""Where every tool and every object was, sampled while the run goes on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

import mujoco
import numpy as np

from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.runtime.schedule import Periodic, exact

SAMPLE_PERIOD = Fraction(1, 100)
"""Seconds between two samples."""

MOST_POINTS = 1 << 17
"""Positions that are kept for pictures: four minutes of eight things, or less."""

_FEWEST = 4
"""Things for which each sample counts, however few there are."""


class TrackedArm(Protocol):
    """What is read of an arm."""

    @property
    def tool_site(self) -> int:
        """Id of the tool's frame among the model's sites."""

    @property
    def base(self) -> Pose:
        """Pose of its base in the world."""


class SampledWorld(Protocol):
    """What is read of the world."""

    data: mujoco.MjData

    @property
    def arms(self) -> Mapping[str, TrackedArm]:
        """Arms that are present, by name."""

    @property
    def objects(self) -> Mapping[str, object]:
        """Objects that are present, by name."""

    @property
    def generation(self) -> int:
        """Grows when things came or went: ids are to be looked up again."""

    @property
    def time(self) -> float:
        """Simulated time in seconds."""

    @property
    def timestep(self) -> float:
        """Seconds of one step."""

    def object_body(self, name: str) -> int:
        """Id of an object's body."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Where all things were at one time.

    Attributes:
        time: Simulated time in seconds.
        names: ``tool_<arm>`` and ``object_<name>`` of the things in the world.
        points: Their positions in the world, of shape (n, 3), m.
    """

    time: float
    names: tuple[str, ...]
    points: Matrix

    def point(self, name: str) -> Vector | None:
        """Position of one thing, of shape (3,), m; None if it was not in the world."""
        return self.points[self.names.index(name)] if name in self.names else None


class Tracks:
    """World positions of tools and objects at 100 Hz of simulated time, thinned for pictures.

    What it keeps is bounded: of a long run every second sample, every fourth, and so on.

    Args:
        world: The world, whose things may come and go.

    Attributes:
        bases: Positions of the arms that were seen, in metres in the world, each of shape (3,).
    """

    def __init__(self, world: SampledWorld) -> None:
        self._world = world
        self._due = Periodic(SAMPLE_PERIOD, exact(world.timestep))
        self._steps = 0
        self._bound_to = -1
        self._names: tuple[str, ...] = ()
        self._sites: list[int] = []
        self._bodies: list[int] = []
        self._kept: list[Sample] = []
        self._seen, self._stride = 0, 1
        self.bases: dict[str, Vector] = {}

    def after_step(self) -> Sample | None:
        """Take a sample if one is due."""
        due = self._due.due(self._steps)
        self._steps += 1
        if not due:
            return None
        if self._bound_to != self._world.generation:
            self._bind()
        data = self._world.data
        points = np.concatenate([data.site_xpos[self._sites], data.xpos[self._bodies]])
        # After a step the positions are those that the step began with.
        sample = Sample(self._world.time - self._world.timestep, self._names, points)
        self._keep(sample)
        return sample

    @property
    def time(self) -> Vector:
        """Simulated seconds of the samples that are kept, of shape (n,)."""
        return np.array([sample.time for sample in self._kept])

    def positions(self) -> dict[str, Matrix]:
        """Metres in the world, each of shape (n, 3), NaN where a thing was not in the world.

        Keys are ``tool_<arm>`` and ``object_<name>``, in the order in which they were first seen.
        """
        found: dict[str, Matrix] = {}
        for row, sample in enumerate(self._kept):
            for name, point in zip(sample.names, sample.points, strict=True):
                if name not in found:
                    found[name] = np.full((len(self._kept), 3), np.nan)
                found[name][row] = point
        return found

    def _keep(self, sample: Sample) -> None:
        if self._seen % self._stride == 0:
            self._kept.append(sample)
        self._seen += 1
        if len(self._kept) * max(len(sample.names), _FEWEST) > MOST_POINTS:
            self._kept = self._kept[::2]
            self._stride *= 2

    def _bind(self) -> None:
        world = self._world
        self._bound_to = world.generation
        self._sites = [body.tool_site for body in world.arms.values()]
        self.bases |= {name: body.base.position for name, body in world.arms.items()}
        self._bodies = [world.object_body(name) for name in world.objects]
        self._names = (
            *(f"tool_{name}" for name in world.arms),
            *(f"object_{name}" for name in world.objects),
        )
