"""Random sequences of two and three skills, checked against laws (`sequence_laws`).

    python -m benchmarks.sequences [--pairs 100] [--triples 30] [--seed 0] [--jobs 1]
                                   [--reality lab]
    python -m benchmarks.sequences --only 17 [--length 2]

A sequence runs on one of five robots with one of three grippers or none, and may begin with an
object in its hand. Prints each breach of a law with the arguments that reproduce it, then the
counts: sequences, those in which all leaves succeeded, reported failures by skill and code, and
breaches by kind. Exits with code 1 after a breach.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from benchmarks.campaign import Campaign, add_options, registry
from benchmarks.sequence_generator import REALITIES, SkillSequence, generate
from benchmarks.sequence_laws import ARM, KINDS, Breach, Referee, final_breaches
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.outcome import RunResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.skill.registry import Registry

MOST = 10
"""Number of skills with codes of reported failures that are printed."""


@dataclass(frozen=True)
class PlayedSequence:
    """Result of one sequence.

    Attributes:
        seed: Seed of the sequence.
        length: Number of its skills.
        label: Robot, gripper, reality and skills.
        leaves: Name, status, code and reason of each leaf.
        breaches: Breaches of laws.
    """

    seed: int
    length: int
    label: str
    leaves: tuple[tuple[str, str, str, str], ...]
    breaches: tuple[Breach, ...]


def judged(sequence: SkillSequence, skills: Registry) -> tuple[RunResult, tuple[Breach, ...]]:
    """Run a sequence; returns its result and its breaches of laws."""
    file = load_tree_file(sequence.file, skills.kinds)
    with Run(file, skills, RunOptions(renderer="ray")) as run:
        referee = Referee(run, sequence)
        run.watch(referee)
        result = run.finish()
    return result, (*referee.breaches, *final_breaches(result, skills))


def play(
    seed: int, length: int, reality: str | None = None, skills: Sequence[str] = ()
) -> PlayedSequence:
    """Run the sequence of a seed; arguments as for `generate`."""
    sequence = generate(seed, length, reality, skills)
    result, breaches = judged(sequence, registry())
    names = {step.name for step in sequence.steps}
    leaves = tuple(
        (leaf.skill, leaf.status, leaf.code, leaf.reason)
        for leaf in result.arms[ARM].runs
        if leaf.path.rpartition("/")[2] in names
    )
    return PlayedSequence(seed, length, sequence.label, leaves, breaches)


def play_case(**case: Any) -> dict[str, Any]:  # Any: arguments of `play`
    """Result of one sequence as JSON values."""
    one = play(**case)
    failed = [f"{skill} {code}" for skill, status, code, _ in one.leaves if status != "SUCCESS"]
    kinds = ", ".join(sorted({breach.kind for breach in one.breaches}))
    outcome = "BREACH" if kinds else "FAILURE" if failed else "SUCCESS"
    return {"outcome": outcome, "code": kinds or ", ".join(failed[:1]), **asdict(one)}


def _cases(options: argparse.Namespace) -> list[dict[str, Any]]:
    chosen = [(options.seed + n, 2) for n in range(options.pairs)]
    chosen += [(options.seed + n, 3) for n in range(options.triples)]
    if options.only is not None:
        chosen = [(options.only, options.length)]
    reality = None if options.reality == "all" else options.reality
    return [{"seed": seed, "length": length, "reality": reality} for seed, length in chosen]


def main() -> int:
    """Print breaches as they occur, then the counts; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--triples", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--reality", choices=(*REALITIES, "all"), default="lab")
    parser.add_argument("--only", type=int, help="run only this seed, and print each leaf")
    parser.add_argument(
        "--length", type=int, default=2, choices=(2, 3), help="number of skills with --only"
    )
    parser.add_argument("--failures", action="store_true", help="also print reported failures")
    add_options(parser, jobs=1)
    options = parser.parse_args()
    with Campaign(options) as campaign:
        return run_cases(options, campaign)


def run_cases(options: argparse.Namespace, campaign: Campaign) -> int:
    """Run the sequences; print breaches as they occur, then the counts."""
    sequences = successes = leaves = 0
    failures = Counter[str]()
    broken = Counter[str]()
    for _, found in campaign.run(play_case, _cases(options)):
        one = PlayedSequence(
            found["seed"],
            found["length"],
            found["label"],
            tuple((skill, status, code, reason) for skill, status, code, reason in found["leaves"]),
            tuple(Breach(**breach) for breach in found["breaches"]),
        )
        sequences = sequences + 1
        leaves = leaves + len(one.leaves)
        successes += all(status == "SUCCESS" for _, status, _, _ in one.leaves)
        failures.update(f"{skill} {code}" for skill, status, code, _ in one.leaves if code)
        broken.update({breach.kind for breach in one.breaches})
        if options.only is not None:
            print(one.label)
            for leaf in one.leaves:
                print("   ", *leaf)
        elif options.failures:
            for skill, status, code, reason in one.leaves:
                if status != "SUCCESS":
                    print(f"    {one.seed} {one.label}: {skill}: {code}: {reason}", flush=True)
        for breach in one.breaches:
            again = f"--only {one.seed} --length {one.length} --reality {options.reality}"
            print(
                f"{again}: {one.label}\n    {breach.kind}: {breach.step}: {breach.what}",
                flush=True,
            )
    print(
        f"{sequences} sequences, {leaves} leaves, {campaign.cpu_s / max(sequences, 1):.1f} s each"
    )
    print(f"  all leaves succeeded: {successes} of {sequences}")
    print(f"  leaves that reported a failure: {failures.total()} of {leaves}")
    for label, count in failures.most_common(MOST):
        print(f"    {count:5}  {label}")
    for kind in KINDS:
        print(f"  {kind}: {broken[kind]} of {sequences}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
