"""What is left of a record when its process is killed: ``kill -9`` at random moments.

    python -m benchmarks.killed [--kills 10] [--seed 0] [--check]

Each time `pick_and_track` is run as ``bt-run`` does, and killed after a random number of lines of
its log and a random moment more. Prints how much of the run, by its last event, the record lacks,
and with --check whether running it anew agrees with what is there.
"""

from __future__ import annotations

import argparse
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from bt_dualarm.replay.check import check_record
from bt_dualarm.replay.record import Record
from bt_dualarm.skill.registry import Registry

PROGRAM = "import bt_dualarm.cli as cli, sys; sys.exit(cli.run())"
MOST_LINES = 14


def killed(folder: Path, lines: int, seconds: float) -> Record:
    """The record of a run that was killed after so many lines and seconds on the wall."""
    command = [sys.executable, "-c", PROGRAM, "pick_and_track", "--display", "log"]
    command += ["--record", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        for _ in range(lines):
            process.stdout.readline()  # type: ignore[union-attr]  # it is a pipe
        time.sleep(seconds)
        process.send_signal(signal.SIGKILL)
    return Record.read(folder)


def main() -> None:
    """Kill, read, compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--check", action="store_true")
    arguments = parser.parse_args()
    rng, registry = np.random.default_rng(arguments.seed), Registry.load()
    missing, agree = [], 0
    with tempfile.TemporaryDirectory() as name:
        for number in range(arguments.kills):
            lines, seconds = int(rng.integers(1, MOST_LINES)), float(rng.uniform(0.0, 0.4))
            record = killed(Path(name) / str(number), lines, seconds)
            missing.append(record.events[-1]["time_s"] - record.until if record.events else 0.0)
            agreed = record.steps == 0 or (
                arguments.check and check_record(record, registry).agrees
            )
            agree += agreed
            print(f"until {record.until:.2f} s, {missing[-1]:+.2f} s to its last event", flush=True)
    print(f"{len(missing)} of {arguments.kills} records open; at most {max(missing):.2f} s lack")
    if arguments.check:
        print(f"{agree} agree with a run that was made anew")


if __name__ == "__main__":
    main()
