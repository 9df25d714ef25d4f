"""``bt-run --resume``: from a record and a time to a run that goes on from there."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from bt_dualarm.cli.skill_import import imported_skills
from bt_dualarm.replay.record import Record, ReplayError
from bt_dualarm.replay.rerun import Changed
from bt_dualarm.replay.resume import parse_place, resumed
from bt_dualarm.runtime.run import Run
from bt_dualarm.runtime.shipped import find_tree
from bt_dualarm.runtime.signals import StopRequest

_REPLACED = ("seed", "duration", "renderer", "reality")
"""Options that a record knows; those given on the command line take their place."""


def opened_again(arguments: argparse.Namespace, kept: Path | None, stop: StopRequest) -> Run:
    """The run of a record at the time from which it is to go on.

    Args:
        arguments: Arguments of ``bt-run``.
        kept: Folder that the run is recorded in, if it is.
        stop: Request to end early.

    Raises:
        ReplayError: There is no such record or time, or the past is another.
        DualArmError: The run cannot be made.
    """
    folder, time = parse_place(arguments.resume)
    record = Record.read(folder)
    given = {name: getattr(arguments, name) for name in _REPLACED}
    options = {name: value for name, value in given.items() if value is not None}
    options |= {"watchdog": arguments.watchdog, "duration": arguments.duration}
    if kept is not None:
        if kept.resolve() == folder.resolve():
            raise ReplayError(f"{folder} is read: --record needs another folder")
        options |= {"record": kept, "frames": arguments.frames}
    tree = None if arguments.file is None else find_tree(arguments.file)
    registry = imported_skills("bt-run", arguments.skills, arguments.watchdog)
    changed = Changed(tree, options, dict(arguments.param))
    run = resumed(record, time, registry, changed, stop)
    if arguments.display != "quiet":
        print(f"the past is that of {folder} up to {run.time:.3f} s", file=sys.stderr)
    return run
