"""``bt-faults``: makes every leaf of a tree fail, raise and hang, and shows what is handled."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bt_dualarm.cli.entry import FAILED, SUCCEEDED, add_skills, given_path, seed, with_trials
from bt_dualarm.runtime.interruption import StopRequest

if TYPE_CHECKING:
    from bt_dualarm.sweeps.engine import Engine

_EPILOG: Final = """\
examples:
  bt-faults pick_and_transport               which faults of which leaves are not handled
  bt-faults my_tree.yaml --out out/faults    with the records of all failed runs
  bt-faults circle --pairs 20 --hardware 30  and sampled pairs, and faults of hardware and world

Each leaf that runs is made to fail, raise an exception and hang: before its first step, in the
middle, and when it would succeed. One sign each, in this order:
  ✔ the task succeeded anyway   ✘ the run failed   ⚠ a rule was broken: a false success, a
  violated invariant, arms that touch, a joint beyond its limits or moving after the end of
  its tree, a crash                  · no such moment

exit code: 0 no rule was broken, 1 one was, 2 the tree cannot be used or fails without faults,
130 or 143 interrupted: finished trials are kept
"""


_LONGEST_S: Final = 1800.0
"""Wall-clock seconds after which a run counts as hung: no fault may keep code from returning."""


def main(argv: Sequence[str] | None) -> int:
    """Inject faults into every leaf; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="bt-faults",
        description="Make every leaf of a tree fail, raise and hang; show what is handled.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("tree", metavar="FILE", help="a tree file, or the name of a shipped tree")
    add("--seed", metavar="N", type=seed, default=0, help="seed of all runs (0)")
    add(
        "--pairs", metavar="N", type=int, default=0, help="also N sampled pairs of these faults (0)"
    )
    add(
        "--hardware",
        metavar="N",
        type=int,
        default=0,
        help="also N sampled faults of joints, cameras, objects, planner and partners (0)",
    )
    add("--jobs", metavar="N", type=int, help="worker processes (default: one per core)")
    add(
        "--out",
        metavar="DIR",
        type=given_path,
        default=Path("out/faults"),
        help="folder (out/faults)",
    )
    add("--ascii", action="store_true", help="draw with ASCII characters only")
    add_skills(parser)
    arguments = parser.parse_args(argv)
    return with_trials("bt-faults", lambda stop: _run(arguments, stop))


def _run(arguments: argparse.Namespace, stop: StopRequest) -> int:
    from bt_dualarm.cli.bt_sweep import shown_progress
    from bt_dualarm.sweeps.api import engine_of
    from bt_dualarm.sweeps.faults import PAGE, inject_faults, lines_of, sample_lines, summary_of

    start = engine_of(arguments.jobs, _LONGEST_S, None)
    with ExitStack() as stack:

        @cache
        def engine() -> Engine:
            started = start()
            stack.callback(started.close)
            return started

        progress = stack.enter_context(shown_progress(quiet=False))
        campaign = inject_faults(
            arguments.tree,
            arguments.out,
            engine,
            seed=arguments.seed,
            pairs=arguments.pairs,
            hardware=arguments.hardware,
            skills=tuple(arguments.skills),
            stop=stop,
            progress=progress,
        )
    print("\n".join(lines_of(campaign, ascii_only=arguments.ascii or not _is_utf8())))
    for line in sample_lines(campaign, ascii_only=arguments.ascii or not _is_utf8()):
        print(line)
    print(summary_of(campaign))
    for one in campaign.trials:
        if one.is_breach:
            print(f"  {one.sentence}: {one.outcome} {one.why}")
    print(f"page: {arguments.out / PAGE}")
    if stop.asked:
        print("bt-faults: interrupted; run the same command to continue", file=sys.stderr)
    return FAILED if any(one.is_breach for one in campaign.trials) else SUCCEEDED


def _is_utf8() -> bool:
    return (sys.stdout.encoding or "").lower().replace("-", "") == "utf8"
