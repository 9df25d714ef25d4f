"""Memory and CPU time of long runs with a record.

    python -m benchmarks.long_runs [--minutes 10 100] [--record-minutes 10 100 1000] [--seed 0]

First whole runs, each in a fresh process: an arm picks a cube, carries it, moves it along a circle
and puts it down, repeatedly. Then the recorder alone, with the data that a run of the given length
would produce: samples, series, attachments and events.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import bt_dualarm as bt
from bt_dualarm.behaviors.report import StatusChange
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.runtime.observations import StateLog
from bt_dualarm.runtime.outcome import ArmResult, Ending, Outcome, RunResult, SeriesLog
from bt_dualarm.runtime.recorder import Recorder
from bt_dualarm.sim.world import World

TREE = """
bt_dualarm: 1
name: over and over
world: {scene: empty, timestep: 0.004, time_limit: 86400, seed: SEED}
objects:
  cube: {shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, color: red, fixed: false,
         pose: {xyz: [0.45, -0.40, 0.025]}}
arms:
  arm1:
    robot: ur5
    tick_hz: 25
    base: {xyz: [0, 0, 0.0]}
    tree:
      repeat:
        times: forever
        child:
          sequence:
            - approach_and_attach: {object: cube}
            - transport: {name: lift, object: cube, to: {xyz: [0.45, -0.30, 0.30]}}
            - circle: {plane: yz, radius: 0.05, speed: 0.5}
            - transport: {name: put down, object: cube, to: {xyz: [0.45, -0.40, 0.026]}}
            - detach: {object: cube}
            - reach_to_pose: {offset: {xyz: [0, 0, 0.15]}}
            - log: again
            - wait: 5
"""


@dataclass(frozen=True)
class Cost:
    """Cost of one run.

    Attributes:
        minutes: Simulated minutes.
        peak_mb: Largest resident memory of the process, MB.
        running_s: CPU time until the end of the run, s.
        writing_s: CPU time of writing its record, s.
        record_mb: Size of the record, MB.
        attachments: Number of attachments.
    """

    minutes: float
    peak_mb: float
    running_s: float
    writing_s: float
    record_mb: float
    attachments: int


@dataclass
class FakeAttachment:
    """An attachment as seen by the recorder."""

    arm: str
    object: str
    since: float


@dataclass
class FakeWorld:
    """A world whose clock can be set."""

    world: World
    time: float = 0.0
    attachments: list[FakeAttachment] = field(default_factory=list)

    def __getattr__(self, name: str) -> object:
        """Forward everything else to the world."""
        return getattr(self.world, name)


class FakeRun:
    """A run at one time."""

    def __init__(self, time: float) -> None:
        self.time = time

    def views(self) -> tuple[()]:
        """There are no views."""
        return ()


def run(minutes: float, seed: int, folder: Path) -> Cost:
    """Cost of a whole run and of writing its record."""
    with bt.open(TREE.replace("SEED", str(seed)), duration=60 * minutes, record=folder) as opened:
        opened.finish()
        ran = time.process_time()
        opened.write_record()
        wrote = time.process_time()
        arm = opened.result.arms["arm1"]
        held = sum(run.skill == "detach" for run in arm.runs)
    return _cost(minutes, folder, ran, wrote - ran, held)


def record(minutes: float, seed: int, folder: Path) -> Cost:
    """Cost of the record alone: samples at 100 Hz, 250 series values/s, an attachment every 8 s."""
    with bt.open(TREE.replace("SEED", str(seed))) as opened:
        scene = FakeWorld(opened.world)
        rng = np.random.default_rng(seed)
        folder.mkdir(parents=True)
        recorder = Recorder(folder, scene, StateLog(opened.world), list)  # type: ignore[arg-type]  # by __getattr__
        series = SeriesLog()
        held = 0
        step = opened.world.timestep
        for tick in range(round(60 * minutes * 25)):
            begin = tick / 25
            if tick % 200 == 0:
                scene.attachments = [FakeAttachment("arm1", "cube", begin)]
                held = held + 1
            elif tick % 200 == 150:
                scene.attachments = []
                times = begin + step * np.arange(1000)
                series.add("arm1", "leaf", "executed", times, rng.normal(size=(1000, 3)))
            if tick % 50 == 0:
                recorder.on_event(
                    StatusChange(begin, "arm1", "leaf", "circle", "RUNNING", "SUCCESS")
                )
            recorder.after_ticks(FakeRun(begin))
            for i in range(round(1 / 25 / step)):
                scene.time = begin + (i + 1) * step
                recorder.after_step(scene.time)
        ran = time.process_time()
        arms = {"arm1": ArmResult("arm1", "ur5", Outcome.SUCCESS, series=series.of("arm1"))}
        result = RunResult(Ending.DURATION, 60 * minutes, 1.0, arms, at_rest=True)
        recorder.write(result, StopRequest())
        wrote = time.process_time()
    return _cost(minutes, folder, ran, wrote - ran, held)


def _cost(minutes: float, folder: Path, ran: float, writing: float, held: int) -> Cost:
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return Cost(minutes, peak, ran, writing, size / 1e6, held)


def measure(function: Callable[[float, int, Path], Cost], minutes: float, seed: int) -> Cost:
    """Cost of one run in a separate process."""
    with tempfile.TemporaryDirectory() as folder:
        context = multiprocessing.get_context("spawn")
        with context.Pool(1) as pool:
            return pool.apply(function, (minutes, seed, Path(folder) / "out"))


def table(
    title: str, function: Callable[[float, int, Path], Cost], minutes: list[float], seed: int
) -> None:
    """Print the costs of runs of several lengths."""
    print(
        f"{title}\n  minutes  peak MB          running s  writing s  ms per min.  record MB  held"
    )
    first: Cost | None = None
    for length in minutes:
        cost = measure(function, length, seed)
        first = first or cost
        more = 100 * (cost.peak_mb / first.peak_mb - 1)
        print(
            f"  {length:7g}  {cost.peak_mb:7.1f} ({more:+.1f} %)  {cost.running_s:9.1f}  "
            f"{cost.writing_s:9.2f}  {1e3 * cost.writing_s / length:11.2f}  {cost.record_mb:9.2f}  "
            f"{cost.attachments:4d}",
            flush=True,
        )


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, nargs="*", default=[10.0, 100.0])
    parser.add_argument("--record-minutes", type=float, nargs="*", default=[10.0, 100.0, 1000.0])
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    table("whole runs", run, arguments.minutes, arguments.seed)
    table("the record alone", record, arguments.record_minutes, arguments.seed)


if __name__ == "__main__":
    main()
