"""How often ``bt-why`` ranks the planted cause first: mistakes in shipped trees, one run each.

    python -m benchmarks.why [WORD] [--unseen | --interactions]

``--unseen`` runs the mistakes that were planted before the rules were checked for them;
``--interactions`` likewise those in which two features interact. Prints a line for each mistake and
the count. A cause counts if it is the first of the first story, has the planted kind, and its
sentence contains the expected names.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import bt_dualarm
from benchmarks.campaign import Campaign, add_options
from benchmarks.why_interactions import interactions
from benchmarks.why_mistake import Mistake
from benchmarks.why_mistakes import mistakes
from benchmarks.why_mistakes_unseen import unseen
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.diagnosis.evidence import Cause
from bt_dualarm.diagnosis.story import stories
from bt_dualarm.replay.record import Record


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
    if cause is None or cause.kind != mistake.kind:
        return False
    return all(name in f"{cause.sentence} {cause.leaf}" for name in mistake.names)


SETS: Final[Mapping[str, Callable[[], Iterable[Mistake]]]] = {
    "mistakes": mistakes,
    "--unseen": unseen,
    "--interactions": interactions,
}


def evaluate(family: str, name: str) -> dict[str, Any]:
    """Whether the planted cause of a mistake is ranked first, and the lines to print."""
    mistake = next(mistake for mistake in SETS[family]() if mistake.name == name)
    lines = []
    cause = None
    with tempfile.TemporaryDirectory() as folder:
        try:
            cause = first_cause(mistake, Path(folder) / "record")
        except DualArmError as error:
            lines.append(f"rejected by the file check: {error}")
    good = is_named(mistake, cause)
    text = "nothing" if cause is None else f"{cause.kind}: {cause.sentence}"
    lines.append(f"{'yes' if good else 'NO '} {mistake.name} ({mistake.kind}) <- {text}")
    code = "" if good else mistake.kind
    return {"outcome": "SUCCESS" if good else "FAILURE", "code": code, "lines": lines}


def main(arguments: list[str]) -> None:
    """Run all mistakes whose names contain these words."""
    parser = argparse.ArgumentParser(description="how often bt-why ranks the planted cause first")
    parser.add_argument("words", nargs="*", metavar="WORD")
    for option in list(SETS)[1:]:
        parser.add_argument(option, dest="family", action="store_const", const=option)
    parser.set_defaults(family="mistakes")
    add_options(parser)
    options = parser.parse_intermixed_args(arguments)
    word = " ".join(options.words)
    names = [mistake.name for mistake in SETS[options.family]() if word in mistake.name]
    named = 0
    with Campaign(options) as campaign:
        cases = [{"family": options.family, "name": name} for name in names]
        for _, found in campaign.run(evaluate, cases):
            named += found["outcome"] == "SUCCESS"
            print("\n".join(found["lines"]), flush=True)
        print(f"the planted cause is ranked first for {named} of {len(names)} mistakes")


if __name__ == "__main__":
    main(sys.argv[1:])
