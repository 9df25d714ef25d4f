"""The commands: the only package that reads arguments, prints, and determines exit codes.

Input: the arguments of `bt-run`, `bt-check`, `bt-robot`, `bt-skills`, `bt-tune-color`,
`bt-experiments`, `bt-why`, `bt-replay`, `bt-record`, `bt-sweep`, `bt-compare`,
`bt-faults`; the terminal.
Output: text on standard output and standard error; the exit code.
Open first: `bt_run` (from a tree file to an exit code); `entry` has what all commands share: error
messages, Ctrl-C, exit codes, arguments; `safe_streams` has the standard streams.
"""

from __future__ import annotations

from collections.abc import Sequence

from bt_dualarm.cli.entry import entered

__all__ = [
    "check",
    "compare",
    "experiments",
    "faults",
    "record",
    "replay",
    "robot",
    "run",
    "skills",
    "sweep",
    "tune_color",
    "why",
]


def run(argv: Sequence[str] | None = None) -> int:
    """``bt-run``: run a tree file; returns the exit code.

    Args:
        argv: Arguments without the program's name; those of the process by default.
    """
    return entered("bt-run", argv)


def check(argv: Sequence[str] | None = None) -> int:
    """``bt-check``: check tree files; as `run`."""
    return entered("bt-check", argv)


def experiments(argv: Sequence[str] | None = None) -> int:
    """``bt-experiments``: run the tracking experiments and write their report; as `run`."""
    return entered("bt-experiments", argv)


def robot(argv: Sequence[str] | None = None) -> int:
    """``bt-robot``: write a description template for an arm from its URDF; as `run`."""
    return entered("bt-robot", argv)


def skills(argv: Sequence[str] | None = None) -> int:
    """``bt-skills``: show the node types and values of tree files; as `run`."""
    return entered("bt-skills", argv)


def tune_color(argv: Sequence[str] | None = None) -> int:
    """``bt-tune-color``: show what a color detects, and write new ranges; as `run`."""
    return entered("bt-tune-color", argv)


def why(argv: Sequence[str] | None = None) -> int:
    """``bt-why``: report why a recorded run failed; as `run`."""
    return entered("bt-why", argv)


def replay(argv: Sequence[str] | None = None) -> int:
    """``bt-replay``: show a record, or repeat its run and compare; as `run`."""
    return entered("bt-replay", argv)


def record(argv: Sequence[str] | None = None) -> int:
    """``bt-record``: export a record; as `run`."""
    return entered("bt-record", argv)


def sweep(argv: Sequence[str] | None = None) -> int:
    """``bt-sweep``: run a tree over seeds, parameters and realities; as `run`."""
    return entered("bt-sweep", argv)


def compare(argv: Sequence[str] | None = None) -> int:
    """``bt-compare``: compare two sweeps; as `run`."""
    return entered("bt-compare", argv)


def faults(argv: Sequence[str] | None = None) -> int:
    """``bt-faults``: make every leaf of a tree fail, raise and hang; as `run`."""
    return entered("bt-faults", argv)
