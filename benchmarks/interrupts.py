"""Killing a run at random moments: exit code, whole files, arms that stand still.

    python benchmarks/interrupts.py [TREE] [--moments 10] [--seed 0]

SIGINT and SIGTERM, each at so many moments of wall time after the program began to build or run.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from subprocess import DEVNULL, PIPE

import numpy as np

PROGRAM = "import bt_dualarm.cli as cli, sys; print('begun', flush=True); sys.exit(cli.run())"
LONGEST = 6.0  # s after the start of the program
STANDS = 2e-4  # m between two samples, 10 ms apart


def killed(tree: str, kind: signal.Signals, moment: float, folder: Path) -> list[str]:
    """Everything that is not as it should be after a run was killed."""
    command = [sys.executable, "-c", PROGRAM, tree, "--display", "quiet", "--record", str(folder)]
    with subprocess.Popen(command, stdout=PIPE, stderr=DEVNULL, text=True) as process:
        if process.stdout is not None:
            process.stdout.readline()
        time.sleep(moment)
        process.send_signal(kind)
        process.communicate(timeout=300)
    return [*_code_faults(process.returncode, kind), *_record_faults(folder)]


def _code_faults(code: int, kind: signal.Signals) -> Iterator[str]:
    if code != 128 + kind:
        yield f"exit code {code} instead of {128 + kind}"


def _record_faults(folder: Path) -> Iterator[str]:
    try:
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        for line in (folder / "events.jsonl").read_text(encoding="utf-8").splitlines():
            json.loads(line)
        with np.load(folder / "samples.npz") as archive:
            samples = {name: archive[name] for name in archive.files}
    except (OSError, ValueError) as error:
        yield f"record: {error}"
        return
    if summary["outcome"] not in ("UNFINISHED", "SUCCESS", "FAILURE"):
        yield f"outcome {summary['outcome']}"
    for name in samples:
        way = np.diff(samples[name][-2:], axis=0)
        if name.startswith("tool_") and not (np.linalg.norm(way, axis=1) < STANDS).all():
            yield f"{name} moves at the end"


def main() -> int:
    """Read the arguments, kill, report."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("tree", nargs="?", default="pick_and_track")
    parser.add_argument("--moments", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    bad = 0
    with tempfile.TemporaryDirectory() as scratch:
        for kind in (signal.SIGINT, signal.SIGTERM):
            for moment in rng.uniform(0.02, LONGEST, arguments.moments):
                faults = killed(arguments.tree, kind, moment, Path(scratch) / f"{kind}-{moment}")
                bad += bool(faults)
                print(f"{kind.name} at {moment:5.2f} s: {'; '.join(faults) or 'fine'}", flush=True)
    print(f"{2 * arguments.moments - bad} of {2 * arguments.moments} ended as they should")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
