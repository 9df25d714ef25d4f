"""``bt-why``: the diagnosis of a failure, from the record of a run."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence

from bt_dualarm.cli.entry import FAILED, SUCCEEDED, given_path

_EPILOG = """\
examples:
  bt-why out                       why the run recorded in out failed, or what it was waiting for
  bt-why out circle                why this leaf failed; arm2:circle selects the arm
  bt-why out 12.4                  what every arm was doing at 12.4 s, and what had just failed
  bt-why out --json                machine-readable output

exit code:
  0 explained   1 nothing failed, was missed or was running   2 no such record, leaf or time
"""


def main(argv: Sequence[str] | None) -> int:
    """Report why a run failed; returns the exit code."""
    arguments = _command_line().parse_args(argv)
    from bt_dualarm.diagnosis.story import goals_missed, state_of, stories, story_text
    from bt_dualarm.replay.record import Record

    record = Record.read(arguments.folder)
    found = stories(record, arguments.about)
    if arguments.json:
        state = {"name": record.name, "until_s": record.until, "torn": record.torn}
        print(json.dumps({**state, "stories": [story.as_dict() for story in found]}, indent=2))
    else:
        print(state_of(record))
        for story in found:
            print(f"\n{story_text(story)}")
        if not found:
            succeeded = (record.summary or {}).get("outcome") == "SUCCESS"
            print("every tree succeeded" if succeeded else "nothing failed")
        for line in goals_missed(record):
            print(line)
    return SUCCEEDED if found or goals_missed(record) else FAILED


def _command_line() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="bt-why",
        description="Explain why a run failed: the leaf, its cause, and the evidence.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("folder", metavar="DIR", type=given_path, help="a folder written by bt-run --record")
    add("about", metavar="LEAF|TIME", nargs="?", help="name or path of a leaf, or a time in s")
    add("--json", action="store_true", help="print one JSON object")
    return parser
