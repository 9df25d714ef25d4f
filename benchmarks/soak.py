"""Endurance: simulated days of pick, handover, place and track, or many starts and ends of runs.

    python -m benchmarks.soak [--hours 24] [--segment 1] [--seed 0]
    python -m benchmarks.soak --starts 1000

In one process, a UR5 repeatedly picks a bar, hands it to a Panda, takes it back and places it;
another UR5 moves a cube along circles, and another Panda tracks it with its camera. Every simulated
hour (``--segment``) the run ends, and the next one begins with the next seed and a new record; only
the last two records are kept. Prints a row per segment, and all problems: memory that differs by
more than 1 % from that after the first hour, success rates that drift, and leaked processes,
threads or files.

With ``--starts``, runs of several trees are started instead, and ended after half a second; every
tenth has a record.
"""

from __future__ import annotations

import argparse
import gc
import shutil
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import scipy

import bt_dualarm as bt
from bt_dualarm.behaviors.report import StatusChange
from bt_dualarm.runtime.arm_runtime import IdleObserver

TREE: Final = """
bt_dualarm: 1
name: soak
world: {scene: empty, reality: lab, seed: 0, time_limit: 86400}
subtrees:
  giving:
    tree:
      sequence:
        name: pick, hand over, place
        children:
          - grasp: {object: bar}
          - hand_over: {object: bar, to: taker}
          - take_over: {object: bar, from: taker}
          - place: {object: bar, at: {xyz: [0.35, -0.40, 0.2175], rpy: [0, 0, 0]}}
          - go_home
  taking:
    tree:
      sequence:
        name: take and return
        children:
          - take_over: {object: bar, from: giver}
          - hand_over: {object: bar, to: giver}
          - go_home
  moving:
    tree:
      sequence:
        name: move
        children:
          - transport: {object: cube, to: {xyz: [0.68, 5.11, 0.70]}}
          - circle: {plane: yz, radius: 0.10, turns: 2, speed: 0.4}
          - wait: 2
  tracking:
    tree:
      sequence:
        name: track the cube
        children:
          - track: {color: yellow, plane: yz, duration: 20}
objects:
  shelf: {shape: box, size: [0.20, 0.025, 0.2], mass: 1, color: gray, fixed: true,
          pose: {xyz: [0.35, -0.40, 0.1]}}
  bar: {shape: box, size: [0.16, 0.035, 0.035], mass: 0.3, color: orange,
        pose: {xyz: [0.35, -0.40, 0.2175]}, noise: {xyz: [0.01, 0.002, 0]}}
  cube: {shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, color: yellow,
         pose: {xyz: [0.68, 5.11, 0.701]}}
  stand: {shape: box, size: [0.03, 0.06, 0.676], mass: 5, color: white, fixed: true,
          pose: {xyz: [0.68, 5.11, 0.338]}}
arms:
  giver:
    robot: ur5
    gripper: robotiq_2f85
    base: {xyz: [0, 0, 0]}
    tree: {repeat: {times: forever, child: {force_success: {child: {subtree: {use: giving}}}}}}
  taker:
    robot: panda
    gripper: panda_hand
    base: {xyz: [1.05, 0, 0], rpy: [0, 0, 180]}
    tree: {repeat: {times: forever, child: {force_success: {child: {subtree: {use: taking}}}}}}
  mover:
    robot: ur5
    base: {xyz: [0, 5, 0.40]}
    posture: present
    tree:
      sequence:
        - approach_and_attach: {object: cube, direction: [1, 0, 0], standoff: 0.08}
        - remove: {object: stand}
        - repeat: {times: forever, child: {force_success: {child: {subtree: {use: moving}}}}}
  tracker:
    robot: panda
    base: {xyz: [1.60, 5.11, 0.28], rpy: [0, 0, 180]}
    posture: look_out
    camera: {mount: wrist, resolution: [320, 240], fov: 50, fps: 30}
    tree: {repeat: {times: forever, child: {force_success: {child: {subtree: {use: tracking}}}}}}
"""

TASKS: Final = ("pick, hand over, place", "take and return", "move", "track the cube")
"""Names of the nodes whose outcomes are counted."""

