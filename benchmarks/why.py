"""How often ``bt-why`` ranks the planted cause first: mistakes in shipped trees, one run each.

    python -m benchmarks.why [WORD] [--unseen | --interactions | --generated [--seed N] [--count N]]

``--unseen`` runs the mistakes that were planted before the rules were checked for them;
``--interactions`` likewise those in which two features interact; ``--generated`` random tasks with
one random fault each, of which those do not count that fail without it, or succeed with it. Prints
a line for each mistake and the count. A cause counts if it is the first of the first story, has a
planted kind, and its sentence contains the expected names.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import yaml

import bt_dualarm
from benchmarks.campaign import Campaign, add_options
from benchmarks.why_generated import generated
from benchmarks.why_interactions import interactions
from benchmarks.why_mistake import Mistake, Tree
from benchmarks.why_mistakes import mistakes
from benchmarks.why_mistakes_unseen import unseen
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.diagnosis.evidence import Cause
from bt_dualarm.diagnosis.story import stories
from bt_dualarm.replay.record import Record
from bt_dualarm.sweeps.calls import SKIPPED


def first_cause(mistake: Mistake, folder: Path) -> Cause | None:
    """The cause that is ranked first after a run of the mistake, or None.

    Raises:
        DualArmError: The file check rejects the mistake.
    """
    bt_dualarm.run(mistake.tree, record=folder, duration=mistake.duration)
    text = stories(Record.read(folder))
    return text[0].causes[0] if text else None


def is_named(mistake: Mistake, cause: Cause | None) -> bool:
    """Whether the cause is the planted one."""
    if cause is None or cause.kind not in (mistake.kind, *mistake.also):
        return False
    return all(name in f"{cause.sentence} {cause.leaf}" for name in mistake.names)


SETS: Final[Mapping[str, Callable[[], Iterable[Mistake]]]] = {
    "mistakes": mistakes,
    "--unseen": unseen,
    "--interactions": interactions,
}
GENERATED: Final = "--generated"


def of_family(family: str, seed: int, count: int) -> list[Mistake]:
    """All mistakes of a family; seed and count apply to the generated one."""
    return list(generated(seed, count) if family == GENERATED else SETS[family]())


def evaluate(family: str, name: str, seed: int, count: int) -> dict[str, Any]:
    """Whether the planted cause of a mistake is ranked first, and the lines to print."""
    mistakes_ = of_family(family, seed, count)
    mistake = next(mistake for mistake in mistakes_ if mistake.name == name)
    original = mistake.original
    if original is not None and not _succeeds(original, mistake.duration):
        return _not_counted(f"{mistake.name}: fails without it")
    lines = []
    cause = None
    with tempfile.TemporaryDirectory() as folder:
        try:
            cause = first_cause(mistake, Path(folder) / "record")
        except DualArmError as error:
            if original is not None:
                return _not_counted(f"{mistake.name}: the file check says {error}")
            lines.append(f"rejected by the file check: {error}")
    if cause is None and original is not None:
        return _not_counted(f"{mistake.name}: succeeds with it")
    good = is_named(mistake, cause)
    text = "nothing" if cause is None else f"{cause.kind}: {cause.sentence}"
    lines.append(f"{'yes' if good else 'NO '} {mistake.name} ({mistake.kind}) <- {text}")
    code = "" if good else mistake.kind
    return {"outcome": "SUCCESS" if good else "FAILURE", "code": code, "lines": lines}


def _succeeds(tree: Tree, duration: float) -> bool:
    try:
        return bt_dualarm.run(tree, duration=duration).outcome == "SUCCESS"
    except DualArmError:  # the arms or objects of this world would overlap
        return False


def _not_counted(why: str) -> dict[str, Any]:
    return {"outcome": SKIPPED, "lines": [f"--  {why}"]}


def main(arguments: list[str]) -> None:
    """Run all mistakes whose names contain these words."""
    parser = argparse.ArgumentParser(description="how often bt-why ranks the planted cause first")
    parser.add_argument("words", nargs="*", metavar="WORD")
    for option in (*list(SETS)[1:], GENERATED):
        parser.add_argument(option, dest="family", action="store_const", const=option)
    parser.add_argument("--seed", type=int, default=0, help="of the generated mistakes")
    parser.add_argument("--count", type=int, default=60, help="of the generated mistakes")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write the trees as YAML")
    parser.set_defaults(family="mistakes")
    add_options(parser)
    options = parser.parse_intermixed_args(arguments)
    word = " ".join(options.words)
    drawn = {"family": options.family, "seed": options.seed, "count": options.count}
    chosen = [mistake for mistake in of_family(**drawn) if word in mistake.name]
    if options.write is not None:
        options.write.mkdir(parents=True, exist_ok=True)
        for number, mistake in enumerate(chosen):
            text = yaml.safe_dump(mistake.tree, sort_keys=False, default_flow_style=None)
            (options.write / f"{number}.yaml").write_text(f"# {mistake.name}\n{text}", "utf-8")
    named = 0
    counted = 0
    with Campaign(options) as campaign:
        cases = [{**drawn, "name": mistake.name} for mistake in chosen]
        for _, found in campaign.run(evaluate, cases):
            named += found["outcome"] == "SUCCESS"
            counted += found["outcome"] != SKIPPED
            print("\n".join(found["lines"]), flush=True)
        print(f"the planted cause is ranked first for {named} of {counted} mistakes")


if __name__ == "__main__":
    main(sys.argv[1:])
