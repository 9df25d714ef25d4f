"""Quantities over time: series measured by skills, and sampled tracks of tools and objects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.runtime.clock import Periodic, exact
from bt_dualarm.skill.skill import Samples

MOST_SAMPLES = 1 << 15
"""Largest number of samples kept per series: two minutes at 250 Hz."""


@dataclass(frozen=True, eq=False, repr=False)
class Series:
    """One quantity of one leaf over time; beyond 32,768 samples it is thinned by powers of two.

    Attributes:
        arm: Name of the arm.
        leaf: Path of the leaf in its tree.
        name: ``planned``, ``executed``, ``target``, ... for positions; a scalar's name ends with
            its unit (``error_m``, ``offset_px``). If a leaf has a scalar whose name begins with
            ``error``, plots show no other distance.
        time: Simulated seconds, of shape (n,).
        values: Positions in the world in meters, of shape (n, 3); or scalars, of shape (n, 1).
    """

    arm: str
    leaf: str
    name: str
    time: Vector
    values: Matrix

    @property
    def is_position(self) -> bool:
        """Whether the values are positions in the world rather than scalars."""
        return int(self.values.shape[1]) == 3

    def __repr__(self) -> str:
        return f"<Series {self.arm}:{self.leaf} {self.name}, {len(self.time)} samples>"


class SeriesLog:
    """All series of a run, in the order of their first samples."""

    def __init__(self) -> None:
        self._series: dict[tuple[str, str, str], _Samples] = {}

    def add(
        self, arm: str, leaf: str, name: str, time: npt.ArrayLike, values: npt.ArrayLike
    ) -> None:
        """Add one sample or n samples to a series, which is created with its first sample.

        Args:
            arm: Name of the arm.
            leaf: Path of the leaf in its tree.
            name: Name of the series, as in `Series`.
            time: Simulated seconds, a number or of shape (n,).
            values: A number or a point of shape (3,); or of shape (n,) or (n, 3).

        Raises:
            SkillError: The shapes do not match, or the times do not follow the earlier samples.
        """
        samples = Samples.of(name, time, values)
        if len(samples.time):
            key = (arm, leaf, name)
            series = self._series.get(key) or _Samples(name)
            series.add(samples)
            self._series[key] = series  # only now, so that every series has a sample

    def __iter__(self) -> Iterator[Series]:
        for key, samples in self._series.items():
            yield Series(*key, *samples.arrays())

    def of(self, arm: str) -> dict[str, dict[str, Series]]:
        """Series of one arm, by leaf and by name."""
        found: dict[str, dict[str, Series]] = {}
        for series in self:
            if series.arm == arm:
                found.setdefault(series.leaf, {})[series.name] = series
        return found


class _Samples:
    """Growing samples of a series, thinned when they become too many.

    Args:
        name: Name of the series.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._rows = np.empty((0, 0))
        self._kept = 0
        self._seen = 0
        self._stride = 1
        self._last = 0.0

    def add(self, samples: Samples) -> None:
        """Add samples.

        Raises:
            SkillError: The samples do not match the earlier ones.
        """
        if self._seen:
            samples.refuse_after(self._name, self._last, self._rows.shape[1] - 1)
        self._last = float(samples.time[-1])
        rows = np.column_stack((samples.time, samples.values))
        first = -self._seen % self._stride
        self._seen += len(rows)
        self._append(rows[first :: self._stride])

    def arrays(self) -> tuple[Vector, Matrix]:
        rows = self._rows[: self._kept]
        return rows[:, 0].copy(), rows[:, 1:].copy()

    def _append(self, rows: Matrix) -> None:
        needed = self._kept + len(rows)
        if needed > len(self._rows):
            grown = np.empty((max(needed, 2 * len(self._rows)), rows.shape[1]))
            if self._kept:
                grown[: self._kept] = self._rows[: self._kept]
            self._rows = grown
        self._rows[self._kept : needed] = rows
        self._kept = needed
        while self._kept > MOST_SAMPLES:
            self._rows = self._rows[: self._kept : 2].copy()
            self._kept = len(self._rows)
            self._stride *= 2


SAMPLE_PERIOD = Fraction(1, 100)
"""Seconds between two samples."""

MOST_POINTS = 1 << 17
"""Largest number of positions kept for plots: four minutes of eight objects."""

_FEWEST = 4
"""Smallest number of positions that a sample counts as, because samples also have a fixed cost."""


class TrackedArm(Protocol):
    """Arm, as its track is sampled."""

    @property
    def tool_site(self) -> int:
        """Id of the tool's frame among the model's sites."""

    @property
    def base(self) -> Pose:
        """Pose of its base in the world."""


class SampledWorld(Protocol):
    """The world, as tracks are sampled."""

    data: mujoco.MjData

    @property
    def arms(self) -> Mapping[str, TrackedArm]:
        """Arms that are present, by name."""

    @property
    def objects(self) -> Mapping[str, object]:
        """Objects that are present, by name."""

    @property
    def generation(self) -> int:
        """Number that grows when the model is recompiled, which invalidates ids."""

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
    """Positions of all tools and objects at one time.

    Attributes:
        time: Simulated time in seconds.
        names: ``tool_<arm>`` and ``object_<name>`` of the arms and objects that are present.
        points: Their positions in the world, of shape (n, 3), m.
    """

    time: float
    names: tuple[str, ...]
    points: Matrix

    def point(self, name: str) -> Vector | None:
        """Position of one tool or object, of shape (3,), m; None if it was not in the world."""
        return self.points[self.names.index(name)] if name in self.names else None


class Tracks:
    """World positions of tools and objects at 100 Hz of simulated time, thinned for plots.

    Its memory is bounded: in a long run it keeps every second sample, then every fourth, and so on.

    Args:
        world: The world, in which arms and objects may appear and disappear.

    Attributes:
        bases: Base positions of all arms so far in the world, each of shape (3,), m.
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
        self._seen = 0
        self._stride = 1
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
        # After a step, MuJoCo's Cartesian positions are those of the start of the step.
        sample = Sample(self._world.time - self._world.timestep, self._names, points)
        self._keep(sample)
        return sample

    @property
    def time(self) -> Vector:
        """Simulated seconds of the samples that are kept, of shape (n,)."""
        return np.array([sample.time for sample in self._kept])

    def positions(self) -> dict[str, Matrix]:
        """Positions in the world, each of shape (n, 3), m, NaN while an object was not present.

        Keys are ``tool_<arm>`` and ``object_<name>``, in the order of first appearance.
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