STARTED: Final = ("circle", "pick_and_track", "handover", "visual_tracking", "shared_bin")
"""Shipped trees that are started and ended."""

WARM_UP_STARTS: Final = 60
"""Starts after which memory must not grow: the first of each tree import skills and fill caches."""

MOST_GROWTH: Final = 0.01
MOST_RECORDS: Final = 2
CONFIDENCE: Final = 0.99


@dataclass(frozen=True)
class Usage:
    """Resources that this process uses.

    Attributes:
        memory_mb: Resident memory, MB.
        threads: Number of threads.
        files: Number of open files, pipes and sockets.
        children: Number of child processes, zombies included.
    """

    memory_mb: float
    threads: int
    files: int
    children: int

    @classmethod
    def now(cls) -> Usage:
        """Current usage, after a garbage collection."""
        gc.collect()
        status = Path("/proc/self/status").read_text(encoding="ascii")
        (resident,) = (line for line in status.splitlines() if line.startswith("VmRSS:"))
        task = Path(f"/proc/self/task/{threading.main_thread().native_id}/children")
        files = (
            sum(1 for _ in Path("/proc/self/fd").iterdir()) - 1
        )  # without that of the listing itself
        children = len(task.read_text(encoding="ascii").split())
        return cls(float(resident.split()[1]) / 1e3, threading.active_count(), files, children)


@dataclass(frozen=True)
class Segment:
    """One run of the soak.

    Attributes:
        hours: Simulated hours until its end, since the start of the soak.
        usage: Usage after its end.
        done: Number of repetitions by task.
        succeeded: Number of successful ones by task.
        codes: Failure codes of leaves, with their number.
        cpu_s: CPU time, s.
    """

    hours: float
    usage: Usage
    done: Counter[str] = field(default_factory=Counter)
    succeeded: Counter[str] = field(default_factory=Counter)
    codes: Counter[str] = field(default_factory=Counter)
    cpu_s: float = 0.0


class _Count(IdleObserver):
    """Counts the outcomes of tasks and the codes of failed leaves."""

    def __init__(self) -> None:
        self.done: Counter[str] = Counter()
        self.succeeded: Counter[str] = Counter()
        self.codes: Counter[str] = Counter()

    def on_event(self, change: StatusChange) -> None:
        name = change.path.rpartition("/")[2]
        if name in TASKS and change.new in ("SUCCESS", "FAILURE"):
            self.done[name] += 1
            self.succeeded[name] += change.new == "SUCCESS"
        elif change.new == "FAILURE" and change.code:
            self.codes[f"{change.arm} {name} {change.code}"] += 1


def soak(
    hours: float, segment_hours: float, seed: int, folder: Path, tree: str = TREE
) -> Iterator[Segment]:
    """Run segment after segment; the last records stay in the folder.

    Args:
        hours: Simulated hours in all.
        segment_hours: Simulated hours of each run.
        seed: Seed of the first run; each further one has the next.
        folder: Folder for the records, named by the number of their segment.
        tree: Tree file as text.
    """
    count = max(1, round(hours / segment_hours))
    for number in range(count):
        began = time.process_time()
        counts = _Count()
        record = folder / f"{number:05d}"
        with bt.open(
            tree, seed=seed + number, duration=3600.0 * segment_hours, record=record
        ) as run:
            run.watch(counts)
            result = run.finish()
            # A second request skips the plots, which the benchmark does not need.
            run.stop()
            run.stop()
        if result.error:
            raise RuntimeError(f"segment {number}: {result.error}")
        del run, result
        for old in sorted(folder.iterdir())[:-MOST_RECORDS]:
            shutil.rmtree(old)
        yield Segment(
            (number + 1) * segment_hours,
            Usage.now(),
            counts.done,
            counts.succeeded,
            counts.codes,
            time.process_time() - began,
        )


