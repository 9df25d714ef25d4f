"""How often ``bt-why`` names the planted cause first: mistakes in shipped trees, one run each.

    python -m benchmarks.why [WORD] [--unseen | --interactions]

With ``--unseen`` those that were planted before the rules were looked at for them, likewise with
``--interactions`` those in which two features meet. Prints a line
for each mistake and the count. A cause counts if it is the first of the first story, of the kind
that was planted, and its sentence has the names that belong to it.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

import bt_dualarm
from benchmarks.why_interactions import interactions
from benchmarks.why_mistake import Mistake
from benchmarks.why_mistakes import mistakes
from benchmarks.why_mistakes_unseen import unseen
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.diagnosis.evidence import Cause
from bt_dualarm.diagnosis.story import stories
from bt_dualarm.replay.record import Record


def first_cause(mistake: Mistake, folder: Path) -> Cause | None:
    """What is named first after a run of the mistake; None if nothing is."""
    try:
        bt_dualarm.run(mistake.tree, record=folder, duration=mistake.duration)
    except DualArmError as error:
        print(f"refused before it moved: {error}")
        return None
    told = stories(Record.read(folder))
    return told[0].causes[0] if told else None


def is_named(mistake: Mistake, cause: Cause | None) -> bool:
    """Whether that is the cause that was planted."""
    if cause is None or cause.kind != mistake.kind:
        return False
    return all(name in f"{cause.sentence} {cause.leaf}" for name in mistake.names)


def main(words: list[str]) -> None:
    """Run all mistakes that have these words in their names."""
    sets: dict[str, Callable[[], Iterable[Mistake]]] = {
        "--unseen": unseen,
        "--interactions": interactions,
    }
    asked = [sets[each] for each in words if each in sets]
    planted = (asked or [mistakes])[0]()
    word = " ".join(each for each in words if each not in sets)
    chosen = [mistake for mistake in planted if word in mistake.name]
    named = 0
    with tempfile.TemporaryDirectory() as folder:
        for number, mistake in enumerate(chosen):
            cause = first_cause(mistake, Path(folder) / str(number))
            good = is_named(mistake, cause)
            named += good
            said = "nothing" if cause is None else f"{cause.kind}: {cause.sentence}"
            print(
                f"{'yes' if good else 'NO '} {mistake.name} ({mistake.kind}) <- {said}", flush=True
            )
    print(f"the planted cause is named first for {named} of {len(chosen)} mistakes")


if __name__ == "__main__":
    main(sys.argv[1:])
