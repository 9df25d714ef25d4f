"""Repeatability: equal seeds give bitwise equal states in fresh processes, other seeds do not.

python benchmarks/repeatability.py [TREE] [--seed 0] [--runs 3]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

PROGRAM = "import sys; from bt_dualarm.cli import run; sys.exit(run())"


def state_hash(tree: str, seed: int, folder: Path) -> str:
    """SHA-256 over the states of a run in a separate process."""
    options = ["--seed", str(seed), "--display", "quiet", "--record", str(folder)]
    subprocess.run([sys.executable, "-c", PROGRAM, tree, *options], check=True)
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return str(summary["state_sha256"])


def main() -> int:
    """Run all seeds and compare the hashes; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("tree", nargs="?", default="pick_and_track")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--runs", type=int, default=3)
    arguments = parser.parse_args()
    seeds = [arguments.seed] * arguments.runs + [arguments.seed + 1]
    hashes = []
    with tempfile.TemporaryDirectory() as scratch:
        for number, seed in enumerate(seeds):
            hashes.append(state_hash(arguments.tree, seed, Path(scratch) / str(number)))
            print(f"seed {seed}: {hashes[-1]}", flush=True)
    same = set(hashes[:-1])
    other = hashes[-1]
    print(f"same seed: {'equal' if len(same) == 1 else 'DIFFERENT'}")
    print(f"other seed: {'EQUAL' if other in same else 'different'}")
    return 0 if len(same) == 1 and other not in same else 1


if __name__ == "__main__":
    sys.exit(main())
