"""Random programs of two to four arms with signals, rendezvous and claims, checked against laws.

    python -m benchmarks.coordination [--programs 2000] [--seed 0] [--processes 5]

Each program is ticked without physics until all trees have ended, in every order of its arms. The
laws: every program ends (every leaf ends on its own, so a program that hangs has an undetected
deadlock); the status changes of each arm are the same in every order; a claim is held by one arm at
a time; all participants of a rendezvous meet in one tick. The digest over all programs is computed
in several processes with different hash seeds. Programs that the file check rejects are counted
separately, by cause.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from bt_dualarm.spec.problems import SpecError
from tests.behaviors.ticking import Cells, is_over

TICKS = 400
"""Ticks after which a program counts as hanging; the longest that ends takes about 100."""

CELL = """
signals:
  go: {{type: boolean, written_by: [{arms}], initial: false}}
  count: {{type: integer, written_by: [{arms}], initial: 0}}
zones: {{a: {{size: [0.1, 0.1, 0.1]}}, b: {{size: [0.1, 0.1, 0.1]}}, c: {{size: [0.1, 0.1, 0.1]}}}}
rendezvous: {{all: [{arms}], first: [{first}], last: [{last}]}}
"""


class Program:
    """A random program, which depends on the seed only."""

    def __init__(self, seed: int) -> None:
        self._rng = random.Random(seed)  # noqa: S311 - no secret
        self.arms = [f"arm{number + 1}" for number in range(self._rng.randint(2, 4))]
        arms = self.arms
        self.cell = CELL.format(
            arms=", ".join(arms), first=", ".join(arms[:2]), last=", ".join(arms[-2:])
        )
        trees = {arm: self._node(arm, 3) for arm in arms}
        # The file check rejects a rendezvous in which a participant has no leaf, so each arm also
        # attends the rendezvous of the others, at the end, where it may be too late.
        self.trees = {arm: self._with_missing(arm, tree, trees) for arm, tree in trees.items()}

    def _with_missing(self, arm: str, tree: str, trees: dict[str, str]) -> str:
        points = {"all": self.arms, "first": self.arms[:2], "last": self.arms[-2:]}
        missing = [
            f"{{meet: {{at: {name}{self._rng.choice(['', ', timeout: 8'])}}}}}"
            for name, arms in points.items()
            if arm in arms
            and f"at: {name}" not in tree
            and any(f"at: {name}" in trees[other] for other in arms)
        ]
        return f"{{sequence: [{', '.join([tree, *missing])}]}}" if missing else tree

    def _node(self, arm: str, depth: int) -> str:
        node_types = ["act", "act", "signal", "await", "meet", "meet"]
        if depth > 0:
            node_types += ["sequence"] * 5 + ["claim"] * 4
            node_types += ["selector", "parallel", "retry", "timeout", "force_success"]
        node_type = self._rng.choice(node_types) if depth < 3 else "sequence"
        return str(getattr(self, f"_{node_type}")(arm, depth))

    def _act(self, _arm: str, _depth: int) -> str:
        script = "R" * self._rng.randint(0, 4) + self._rng.choice("SSSSF")
        return f"{{act: {{script: {script}}}}}"

    def _signal(self, _arm: str, _depth: int) -> str:
        if self._rng.random() < 0.5:
            return "{signal: go}"
        return f"{{signal: {{signal: count, value: {self._rng.randint(0, 3)}}}}}"

    def _await(self, _arm: str, _depth: int) -> str:
        timeout = self._rng.choice(["", "", f", timeout: {self._rng.randint(1, 6)}"])
        if self._rng.random() < 0.4:
            return f"{{await: {{signal: go{timeout}}}}}"
        values = self._rng.choice(["latest", "every"])
        least = self._rng.randint(0, 3)
        return (
            f"{{await: {{signal: count, relation: greater_or_equal, to: {least}, "
            f"values: {values}{timeout}}}}}"
        )

    def _meet(self, arm: str, _depth: int) -> str:
        points = ["all"]
        points += ["first"] if arm in self.arms[:2] else []
        points += ["last"] if arm in self.arms[-2:] else []
        timeout = self._rng.choice(["", "", "", f", timeout: {self._rng.randint(1, 6)}"])
        return f"{{meet: {{at: {self._rng.choice(points)}{timeout}}}}}"

    def _claim(self, arm: str, depth: int) -> str:
        zones = sorted(self._rng.sample("abc", self._rng.choice([1, 1, 2])))
        timeout = self._rng.choice(["", "", "", f", timeout: {self._rng.randint(1, 6)}"])
        child = self._node(arm, depth - 1)
        return f"{{claim: {{zone: [{', '.join(zones)}]{timeout}, child: {child}}}}}"

    def _children(self, arm: str, depth: int) -> str:
        count = self._rng.randint(2, 3)
        return ", ".join(self._node(arm, depth - 1) for _ in range(count))

    def _sequence(self, arm: str, depth: int) -> str:
        return f"{{sequence: [{self._children(arm, depth)}]}}"

    def _selector(self, arm: str, depth: int) -> str:
        return f"{{selector: [{self._children(arm, depth)}]}}"

    def _parallel(self, arm: str, depth: int) -> str:
        policy = self._rng.choice(["all", "any"])
        return f"{{parallel: {{policy: {policy}, children: [{self._children(arm, depth)}]}}}}"

    def _retry(self, arm: str, depth: int) -> str:
        return (
            f"{{retry: {{times: {self._rng.randint(2, 3)}, child: {self._node(arm, depth - 1)}}}}}"
        )

    def _timeout(self, arm: str, depth: int) -> str:
        seconds = self._rng.randint(3, 12)
        return f"{{timeout: {{seconds: {seconds}, child: {self._node(arm, depth - 1)}}}}}"

    def _force_success(self, arm: str, depth: int) -> str:
        return f"{{force_success: {{child: {self._node(arm, depth - 1)}}}}}"


def _broken_laws(cells: Cells) -> Iterator[str]:
    """Laws that are violated between two ticks."""
    held: dict[str, str] = {}
    for request in cells.cell.claims():
        for resource in request.resources:
            if request.granted_s is not None and held.setdefault(resource, request.arm) != (
                request.arm
            ):
                yield f"{resource} is held by {held[resource]} and {request.arm}"


def play(
    program: Program, order: tuple[str, ...], folder: Path
) -> tuple[dict[str, str], list[str]]:
    """Status changes of each arm as text, and the violated laws."""
    cells = Cells(folder, program.cell, {arm: program.trees[arm] for arm in order})
    broken: list[str] = []
    for _ in range(TICKS):
        cells.tick()
        broken += _broken_laws(cells)
        if all(map(is_over, cells.trees.values())):
            break
    else:
        broken.append(f"it hangs: {[one.target for one in cells.cell.waits()]}")
    traces = {
        arm: "\n".join(
            f"{change.time:g} {change.path} {change.new} {change.code} {change.reason}"
            for change in cells.events
            if change.arm == arm
        )
        for arm in program.arms
    }
    return traces, broken


def evaluate(
    seed: int, folder: Path, counts: Counter[str], *, orders: int | None = None
) -> tuple[str, list[str]]:
    """Status changes of a program as text, and the laws that it violates, in some or all orders."""
    program = Program(seed)
    first: dict[str, str] | None = None
    broken: list[str] = []
    for order in itertools.islice(itertools.permutations(program.arms), orders):
        try:
            traces, wrong = play(program, order, folder)
        except SpecError as error:
            counts["rejected by the check"] += 1
            cause = "a wait that never ends" if "never ends" in str(error) else (
                "claims that block each other" if "for good" in str(error) else "other errors"
            )  # fmt: skip
            counts[f"  for {cause}"] += 1
            return str(error), []
        broken += wrong
        if first is None:
            first = traces
        elif traces != first:
            broken.append(f"the order {order} leads to other status changes")
    counts["ended"] += 1
    text = "\n".join((first or {}).values())
    for code in ("DEADLOCK", "PARTNER_GONE", "TIMEOUT"):
        counts[f"  with {code}"] += code in text
    return text, broken


def main() -> int:
    """Print the outcomes of all programs; returns 1 if a law was violated."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--programs", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=5)
    parser.add_argument("--digest-only", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    counts = Counter[str]()
    digest = hashlib.sha256()
    violations = 0
    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(arguments.seed, arguments.seed + arguments.programs):
            orders = 1 if arguments.digest_only else None
            text, broken = evaluate(seed, Path(folder), counts, orders=orders)
            digest.update(text.replace(folder, "").encode())
            violations += bool(broken)
            if broken and not arguments.digest_only:
                print(f"program {seed}: {broken[0]}", flush=True)
    if arguments.digest_only:
        print(digest.hexdigest())
        return 0
    spent = time.process_time() - began
    print(f"{arguments.programs} programs, {violations} that break a law; {spent:.0f} s of CPU")
    for label, count in counts.items():
        print(f"{label}: {count}")
    digests = {digest.hexdigest()}
    command = [sys.executable, "-m", "benchmarks.coordination", "--digest-only"]
    command += ["--programs", str(arguments.programs), "--seed", str(arguments.seed)]
    for number in range(1, arguments.processes):
        environment = os.environ | {"PYTHONHASHSEED": str(number)}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        digests.add(done.stdout.strip())
    print(f"digests in {arguments.processes} processes: {len(digests)} ({min(digests)[:16]})")
    return int(bool(violations) or len(digests) != 1)


if __name__ == "__main__":
    raise SystemExit(main())
