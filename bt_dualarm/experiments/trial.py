"""One run of one experiment, and what was measured in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from bt_dualarm.errors import DualArmError
from bt_dualarm.experiments.cases import TREE, Cell
from bt_dualarm.experiments.margins import Margins, MarginWatch
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.parts import Observer
from bt_dualarm.runtime.result import RunResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.runtime.shipped import find_tree
from bt_dualarm.runtime.signals import StopRequest
from bt_dualarm.skill.registry import Registry
from bt_dualarm.skill.scoring import lag
from bt_dualarm.spec.document import ObjectSpec, TreeFile
from bt_dualarm.spec.load import load_tree_file
from bt_dualarm.world.world import World

LEADER, FOLLOWER = "arm1", "arm2"


class TrialError(DualArmError):
    """A run came to no measurement; the message says what it ended with."""


@dataclass(frozen=True, eq=False)
class Trial:
    """One run of a cell, while the leading arm drew its curve.

    Attributes:
        seed: Seed of everything random.
        times: Seconds since the curve began, of shape (n,).
        planned: Planned position of the cube along the plane's axes, of shape (n, 2), in m.
        cube: True position of the cube along the same axes, of shape (n, 2), in m.
        tracked: Position of the following tool along the same axes, less its mean distance from
            the cube, of shape (n, 2), in m.
        lost_count: Number of times that the target was lost.
        frames: Number of images that were looked at: the waypoints of the follower.
        sighting_sd: Standard deviation of a single sighting along an axis, in m.
        margins: Distance of the follower from its limits.
        outcome: Outcome of the run.
        reason: Reason that the follower's leaf gave, if it failed.
        began: Simulated time in s at which the curve began.
        old_data_steps: Control steps that moved towards data older than 0.1 s.
    """

    seed: int
    times: Vector
    planned: Matrix
    cube: Matrix
    tracked: Matrix
    lost_count: int
    frames: int
    sighting_sd: float
    margins: Margins
    outcome: str
    reason: str = ""
    began: float = 0.0
    old_data_steps: int = 0

    @property
    def error(self) -> Vector:
        """Distance of the tool from the cube in the plane, of shape (n,), in m."""
        away: Vector = np.linalg.norm(self.tracked - self.cube, axis=1)
        return away

    @property
    def rms(self) -> float:
        """Root mean square of `error`, in m."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def lag(self) -> float:
        """Seconds by which the tool is late, by cross-correlation."""
        return lag(self.cube, self.tracked, float(np.median(np.diff(self.times))))

    @property
    def amplitude_ratio(self) -> float:
        """Spread of the tracked path over that of the true one; 1 if none is lost."""
        return float(np.sqrt(self.tracked.var(axis=0).sum() / self.cube.var(axis=0).sum()))

    @property
    def speed_rms(self) -> float:
        """Root mean square of the cube's speed, in m/s."""
        velocity = np.gradient(self.cube, self.times, axis=0)
        return float(np.sqrt(np.mean(np.sum(velocity**2, axis=1))))


def tree_file(cell: Cell, registry: Registry) -> TreeFile:
    """The tree file of a cell, with its settings.

    Raises:
        SpecError: The file refuses a setting.
    """
    return load_tree_file(find_tree(TREE), registry.kinds, cell.params)


def run_trial(
    cell: Cell,
    seed: int,
    registry: Registry,
    objects: Mapping[str, ObjectSpec] | None = None,
    meddler: Callable[[World], Observer] | None = None,
    stop: StopRequest | None = None,
) -> Trial:
    """Run a cell once.

    Args:
        cell: Settings of the experiment.
        seed: Seed of everything random.
        registry: Installed skills.
        objects: Objects of the world besides those of the tree file.
        meddler: Maker of an observer that may reach into the world: to cover or distract.
        stop: Request to end early; nothing that is measured then is worth anything.

    Raises:
        TrialError: The curve was not drawn, or not followed at all.
        DualArmError: The file or the renderer cannot be used.
    """
    file = tree_file(cell, registry)
    file = file.model_copy(update={"objects": {**file.objects, **(objects or {})}})
    options = RunOptions(seed=seed, renderer=cell.renderer, reality=cell.reality)
    with Run(file, registry, options, stop=stop) as run:
        watch = MarginWatch(run.world, FOLLOWER)
        run.watch(watch)
        if meddler is not None:
            run.watch(meddler(run.world))
        return _trial(cell, run.finish(), watch.margins)


def _trial(cell: Cell, result: RunResult, margins: Margins) -> Trial:
    series = {
        (one.arm, one.name): one
        for arm in result.arms.values()
        for of_leaf in arm.series.values()
        for one in of_leaf.values()
    }
    try:
        plan = series[LEADER, "planned"]
        target, tracked = series[FOLLOWER, "target"], series[FOLLOWER, "tracked"]
    except KeyError as missing:
        reasons = "; ".join(
            run.reason for arm in result.arms.values() for run in arm.runs if run.reason
        )
        raise TrialError(f"nothing to measure, {missing} is missing: {reasons}") from None
    begin, end = plan.time[0], plan.time[-1]
    during = (target.time >= begin) & (target.time <= end)
    if during.sum() < 3:
        raise TrialError(f"the target was followed for {during.sum()} of {len(during)} samples")
    times = target.time[during]
    cube, tool = target.values[during] @ cell.axes.T, tracked.values[during] @ cell.axes.T
    planned = np.column_stack([np.interp(times, plan.time, c) for c in cell.axes @ plan.values.T])
    leaf = result.arms[FOLLOWER].runs[0]
    return Trial(
        seed=result.seed,
        times=times - begin,
        planned=planned - (planned - cube).mean(axis=0),
        cube=cube,
        tracked=tool - (tool - cube).mean(axis=0),
        lost_count=int(leaf.metrics["lost_count"]),
        frames=int(leaf.metrics["frames"]),
        sighting_sd=float(leaf.metrics["sighting_sd_m"]),
        margins=margins,
        outcome=str(result.outcome),
        reason=leaf.reason,
        began=float(begin),
        old_data_steps=int(leaf.metrics["old_data_steps"]),
    )
