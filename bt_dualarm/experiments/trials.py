"""The experiments: their settings, their runs in parallel processes, and the measurements."""

from __future__ import annotations

import os
import shlex
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import cache
from multiprocessing import get_context
from multiprocessing.connection import Connection
from threading import Thread
from typing import Final, Literal, TypeAlias

import numpy as np

from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.runtime.arm_runtime import IdleObserver, Observer
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.runtime.options import RunOptions, find_tree
from bt_dualarm.runtime.outcome import RunResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry
from bt_dualarm.skill.scoring import lag
from bt_dualarm.spec.document import ObjectSpec, RealityName, TreeFile
from bt_dualarm.spec.values import Plane
from bt_dualarm.spec.yaml_reader import read_text, with_tuples

CurveName: TypeAlias = Literal["circle", "lissajous", "drawn"]
ControllerName: TypeAlias = Literal["proportional", "predictive"]
RendererName: TypeAlias = Literal["gl", "ray"]

TREE: Final = "experiments/tracking"
"""Name of the tree file that all experiments share."""

CASES: Final[tuple[tuple[CurveName, float], ...]] = (
    ("circle", 0.5),
    ("circle", 1.0),
    ("lissajous", 0.2),
    ("lissajous", 0.5),
    ("lissajous", 1.0),
)
"""Curve and speed of the five experiments."""

_TUNED_AT_HZ: Final = (30.0, 60.0)
"""Frame rates at which gains were swept."""

GAINS: Final[Mapping[CurveName, Mapping[float, tuple[float, float]]]] = {
    "circle": {0.5: (2.25, 3.0), 1.0: (2.25, 3.25)},
    "lissajous": {0.2: (1.5, 2.0), 0.5: (1.75, 2.5), 1.0: (2.25, 3.25)},
    "drawn": {1.0: (2.25, 3.25)},
}
"""The best constant gain of proportional control, by curve and speed, at 30 and at 60 Hz.

A gain is the ratio of the commanded step to the error in the image; it exceeds one, because the arm
completes only a part of a step before the next image. Values are from
``benchmarks/proportional_gain.py``; a change of 25 % costs a few percent. The
curve drawn by hand has the others' gain at full speed.
"""

JERK: Final = 0.4
"""Fraction of its jerk limit that the leading arm uses; see docs/tracking.md for the reason.

Relative to the catalog's 100 rad/s³; Universal Robots publishes no jerk limit.
"""

_HALF_IMAGE: Final = (0.2176, 0.1632)
"""Half width and height in m of the image plane at 0.35 m, for a field of view of 50° and 4:3."""

_AXES: Final = {(1.0, 0.0, 0.0): "x", (0.0, 1.0, 0.0): "y", (0.0, 0.0, 1.0): "z"}


@dataclass(frozen=True)
class Cell:
    """One experiment with all its settings; repetitions differ in their seed.

    Attributes:
        case: Name of the curve.
        speed: Fraction of its limits that the leading arm uses.
        controller: Controller of the following arm.
        renderer: Renderer of its camera.
        fps: Frames a second.
        latency: Time from exposure to delivery of a frame in s; None for one frame period.
        drop: Fraction of lost frames.
        noise: Camera shake, standard deviation in px.
        jerk: Fraction of its jerk limit that the leading arm uses.
        reality: Model mismatch of both arms.
        more: Further parameters of the tree file.
        label: Name in tables; by default curve and speed.
    """

    case: CurveName
    speed: float
    controller: ControllerName = "predictive"
    renderer: RendererName = "ray"
    fps: float = 60.0
    latency: float | None = None
    drop: float = 0.0
    noise: float = 0.0
    jerk: float = JERK
    reality: RealityName = "lab"
    more: Mapping[str, str] = field(default_factory=dict)
    label: str = ""

    @property
    def name(self) -> str:
        """The cell's name in tables."""
        return self.label or f"{self.case} {self.speed:g}"

    @property
    def axes(self) -> Matrix:
        """Axes of the plane as rows, of shape (2, 3), in the world."""
        notation = read_text(self.more.get("plane", "yz")).data
        return np.array(Plane.model_validate(with_tuples(notation)).axes)

    @property
    def axis_names(self) -> tuple[str, str]:
        """Names of `axes`: those of world axes, otherwise u and v."""
        names = [_AXES.get(tuple(np.round(axis, 9))) for axis in self.axes.tolist()]
        return names[0] or "u", names[1] or "v"

    @property
    def latency_s(self) -> float:
        """Seconds from a frame's exposure to its delivery."""
        return 1.0 / self.fps if self.latency is None else self.latency

    @property
    def params(self) -> dict[str, str]:
        """Parameters of the tree file, as on a command line."""
        settings: dict[str, object] = {
            "case": self.case,
            "speed": self.speed,
            "jerk": self.jerk,
            "controller": self.controller,
            "fps": self.fps,
            "latency": round(self.latency_s, 6),
            "drop": self.drop,
            "noise": self.noise,
        }
        if self.controller == "proportional":
            settings |= gain_params(best_gain(self.case, self.speed, self.fps))
        return {name: f"{value}" for name, value in settings.items()} | dict(self.more)

    def command(self, seed: int) -> str:
        """Command that repeats this run."""
        settings = (f"{name}={value}" for name, value in self.params.items())
        params = " ".join(f"--param {shlex.quote(setting)}" for setting in settings)
        options = f"--renderer {self.renderer} --reality {self.reality} --seed {seed}"
        return f"bt-run {TREE} {options} {params}"


