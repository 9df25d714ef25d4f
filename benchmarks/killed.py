"""What is left of a record when its process is killed: ``kill -9`` at random moments.

    python -m benchmarks.killed [--kills 10] [--seed 0] [--check]

Each time a shipped tree is run as ``bt-run`` does, and killed after a random number of lines of
its log and a random moment more. Prints how much of the run, by its last event, the record lacks,
and with --check whether running it anew agrees with what is there. With --disk FOLDER, a small file
system, it is run there once more, and what is left when that is full is read in the same way.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from bt_dualarm.replay.record import Record
from bt_dualarm.replay.rerun import check_record
from bt_dualarm.runtime.recorder import EVENTS, HISTORY
from bt_dualarm.skill.registry import Registry

PROGRAM = "import bt_dualarm.cli as cli, sys; sys.exit(cli.run())"
MOST_LINES = 14
TREES = ("pick_and_track", "pick_by_sight", "spawn_and_command", "visual_tracking")


def started(folder: Path, tree: str) -> subprocess.Popen[bytes]:
    """A run that records to a folder, as a process of its own."""
    command = [sys.executable, "-c", PROGRAM, tree, "--display", "log", "--record", str(folder)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)


def killed(folder: Path, tree: str, lines: int, seconds: float) -> Record | None:
    """The record of a run that was killed after so many lines and seconds on the wall.

    None where it was killed before its first step: the file begins with that.
    """
    with started(folder, tree) as process:
        for _ in range(lines):
            process.stdout.readline()  # type: ignore[union-attr]  # it is a pipe
        time.sleep(seconds)
        process.send_signal(signal.SIGKILL)
    return Record.read(folder) if (folder / HISTORY).exists() else None


def missing_of(folder: Path, record: Record | None) -> float:
    """Seconds from the end of a record to the last event that was written."""
    lines = (folder / EVENTS).read_text().splitlines() if (folder / EVENTS).exists() else []
    last = max((float(json.loads(line)["time_s"]) for line in lines[:-1]), default=0.0)
    return last - (record.until if record is not None else 0.0)


def agrees(record: Record | None, registry: Registry) -> bool:
    """Whether a run that is made anew is the same, as far as the record goes."""
    return record is None or record.steps == 0 or check_record(record, registry).agrees


def main() -> None:
    """Kill, read, compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--disk", type=Path)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    registry = Registry.load()
    missing = []
    agree = 0
    begun = 0
    with tempfile.TemporaryDirectory() as name:
        for number in range(arguments.kills):
            lines = int(rng.integers(1, MOST_LINES))
            seconds = float(rng.uniform(0.0, 0.4))
            folder = Path(name) / str(number)
            tree = TREES[number % len(TREES)]
            record = killed(folder, tree, lines, seconds)
            begun += record is not None
            missing.append(missing_of(folder, record))
            agree += bool(arguments.check and agrees(record, registry))
            until = 0.0 if record is None else record.until
            print(f"{tree} until {until:.2f} s, {missing[-1]:+.2f} s to its last event", flush=True)
    print(f"{begun} of {len(missing)} had made a step, and their records open")
    print(f"at most {max(missing):.2f} s lack")
    if arguments.check:
        print(f"{agree} agree with a run that was made anew")
    if arguments.disk is not None:
        folder = arguments.disk / "full"
        with started(folder, TREES[0]) as process:
            process.communicate()
        record = Record.read(folder)
        same = agrees(record, registry)
        print(
            f"full disk: exit code {process.returncode}, until {record.until:.2f} s, same: {same}"
        )


if __name__ == "__main__":
    main()
