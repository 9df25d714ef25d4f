"""Cost of a run with more arms, more cameras and more time.

    python -m benchmarks.growth [--arms 1 2 4 8] [--cameras 1 2 4] [--minutes 1 10 100] [--whole]
                                [--picture docs/images/growth.svg]

Each row is a run in a separate process, without a record: UR5s three meters apart that draw circles
endlessly, or Pandas three meters apart whose wrist cameras track a cube at 30 Hz. The run advances
by simulated minutes. CPU is that of the last minute, memory the resident memory at its end. Runs
with several arms or cameras end after the shortest of ``--minutes`` unless ``--whole`` is given.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

import bt_dualarm as bt

DISTANCE_M = 3.0


@dataclass(frozen=True)
class Cost:
    """Cost of a run at one time.

    Attributes:
        what: ``arms`` or ``cameras``.
        count: Number of arms or cameras.
        minutes: Simulated minutes since the start.
        cpu_ms: CPU time per simulated second in the last minute, ms.
        memory_mb: Resident memory of the process, MB.
    """

    what: str
    count: int
    minutes: int
    cpu_ms: float
    memory_mb: float


def arms(count: int) -> dict[str, Any]:
    """A tree file with ``count`` arms that draw circles."""
    circle = {"circle": {"plane": "yz", "radius": 0.05, "speed": 0.5}}
    drawing = {"sequence": [{"reach_to_pose": {"posture": "present"}}, circle]}
    circles = {"repeat": {"times": "forever", "child": drawing}}
    return _file(
        {
            f"arm{i}": {
                "robot": "ur5",
                "base": {"xyz": [0, DISTANCE_M * i, 0.4]},
                "posture": "present",
                "tree": circles,
            }
            for i in range(count)
        },
        {},
    )


def cameras(count: int) -> dict[str, Any]:
    """A tree file with ``count`` arms whose cameras track a cube."""
    return _file(
        {
            f"arm{i}": {
                "robot": "panda",
                "base": {"xyz": [0.92, DISTANCE_M * i, 0.28], "rpy": [0, 0, 180]},
                "posture": "look_out",
                "camera": {"mount": "wrist", "resolution": [320, 240], "fov": 50, "fps": 30},
                "tree": {"track": {"color": "yellow", "plane": "yz", "score": f"cube{i}"}},
            }
            for i in range(count)
        },
        {
            f"cube{i}": {
                "shape": "box",
                "size": [0.05, 0.05, 0.05],
                "mass": 0.1,
                "color": "yellow",
                "fixed": True,
                "pose": {"xyz": [0, DISTANCE_M * i, 0.701]},
            }
            for i in range(count)
        },
    )


def _file(arms: dict[str, Any], objects: dict[str, Any]) -> dict[str, Any]:
    return {
        "bt_dualarm": 1,
        "name": "growth",
        "world": {"scene": "empty", "reality": "lab", "seed": 0, "time_limit": 86400},
        "objects": objects,
        "arms": arms,
    }


def measure(what: str, count: int, minutes: Sequence[int]) -> list[Cost]:
    """Cost of one run after each of these numbers of minutes."""
    found: list[Cost] = []
    with bt.open({"arms": arms, "cameras": cameras}[what](count)) as run:
        run.step(1.0)  # imports and set-up in the first tick do not count
        for minute in range(1, max(minutes) + 1):
            before = time.process_time()
            run.step(60.0)
            cpu_ms = 1e3 * (time.process_time() - before) / 60.0
            if run.done:
                raise RuntimeError(f"{what} {count}: the run has ended: {run.result}")
            if minute in minutes:
                found.append(Cost(what, count, minute, cpu_ms, _memory_mb()))
    return found


def _memory_mb() -> float:
    status = Path("/proc/self/status").read_text(encoding="ascii")
    (line,) = (line for line in status.splitlines() if line.startswith("VmRSS:"))
    return float(line.split()[1]) / 1e3


def plot(costs: Sequence[Cost], target: Path) -> None:
    """Plot CPU time over arms and cameras, and CPU time and memory over time."""
    figure = Figure(figsize=(9.0, 3.0), layout="constrained")
    by_count, cpu, memory = figure.subplots(1, 3)
    for what in ("arms", "cameras"):
        first = [one for one in costs if one.what == what and one.minutes == 1]
        if first:
            by_count.plot([one.count for one in first], [one.cpu_ms for one in first], "o-")
            per_one = first[0].cpu_ms / first[0].count
            line = [per_one * one.count for one in first]
            by_count.plot([one.count for one in first], line, ":", color="gray")
        for count in sorted({one.count for one in costs if one.what == what}):
            row = [one for one in costs if (one.what, one.count) == (what, count)]
            times = [one.minutes for one in row]
            label = f"{count} {what}"
            cpu.semilogx(times, [one.cpu_ms for one in row], "o-", label=label)
            memory.semilogx(times, [one.memory_mb for one in row], "o-", label=label)
    by_count.set(xlabel="arms (blue), cameras (orange)", ylabel="CPU ms per simulated second")
    cpu.set(xlabel="simulated minutes", ylabel="CPU ms per simulated second")
    memory.set(xlabel="simulated minutes", ylabel="memory MB")
    for axes in (by_count, cpu, memory):
        axes.set_ylim(bottom=0)
    cpu.legend(fontsize=6)
    figure.savefig(target, metadata={"Date": None})


def main() -> None:
    """Print the table, and plot it if requested."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", type=int, nargs="*", default=[1, 2, 4, 8])
    parser.add_argument("--cameras", type=int, nargs="*", default=[1, 2, 4])
    parser.add_argument("--minutes", type=int, nargs="*", default=[1, 10, 100])
    parser.add_argument("--whole", action="store_true")
    parser.add_argument("--picture", type=Path)
    arguments = parser.parse_args()
    costs: list[Cost] = []
    print("| what | minutes | CPU ms per simulated second | memory MB |\n|---|---|---|---|")
    for what, counts in (("arms", arguments.arms), ("cameras", arguments.cameras)):
        for count in counts:
            goes_on = arguments.whole or count == 1
            minutes = sorted(arguments.minutes)[: None if goes_on else 1]
            with multiprocessing.get_context("spawn").Pool(1) as pool:
                row = pool.apply(measure, (what, count, minutes))
            for one in row:
                figures = f"{one.cpu_ms:.0f} | {one.memory_mb:.0f} |"
                print(f"| {count} {what} | {one.minutes} | {figures}", flush=True)
            costs += row
    if arguments.picture is not None:
        plot(costs, arguments.picture)


if __name__ == "__main__":
    main()