def best_gain(case: CurveName, speed: float, fps: float) -> float:
    """The best constant gain of proportional control: from the table, interpolated linearly."""
    tuned = GAINS[case]
    at_rate = [float(np.interp(fps, _TUNED_AT_HZ, gains)) for gains in tuned.values()]
    return float(np.interp(speed, list(tuned), at_rate))


def gain_params(gain: float) -> dict[str, str]:
    """Parameters of the tree file for a step of ``gain`` times the error in the image."""
    return {"gain_u": f"{gain * _HALF_IMAGE[0]}", "gain_v": f"{gain * _HALF_IMAGE[1]}"}


UNTUNED: Final[tuple[Cell, ...]] = (
    Cell("circle", 1.0, label="circle of 60 mm", more={"radius": "0.06"}),
    Cell(
        "circle",
        1.0,
        label="circle elsewhere",
        more={
            "cube": "{xyz: [0.68, 0.17, 0.751]}",
            "stand": "{xyz: [0.68, 0.17, 0.388]}",
        },
    ),
    Cell(
        "circle",
        1.0,
        label="circle in XZ",
        more={
            "plane": "xz",
            "cube": "{xyz: [-0.11, 0.686, 0.701], rpy: [0, 0, 90]}",
            "stand": "{xyz: [-0.11, 0.686, 0.338], rpy: [0, 0, 90]}",
            "approach": "[0, 1, 0]",
            "leader": "{xyz: [0, 0, 0.40], rpy: [0, 0, 90]}",
            "follower": "{xyz: [-0.11, 1.60, 0.28], rpy: [0, 0, -90]}",
        },
    ),
    Cell(
        "lissajous",
        1.0,
        label="lissajous 3:2",
        more={"a": "3", "b": "2", "turns": "1", "waypoints": "60"},
    ),
    Cell("drawn", 1.0, label="drawn by hand", more={"turns": "2"}),
)
"""Five curves at full speed that were not used to tune filter or gains."""


# Margins of an arm to its limits.


@dataclass(frozen=True)
class Margins:
    """Worst margins of the measured state over all joints and times.

    Set-points respect every limit; a measured acceleration may briefly exceed its own.

    Attributes:
        position_rad: Distance from a position limit in rad.
        velocity: Largest velocity as a fraction of its limit.
        acceleration: Largest acceleration as a fraction of its limit.
    """

    position_rad: float
    velocity: float
    acceleration: float


class MarginWatch(IdleObserver):
    """Observer of one arm at every step.

    Args:
        world: World of the run.
        arm: Name of the arm.
    """

    def __init__(self, world: World, arm: str) -> None:
        self._world = world
        self._arm = arm
        self._room = np.inf
        self._velocity = 0.0
        self._acceleration = 0.0

    @property
    def margins(self) -> Margins:
        """Worst margins so far."""
        return Margins(float(self._room), float(self._velocity), float(self._acceleration))

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the world has the state
        """Compare the measured state with the limits."""
        body = self._world.arms.get(self._arm)
        if body is None:
            return
        limits = body.robot.limits
        q = body.q
        self._room = min(self._room, np.minimum(q - limits.lower, limits.upper - q).min())
        self._velocity = max(self._velocity, (np.abs(body.v) / limits.velocity).max())
        acceleration = np.abs(self._world.data.qacc[body.dof_ids]) / limits.acceleration
        self._acceleration = max(self._acceleration, acceleration.max())


# One run of one experiment, and its measurements.


LEADER = "arm1"
FOLLOWER = "arm2"


class TrialError(DualArmError):
    """A run gave no measurement; the message states how it ended."""


@dataclass(frozen=True, eq=False)
class Trial:
    """One run of a cell, while the leading arm drew its curve.

    Attributes:
        seed: Random seed.
        times: Seconds since the curve began, of shape (n,).
        planned: Planned position of the cube along the plane's axes, of shape (n, 2), in m.
        cube: True position of the cube along the same axes, of shape (n, 2), in m.
        tracked: Position of the following tool along the same axes, less its mean distance from
            the cube, of shape (n, 2), in m.
        lost_count: Number of times that the target was lost.
        frames: Number of processed images: the waypoints of the follower.
        sighting_sd: Standard deviation of a single sighting along an axis, in m.
        margins: Distance of the follower from its limits.
        outcome: Outcome of the run.
        reason: Reason of the follower's leaf, if it failed.
        began: Simulated time in s at which the curve began.
        old_data_steps: Control steps that moved toward data older than 0.1 s.
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
        """Delay of the tool in s, by cross-correlation."""
        return lag(self.cube, self.tracked, float(np.median(np.diff(self.times))))

    @property
    def amplitude_ratio(self) -> float:
        """Ratio of the extent of the tracked path to that of the true one; ideally 1."""
        return float(np.sqrt(self.tracked.var(axis=0).sum() / self.cube.var(axis=0).sum()))

    @property
    def speed_rms(self) -> float:
        """Root mean square of the cube's speed, in m/s."""
        velocity = np.gradient(self.cube, self.times, axis=0)
        return float(np.sqrt(np.mean(np.sum(velocity**2, axis=1))))


