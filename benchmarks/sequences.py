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
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from benchmarks.campaign import Campaign, add_options, registry
from benchmarks.sequence_generator import REALITIES, SkillSequence, generate
from benchmarks.sequence_laws import ARM, KINDS, Breach, Referee, verdicts_at_the_end
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.outcome import RunResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.skill.registry import Registry

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
    """

    seed: int
    length: int
    label: str
    leaves: tuple[tuple[str, str, str, str], ...]
    breaches: tuple[Breach, ...]


def judged(sequence: SkillSequence, skills: Registry) -> tuple[RunResult, tuple[Breach, ...]]:
    """What a sequence did, and the laws that it broke."""
    file = load_tree_file(sequence.file, skills.kinds)
    with Run(file, skills, RunOptions(renderer="ray")) as run:
        referee = Referee(run, sequence)
        run.watch(referee)
        result = run.finish()
    return result, (*referee.breaches, *verdicts_at_the_end(result, skills))


def play(seed: int, length: int, reality: str | None = None, skills: Sequence[str] = ()) -> Played:
    """Run the sequence of a seed and judge it; arguments as `generate`."""
    sequence = generate(seed, length, reality, skills)
    result, breaches = judged(sequence, registry())
    names = {step.name for step in sequence.steps}
    leaves = tuple(
        (leaf.skill, leaf.status, leaf.code, leaf.reason)
        for leaf in result.arms[ARM].runs
        if leaf.path.rpartition("/")[2] in names
    )
    return Played(seed, length, sequence.label, leaves, breaches)


def played(**case: Any) -> dict[str, Any]:  # Any: arguments of `play`
    """What came of one sequence."""
    one = play(**case)
    failed = [f"{skill} {code}" for skill, status, code, _ in one.leaves if status != "SUCCESS"]
    kinds = ", ".join(sorted({breach.kind for breach in one.breaches}))
    outcome = "BREACH" if kinds else "FAILURE" if failed else "SUCCESS"
    return {"outcome": outcome, "code": kinds or ", ".join(failed[:1]), **asdict(one)}


def _cases(options: argparse.Namespace) -> list[dict[str, Any]]:
    asked = [(options.seed + n, 2) for n in range(options.pairs)]
    asked += [(options.seed + n, 3) for n in range(options.triples)]
    if options.only is not None:
        asked = [(options.only, options.length)]
    reality = None if options.reality == "all" else options.reality
    return [{"seed": seed, "length": length, "reality": reality} for seed, length in asked]


def main() -> int:
    """Print breaches as they come, then the counts."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--triples", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--reality", choices=(*REALITIES, "all"), default="lab")
    parser.add_argument("--only", type=int, help="the one seed to run; tells of each leaf")
    parser.add_argument("--length", type=int, default=2, choices=(2, 3), help="of that one")
    parser.add_argument("--tell", action="store_true", help="print honest failures, too")
    add_options(parser, jobs=1)
    options = parser.parse_args()
    with Campaign(options) as campaign:
        return run_cases(options, campaign)


def run_cases(options: argparse.Namespace, campaign: Campaign) -> int:
    """Run the sequences, print breaches as they come, then the counts."""
    sequences = successes = leaves = 0
    failures = Counter[str]()
    broken = Counter[str]()
    for _, found in campaign.run(played, _cases(options)):
        one = Played(
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
        elif options.tell:
            for skill, status, code, reason in one.leaves:
                if status != "SUCCESS":
                    print(f"    {one.seed} {one.label}: {skill}: {code}: {reason}", flush=True)
        for breach in one.breaches:
            again = f"--only {one.seed} --length {one.length} --reality {options.reality}"
            print(
                f"{again}: {one.label}\n    {breach.kind}: {breach.step}: {breach.what}", flush=True
            )
    print(
        f"{sequences} sequences, {leaves} leaves, {campaign.cpu_s / max(sequences, 1):.1f} s each"
    )
    print(f"  all leaves succeeded: {successes} of {sequences}")
    print(f"  leaves that failed honestly: {failures.total()} of {leaves}")
    for what, count in failures.most_common(MOST):
        print(f"    {count:5}  {what}")
    for kind in KINDS:
        print(f"  {kind}: {broken[kind]} of {sequences}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
