"""Readability of records after ``kill -9`` at random times.

    python -m benchmarks.killed [--kills 10] [--seed 0] [--check]

Each time, a shipped tree is run as ``bt-run`` does, and killed after a random number of log lines
plus a random delay. Prints how many seconds of the run, up to its last event, are missing in the
record, and with --check whether a new run agrees with the record. With --disk FOLDER on a small
file system, one more run records there until the disk is full, and its record is read likewise.
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


def start_run(folder: Path, tree: str) -> subprocess.Popen[bytes]:
    """Start a run that records to a folder, in a separate process."""
    command = [sys.executable, "-c", PROGRAM, tree, "--display", "log", "--record", str(folder)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)


def run_and_kill(folder: Path, tree: str, lines: int, seconds: float) -> Record | None:
    """The record of a run that was killed after some lines of its log and some wall-clock seconds.

    None if it was killed before its first step, with which the file begins.
    """
    with start_run(folder, tree) as process:
        for _ in range(lines):
            process.stdout.readline()  # type: ignore[union-attr]  # a pipe
        time.sleep(seconds)
        process.send_signal(signal.SIGKILL)
    return Record.read(folder) if (folder / HISTORY).exists() else None


def missing_of(folder: Path, record: Record | None) -> float:
    """Seconds from the end of a record to the last recorded event."""
    lines = (folder / EVENTS).read_text().splitlines() if (folder / EVENTS).exists() else []
    last = max((float(json.loads(line)["time_s"]) for line in lines[:-1]), default=0.0)
    return last - (record.until if record is not None else 0.0)


def agrees(record: Record | None, registry: Registry) -> bool:
    """Whether a new run agrees with the record, up to its end."""
    return record is None or record.steps == 0 or check_record(record, registry).agrees


def main() -> None:
    """Kill runs, read their records, and print what is missing."""
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
            record = run_and_kill(folder, tree, lines, seconds)
            begun += record is not None
            missing.append(missing_of(folder, record))
            agree += bool(arguments.check and agrees(record, registry))
            until = 0.0 if record is None else record.until
            print(f"{tree} until {until:.2f} s, {missing[-1]:+.2f} s to its last event", flush=True)
    print(f"{begun} of {len(missing)} had completed a step, and their records are readable")
    print(f"at most {max(missing):.2f} s are missing")
    if arguments.check:
        print(f"{agree} agree with a new run")
    if arguments.disk is not None:
        folder = arguments.disk / "full"
        with start_run(folder, TREES[0]) as process:
            process.communicate()
        record = Record.read(folder)
        same = agrees(record, registry)
        print(
            f"full disk: exit code {process.returncode}, until {record.until:.2f} s, same: {same}"
        )


if __name__ == "__main__":
    main()