def tree_file(cell: Cell, registry: Registry) -> TreeFile:
    """The tree file of a cell, with its settings.

    Raises:
        SpecError: The file rejects a setting.
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
        seed: Random seed.
        registry: Installed skills.
        objects: Objects in addition to those of the tree file.
        meddler: Factory of an observer that may change the world, such as by occlusions or decoys.
        stop: Request to end early; measurements after it are invalid.

    Raises:
        TrialError: The curve was not executed, or not followed at all.
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
        target = series[FOLLOWER, "target"]
        tracked = series[FOLLOWER, "tracked"]
    except KeyError as missing:
        reasons = "; ".join(
            run.reason for arm in result.arms.values() for run in arm.runs if run.reason
        )
        raise TrialError(f"nothing to measure: {missing} is missing: {reasons}") from None
    begin = plan.time[0]
    end = plan.time[-1]
    during = (target.time >= begin) & (target.time <= end)
    if during.sum() < 3:
        raise TrialError(f"the target was followed for {during.sum()} of {len(during)} samples")
    times = target.time[during]
    cube = target.values[during] @ cell.axes.T
    tool = tracked.values[during] @ cell.axes.T
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


# Trials of many cells, in parallel processes if requested.


_LOOK_S: Final = 0.1
"""Polling period of the request to end, while other processes compute, s."""


def usable_cores() -> int:
    """Number of parallel processes for this machine."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def run_trials(
    runs: Sequence[tuple[Cell, int]],
    registry: Registry,
    jobs: int = 1,
    stop: StopRequest | None = None,
) -> Iterator[Trial | TrialError]:
    """Yields the trial of each cell and seed as it completes, or the reason why there is none.

    Args:
        runs: Pairs of a cell and a seed.
        registry: Installed skills; other processes find them again.
        jobs: Number of parallel processes; with one, no other process is started.
        stop: Request to end early; incomplete trials are not yielded.

    Raises:
        DualArmError: A file or the renderer cannot be used, or a process has died.
    """
    request = stop or StopRequest()
    if jobs == 1 or len(runs) < 2:
        for cell, seed in runs:
            trial = _tried(cell, seed, registry, request)
            if request.asked:
                return
            yield trial
    else:
        yield from _side_by_side(runs, min(jobs, len(runs)), request)


def _side_by_side(
    runs: Sequence[tuple[Cell, int]], jobs: int, stop: StopRequest
) -> Iterator[Trial | TrialError]:
    """The same in worker processes that end with this one, however it ends."""
    context = get_context("spawn")
    theirs, ours = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(jobs, context, _end_with_parent, (theirs,))
    try:
        coming = [pool.submit(_tried_elsewhere, cell, seed) for cell, seed in runs]
        for trial in coming:
            while not wait([trial], _LOOK_S).done:
                if stop.asked:
                    return
            yield _outcome(trial)
        pool.shutdown()
    finally:
        ours.close()
        pool.shutdown(cancel_futures=True)


def _outcome(trial: Future[Trial | TrialError]) -> Trial | TrialError:
    try:
        return trial.result()
    except BrokenProcessPool as error:
        words = "a worker process died; --jobs 1 runs all experiments in this process"
        raise DualArmError(words) from error


def _end_with_parent(parent: Connection) -> None:
    """End this process when the other end of a pipe is closed, as when the parent is killed.

    Processes of the pool would otherwise wait for work forever. Ctrl-C reaches all
    processes of a terminal; the parent handles it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_wait_for_end, args=(parent,), daemon=True).start()


def _wait_for_end(parent: Connection) -> None:
    parent.poll(None)
    os.kill(os.getpid(), signal.SIGKILL)


@cache
def _registry() -> Registry:
    """One a process."""
    return Registry.load()


def _tried_elsewhere(cell: Cell, seed: int) -> Trial | TrialError:
    """A trial in a worker process; errors are converted to types that can be pickled."""
    try:
        return _tried(cell, seed, _registry(), StopRequest())
    except DualArmError as error:
        raise DualArmError(str(error)) from None


def _tried(cell: Cell, seed: int, registry: Registry, stop: StopRequest) -> Trial | TrialError:
    """A trial, or the reason why there is none."""
    try:
        return run_trial(cell, seed, registry, stop=stop)
    except TrialError as error:
        return error
