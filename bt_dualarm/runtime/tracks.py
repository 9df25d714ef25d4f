"""Where every tool and every object was, sampled while the run goes on."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Protocol

import mujoco
import numpy as np

from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.runtime.schedule import Periodic, exact

SAMPLE_PERIOD = Fraction(1, 100)
"""Seconds between two samples."""


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


class Tracks:
    """World positions of tools and objects at 100 Hz of simulated time.

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
        self._samples: list[tuple[float, tuple[str, ...], Matrix]] = []
        self.bases: dict[str, Vector] = {}

    def after_step(self) -> None:
        """Take a sample if one is due."""
        due = self._due.due(self._steps)
        self._steps += 1
        if not due:
            return
        if self._bound_to != self._world.generation:
            self._bind()
        data = self._world.data
        points = np.concatenate([data.site_xpos[self._sites], data.xpos[self._bodies]])
        # After a step the positions are those that the step began with.
        self._samples.append((self._world.time - self._world.timestep, self._names, points))

    @property
    def time(self) -> Vector:
        """Simulated seconds of the samples, of shape (n,)."""
        return np.array([time for time, _, _ in self._samples])

    def positions(self) -> dict[str, Matrix]:
        """Metres in the world, each of shape (n, 3), NaN where a thing was not in the world.

        Keys are ``tool_<arm>`` and ``object_<name>``, in the order in which they were first seen.
        """
        found: dict[str, Matrix] = {}
        for row, (_, names, points) in enumerate(self._samples):
            for name, point in zip(names, points, strict=True):
                if name not in found:
                    found[name] = np.full((len(self._samples), 3), np.nan)
                found[name][row] = point
        return found

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
