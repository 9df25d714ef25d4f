"""``bt-replay``: shows a record in a browser, or repeats its run to check reproducibility."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from bt_dualarm.cli.entry import FAILED, SUCCEEDED, add_skills, add_view, given_path

if TYPE_CHECKING:
    from bt_dualarm.replay.rerun import Agreement


_EPILOG = """\
examples:
  bt-replay out                    a page with scene, trees, signals and reasons over time
  bt-replay out --check            run it again; report the first step and number that differ

exit code:
  0 every step is the same   1 a step differs   2 no such record, or it cannot be run again
  130 Ctrl-C, which ends the page
  154 a skill file could not be imported within 30 s
"""
_MOST_NUMBERS = 3


def main(argv: Sequence[str] | None) -> int:
    """Show or repeat a record; returns the exit code."""
    parser = _command_line()
    arguments = parser.parse_args(argv)
    if not arguments.check:
        if arguments.json:
            parser.error("--json requires --check")
        return _show(arguments)
    from bt_dualarm.cli.entry import imported_skills
    from bt_dualarm.replay.record import Record
    from bt_dualarm.replay.rerun import check_record

    record = Record.read(arguments.folder)
    found = check_record(record, imported_skills("bt-replay", arguments.skills))
    if arguments.json:
        print(json.dumps(_facts(found), indent=2))
    else:
        print("\n".join(_lines(found)))
    return SUCCEEDED if found.agrees else FAILED


def _show(arguments: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C."""
    from threading import Event

    from bt_dualarm.viewer.past import RecordView
    from bt_dualarm.viewer.server import Served

    served = Served(RecordView(arguments.folder), arguments.view_port, arguments.view_host)
    served.begin()
    try:
        print(f"serving until Ctrl-C: {served.url}", file=sys.stderr, flush=True)
        Event().wait()
    finally:
        served.end()
    return SUCCEEDED


def _command_line() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="bt-replay",
        description="Show a record in a browser, or run it again and compare every step.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("folder", metavar="DIR", type=given_path, help="a folder written by bt-run --record")
    add("--check", action="store_true", help="compare states and statuses, step by step")
    add("--json", action="store_true", help="print one JSON object, with --check")
    add_view(parser)
    add_skills(parser)
    return parser


def _lines(found: Agreement) -> Iterator[str]:
    from bt_dualarm.spec.node_types import counted

    for sentence in found.changed:
        yield f"changed since: {sentence}"
    differs = found.difference
    if differs is None and found.agrees:
        hashed = ", and the hash of all states" if found.hash_agrees else ""
        yield f"the same: {counted(found.steps, 'step')}, {found.time_s:.3f} s{hashed}"
        return
    if differs is None:
        yield "no step differs, but the hash of all states differs"
        return
    yield f"differs at step {differs.step}, {differs.time_s:.3f} s (of {found.until_s:.3f} s)"
    for number in differs.numbers[:_MOST_NUMBERS]:
        yield f"  {number.name}: {number.recorded!r} in the record, {number.now!r} now"
    left_out = len(differs.numbers) - _MOST_NUMBERS
    if left_out > 0:
        yield f"  and {counted(left_out, 'more number')}"
    if differs.event:
        yield f"  {differs.event}"
    elif differs.doing:
        yield f"  running at that time: {', '.join(differs.doing)}"


def _facts(found: Agreement) -> dict[str, object]:
    differs = found.difference
    difference = None
    if differs is not None:
        difference = {**vars(differs), "numbers": [vars(number) for number in differs.numbers]}
    return {**vars(found), "agrees": found.agrees, "difference": difference}
