"""The reports of all leaves of one tree, in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

from bt_dualarm.tree.first_and_last import FirstAndLast
from bt_dualarm.tree.report import LeafReport

MOST_RUNS = 200
"""Runs of one leaf that are kept from its beginning, and as many of the latest."""


class LeafReports:
    """Reports of the leaves of one tree, in the order in which their runs began.

    A tree that repeats something for hours would fill the memory: of a leaf that runs more often
    than twice `MOST_RUNS` the runs in between are dropped. No leaf that ever ran is forgotten.
    """

    def __init__(self) -> None:
        self._numbers = count()
        self._of: dict[str, FirstAndLast[tuple[int, LeafReport]]] = {}

    @property
    def left_out(self) -> int:
        """Number of runs that were dropped."""
        return sum(runs.left_out for runs in self._of.values())

    def add(self, report: LeafReport) -> None:
        """Take up a run that begins."""
        runs = self._of.setdefault(report.path, FirstAndLast(MOST_RUNS))
        runs.add((next(self._numbers), report))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __iter__(self) -> Iterator[LeafReport]:
        kept = [run for runs in self._of.values() for run in runs]
        for _, report in sorted(kept, key=lambda run: run[0]):
            yield report
