"""Skills in random sequences of two and three, judged by laws only (`sequence_laws`).

    python -m benchmarks.sequences [--pairs 100] [--triples 30] [--seed 0] [--jobs 1]
                                   [--reality lab]
    python -m benchmarks.sequences --only 17 [--length 2]

A sequence runs on one of five robots with one of three grippers or none. Something may be in its
hand from the start. Prints each breach of a law with the arguments that repeat it, then the counts:
sequences, those in which all leaves succeeded, honest failures by skill and code, and breaches by
their kind. Exit code 1 if a law was broken.
"""

from __future__ import annotations

import argparse
import logging
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache

from benchmarks.sequence_generator import REALITIES, SkillSequence, generate
from benchmarks.sequence_laws import ARM, KINDS, Breach, Referee, verdicts_at_the_end
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.outcome import RunResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.skill.registry import Registry

PROGRESS = 100
"""Sequences after which the counts so far are printed to standard error."""

MOST = 10
"""Kinds of honest failures that are printed."""


@dataclass(frozen=True)
class Played:
    """What came of one sequence.

    Attributes:
        seed: Seed of it.
        length: Number of its skills.
        label: Robot, gripper, reality and skills.
        leaves: Name, status, code and reason of each leaf.
        breaches: Laws that were broken.
        cpu_s: Seconds of the processor that it took.
    """

    seed: int
    length: int
    label: str
    leaves: tuple[tuple[str, str, str, str], ...]
    breaches: tuple[Breach, ...]
    cpu_s: float


@cache
def _registry() -> Registry:
    return Registry.load()


def judged(sequence: SkillSequence, registry: Registry) -> tuple[RunResult, tuple[Breach, ...]]:
    """What a sequence did, and the laws that it broke."""
    file = load_tree_file(sequence.file, registry.kinds)
    with Run(file, registry, RunOptions(renderer="ray")) as run:
        referee = Referee(run, sequence)
        run.watch(referee)
        result = run.finish()
    return result, (*referee.breaches, *verdicts_at_the_end(result, registry))


def play(seed: int, length: int, reality: str | None = None, skills: Sequence[str] = ()) -> Played:
    """Run the sequence of a seed and judge it; arguments as `generate`."""
    began = time.process_time()
    sequence = generate(seed, length, reality, skills)
    result, breaches = judged(sequence, _registry())
    names = {step.name for step in sequence.steps}
    leaves = tuple(
        (leaf.skill, leaf.status, leaf.code, leaf.reason)
        for leaf in result.arms[ARM].runs
        if leaf.path.rpartition("/")[2] in names
    )
    took = time.process_time() - began
    return Played(seed, length, sequence.label, leaves, breaches, took)


def _played(options: argparse.Namespace) -> Iterator[Played]:
    asked = [(options.seed + n, 2) for n in range(options.pairs)]
    asked += [(options.seed + n, 3) for n in range(options.triples)]
    if options.only is not None:
        asked = [(options.only, options.length)]
    reality = None if options.reality == "all" else options.reality
    if options.jobs == 1:
        for seed, length in asked:
            yield play(seed, length, reality)
        return
    with ProcessPoolExecutor(options.jobs) as pool:
        seeds, lengths = zip(*asked, strict=True)
        yield from pool.map(play, seeds, lengths, [reality] * len(asked))


def main() -> int:
    """Print breaches as they come, then the counts."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--triples", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--reality", choices=(*REALITIES, "all"), default="lab")
    parser.add_argument("--only", type=int, help="the one seed to run; tells of each leaf")
    parser.add_argument("--length", type=int, default=2, choices=(2, 3), help="of that one")
    parser.add_argument("--tell", action="store_true", help="print honest failures, too")
    options = parser.parse_args()
    logging.disable(logging.CRITICAL)  # a traceback is told as a breach
    sequences = successes = leaves = 0
    failures = Counter[str]()
    broken = Counter[str]()
    spent = 0.0
    for one in _played(options):
        sequences = sequences + 1
        leaves = leaves + len(one.leaves)
        spent = spent + one.cpu_s
        successes += all(status == "SUCCESS" for _, status, _, _ in one.leaves)
        failures.update(f"{skill} {code}" for skill, status, code, _ in one.leaves if code)
        broken.update({breach.kind for breach in one.breaches})
        if options.only is not None:
            print(one.label)
            for leaf in one.leaves:
                print("   ", *leaf)
        elif options.tell:
            for skill, status, code, reason in one.leaves:
                if status != "SUCCESS":
                    print(f"    {one.seed} {one.label}: {skill}: {code}: {reason}", flush=True)
        for breach in one.breaches:
            again = f"--only {one.seed} --length {one.length} --reality {options.reality}"
            print(
                f"{again}: {one.label}\n    {breach.kind}: {breach.step}: {breach.what}", flush=True
            )
        if sequences % PROGRESS == 0:
            so_far = ", ".join(f"{count} {kind}" for kind, count in broken.items()) or "none"
            print(f"{sequences} sequences, breaches: {so_far}", file=sys.stderr, flush=True)
    print(f"{sequences} sequences, {leaves} leaves, {spent / max(sequences, 1):.1f} s each")
    print(f"  all leaves succeeded: {successes} of {sequences}")
    print(f"  leaves that failed honestly: {failures.total()} of {leaves}")
    for what, count in failures.most_common(MOST):
        print(f"    {count:5}  {what}")
    for kind in KINDS:
        print(f"  {kind}: {broken[kind]} of {sequences}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