def starts(count: int, folder: Path, seed: int = 0) -> Iterator[tuple[int, Usage]]:
    """Start and end runs in this process.

    Yields:
        The number of runs so far and the usage: after each tenth of them, at least one round.
    """
    every = max(len(STARTED), count // 10)
    for number in range(count):
        record = folder / "record" if number % 10 == 0 else None
        tree = STARTED[number % len(STARTED)]
        with bt.open(tree, seed=seed + number, duration=0.5, record=record) as run:
            run.finish()
            run.stop()
            run.stop()
        del run
        if record is not None:
            shutil.rmtree(record)
        if (number + 1) % every == 0:
            yield number + 1, Usage.now()


def growth_of(usages: Sequence[Usage]) -> list[str]:
    """Resources that grew since the first usage, as sentences."""
    first = usages[0]
    found = []
    furthest = max(usages, key=lambda one: abs(one.memory_mb / first.memory_mb - 1))
    change = furthest.memory_mb / first.memory_mb - 1
    if abs(change) > MOST_GROWTH:
        found.append(
            f"memory changed by {100 * change:+.1f} %, from {first.memory_mb:.1f} to "
            f"{furthest.memory_mb:.1f} MB"
        )
    for name in ("threads", "files", "children"):
        before, after = getattr(first, name), getattr(usages[-1], name)
        if after > before:
            found.append(f"{name} grew from {before} to {after}")
    return found


def drift_of(segments: Sequence[Segment]) -> list[str]:
    """Tasks whose success differs between the two halves by Fisher's exact test, as sentences."""
    found = []
    halves = segments[: len(segments) // 2], segments[len(segments) // 2 :]
    for task in TASKS:
        table = [
            (sum(one.succeeded[task] for one in half), sum(one.done[task] for one in half))
            for half in halves
        ]
        fisher = scipy.stats.fisher_exact([[good, done - good] for good, done in table])
        if float(fisher.pvalue) < 1 - CONFIDENCE:
            texts = " and ".join(f"{good} of {done}" for good, done in table)
            found.append(f"success of '{task}' drifts: {texts} (p = {float(fisher.pvalue):.3f})")
    return found


def problems_of(segments: Sequence[Segment], first_hour: float = 1.0) -> list[str]:
    """All problems, as sentences.

    Args:
        segments: All segments, in their order.
        first_hour: Simulated hours after which memory must not grow.
    """
    settled = [one for one in segments if one.hours >= first_hour - 1e-9] or list(segments)
    total = sum((one.done for one in segments), Counter())
    idle = [f"'{task}' was never done" for task in TASKS if not total[task]]
    return idle + growth_of([one.usage for one in settled]) + drift_of(segments)


def _print(label: str, usage: Usage, more: str) -> None:
    print(
        f"| {label} | {usage.memory_mb:.1f} | {usage.threads} | {usage.files} | {usage.children} | "
        f"{more} |",
        flush=True,
    )


def main() -> int:
    """Print the table; returns 1 if there is a problem."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=24.0, help="simulated hours (24)")
    parser.add_argument("--segment", type=float, default=1.0, help="simulated hours of a run (1)")
    parser.add_argument("--starts", type=int, help="number of runs to start and end instead")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="soak_") as name:
        if arguments.starts:
            problems = _starts(arguments.starts, Path(name), arguments.seed)
        else:
            problems = _soak(arguments.hours, arguments.segment, arguments.seed, Path(name))
    print("\n".join(problems) or "no growth, no drift, no leaks")
    return 1 if problems else 0


def _starts(count: int, folder: Path, seed: int) -> list[str]:
    print("| starts | memory MB | threads | files | children | CPU s |\n|---|---|---|---|---|---|")
    usages = []
    for number, usage in starts(count, folder, seed):
        if number >= min(WARM_UP_STARTS, count):
            usages.append(usage)
        _print(str(number), usage, f"{time.process_time():.0f}")
    return growth_of(usages)


def _soak(hours: float, segment: float, seed: int, folder: Path) -> list[str]:
    titles = " | ".join(TASKS)
    print(f"| hours | memory MB | threads | files | children | {titles} | CPU s | failures |")
    print(f"|{'---|' * (len(TASKS) + 7)}")
    segments = []
    for one in soak(hours, segment, seed, folder):
        segments.append(one)
        cells = [f"{one.succeeded[task]} of {one.done[task]}" for task in TASKS]
        codes = ", ".join(f"{n} of {code}" for code, n in one.codes.most_common(3))
        _print(f"{one.hours:g}", one.usage, " | ".join([*cells, f"{one.cpu_s:.0f}", codes]))
    return problems_of(segments)


if __name__ == "__main__":
    sys.exit(main())
