"""The arguments of ``bt-run``: what may be given, and what is refused before anything is read."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from bt_dualarm.cli.words import add_params, add_skills, add_view

_EXAMPLES = """\
examples:
  bt-run pick_and_track                     a shipped tree, by name from any folder
  bt-run my_tree.yaml --record out/first    keep summary, events, samples and plots
  bt-run circle --display log --seed 3      a line per change; another arrangement
  bt-run pick_and_track --real-time         no faster than the clock on the wall
  bt-run --resume out@12.4                  go on from 12.4 s of the run recorded in out
  bt-run my_tree.yaml --resume out@12.4     with a tree edited since; its past must be the same
  bt-run pick_and_track --view              look at it in a browser; pause, step, breakpoints
  bt-run my_tree.yaml --watch --view        edit the tree while it runs
  bt-run --list                             what is shipped

exit code:
  0 every tree succeeded   1 one failed or did not finish   2 the file or the command is wrong
  129, 130, 143 stopped by SIGHUP (the terminal was closed), SIGINT (Ctrl-C) or SIGTERM; once more:
  without waiting for arms and plots
  154 code of a skill did not return in time (--watchdog)
"""


def command_line() -> argparse.ArgumentParser:
    """The parser of ``bt-run``; building it imports nothing heavy."""
    parser = argparse.ArgumentParser(
        prog="bt-run",
        description="Run the behaviour trees of a file, one per robot arm, in one simulated world.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("file", metavar="FILE", nargs="?", help="a tree file, or the name of a shipped one")
    add("--list", action="store_true", help="list the shipped trees and end")
    add(
        "--resume",
        metavar="DIR@S",
        help="go on from S simulated seconds of the record in DIR, with its tree or with FILE",
    )
    add(
        "--record",
        metavar="DIR",
        type=_folder,
        help="write summary, events, samples and plots there",
    )
    add("--frames", action="store_true", help="keep the cameras' pictures there, too")
    add(
        "--display",
        choices=("live", "log", "quiet"),
        help="live: the trees, redrawn; log: a line per change; quiet: errors only "
        "(default: live in a terminal, else log)",
    )
    add("--ascii", action="store_true", help="draw with ASCII characters only")
    add("--seed", metavar="N", type=seed, help="of everything random (default: the file's)")
    _add_conditions(parser)
    add("--dry-run", action="store_true", help="build everything, move nothing, print the trees")
    add_skills(parser)
    add_params(parser)
    add("--version", action="store_true", help="print the version and end")
    return parser


def _add_conditions(parser: argparse.ArgumentParser) -> None:
    """What a run depends on besides its file."""
    add = parser.add_argument
    add("--duration", metavar="S", type=_seconds, help="end after so many simulated seconds")
    add(
        "--renderer",
        choices=("ray", "gl", "auto"),
        help="of the cameras: ray casting, OpenGL, or OpenGL where it works (default: the file's)",
    )
    add(
        "--reality",
        choices=("ideal", "lab", "rough"),
        help="how far all arms are from what is believed of them (default: the file's)",
    )
    add("--view", action="store_true", help="show it in a browser, held until you let it go")
    add_view(parser)
    add(
        "--watch",
        action="store_true",
        help="take up the trees whenever the file is saved: running leaves that are unchanged go "
        "on, others begin anew; what has errors is told, and the run goes on as it was",
    )
    add("--real-time", action="store_true", help="run no faster than the clock on the wall")
    add(
        "--watchdog",
        metavar="S",
        type=_budget,
        default=30.0,
        help="end the run when a tick or callback of a skill, or the import of all of them, has "
        "not returned for so many seconds on the wall (default: 30; 0 for never)",
    )


def seed(text: str) -> int:
    """The value of ``--seed``."""
    if not text.isascii() or not text.isdecimal() or int(text) >= 2**32:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 to 4294967295")
    return int(text)


def _folder(text: str) -> Path:
    if not text.strip():
        raise argparse.ArgumentTypeError("the folder needs a name; '.' is the current folder")
    return Path(text)


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not (seconds > 0 and math.isfinite(seconds)):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of seconds above 0")
    return seconds


def _budget(text: str) -> float:
    return math.inf if text.strip() in ("0", "off") else _seconds(text)
