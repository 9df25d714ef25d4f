"""Cost of two states of this project, compared in alternating fresh processes.

    python -m benchmarks.alternating 41cfa06 [--tree TREE] [--param grasp=attach] [--pairs 6]

The first state is a revision of this repository, or a folder with a checkout; the second is this
checkout, to which alone ``--param`` applies. Each runs the tree once to warm its caches, then both
run it alternately, without a record. Prints for each pair the CPU seconds of both whole processes,
and of their steps, as `real_time` measures them; then the median ratio of the pairs: other programs
slow down both runs of a pair.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent

_RUN = """
import json, os, sys, time
import bt_dualarm as bt
with bt.open(sys.argv[1], renderer="ray", **json.loads(sys.argv[2])) as opened:
    began = time.process_time()
    result = opened.finish()
    steps = time.process_time() - began
spent = os.times()
print(json.dumps([
    spent.user + spent.system + spent.children_user + spent.children_system,
    steps, result.real_time_factor, result.outcome,
]))
"""


class Cost(NamedTuple):
    """Cost of one process.

    Attributes:
        whole_s: CPU seconds of the process and its children.
        steps_s: CPU seconds from the first step of the run to the last.
        factor: Real-time factor of the run, by wall-clock time.
        outcome: Outcome of the run.
    """

    whole_s: float
    steps_s: float
    factor: float
    outcome: str


def cost(checkout: Path, tree: str, compiled: str, params: list[str]) -> Cost:
    """Run a tree of a checkout in a separate process.

    Args:
        checkout: Folder with a state of the project.
        tree: Name of the tree.
        compiled: Folder for Python's byte code.
        params: Parameters ``NAME=VALUE``, which only this checkout gets.

    Raises:
        subprocess.CalledProcessError: The tree could not be run.
    """
    named = dict(param.split("=", 1) for param in params) if checkout == ROOT else {}
    options = json.dumps({"params": named} if named else {})
    done = subprocess.run(
        [sys.executable, "-c", _RUN, str(checkout / "trees" / f"{tree}.yaml"), options],
        cwd=checkout,
        env=_environment(checkout, compiled),
        stdout=subprocess.PIPE,
        check=True,
    )
    return Cost(*json.loads(done.stdout.splitlines()[-1]))


def _environment(checkout: Path, compiled: str) -> dict[str, str]:
    given = os.environ | {"PYTHONPATH": str(checkout), "PYTHONPYCACHEPREFIX": compiled}
    return {name: value for name, value in given.items() if name != "PYTHONDONTWRITEBYTECODE"}


@contextmanager
def checkout_of(state: str) -> Iterator[Path]:
    """The folder of a state: a given one, or a temporary worktree of a revision."""
    if Path(state).is_dir():
        yield Path(state).resolve()
        return
    with tempfile.TemporaryDirectory() as folder:
        worktree = Path(folder) / "before"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--quiet", "--detach", str(worktree), state], check=True)
        try:
            yield worktree
        finally:
            subprocess.run([*git, "remove", "--force", str(worktree)], check=True)


def main() -> None:
    """Print a line for each pair, and the medians."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("before")
    parser.add_argument("--tree", default="pick_and_track")
    parser.add_argument("--param", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--pairs", type=int, default=6)
    arguments = parser.parse_args()
    tree = arguments.tree
    params = arguments.param
    with checkout_of(arguments.before) as before, tempfile.TemporaryDirectory() as compiled:
        for state in (before, ROOT):
            cost(state, tree, compiled, params)
        pairs = []
        for number in range(arguments.pairs):
            order = (before, ROOT) if number % 2 == 0 else (ROOT, before)
            found = {state: cost(state, tree, compiled, params) for state in order}
            pairs.append((found[before], found[ROOT]))
            report(f"pair {number + 1}", *pairs[-1])
    whole = median(old.whole_s / new.whole_s for old, new in pairs)
    steps = median(old.steps_s / new.steps_s for old, new in pairs)
    best = max(new.factor for _, new in pairs)
    print(f"median ratio: process {whole:.2f}, steps {steps:.2f}; best real-time factor {best:.2f}")


def report(name: str, old: Cost, new: Cost) -> None:
    """Print a line for one pair."""
    text = f"{name}: process {old.whole_s:.2f} s -> {new.whole_s:.2f} s CPU, "
    text += f"steps {old.steps_s:.2f} s -> {new.steps_s:.2f} s, "
    text += f"real-time factor {old.factor:.2f} -> {new.factor:.2f}, "
    print(text + f"{old.outcome} {new.outcome}", flush=True)


if __name__ == "__main__":
    main()
