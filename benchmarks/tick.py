"""What a tick of 100 running leaves costs, ours against bare py_trees, in one process run.

Prints microseconds per tick of each (the best of many rounds, taken in turns) and their ratio.
"""

from __future__ import annotations

import logging
import timeit
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import py_trees

from bt_dualarm.behaviors.load import build_tree
from bt_dualarm.skill.skill import Skill, SkillContext
from bt_dualarm.spec.node_types import NodeSpec

LEAVES = 100
TICKS = 200
ROUNDS = 30


class Busy(Skill):
    """Runs for ever."""

    def run(self) -> Iterator[float | None]:
        """Never ends."""
        while True:
            yield None


def ours() -> Callable[[], Any]:
    """A parallel of skills on our leaves."""
    idle = SimpleNamespace(
        enter=lambda anew: None,  # noqa: ARG005 - a leaf calls it by this name
        release=lambda: None,
        pending_fault=lambda: None,
    )
    context: Any = SkillContext(
        "busy",
        idle,  # type: ignore[arg-type]  # all that a leaf asks of its arm here
        lambda: 0.0,
        np.random.default_rng(0),
        logging.getLogger(__name__),
    )
    leaves = tuple(NodeSpec("busy", "busy", {}) for _ in range(LEAVES))
    root = NodeSpec("parallel", "parallel", {}, leaves, ("children",) * LEAVES)
    tree = build_tree("arm", root, {"busy": Busy}, lambda _: context, lambda: 0.0, lambda _: None)
    tree.tick()
    if tree.status != "RUNNING":
        raise SystemExit(f"the tree is {tree.status}: there is nothing to measure")
    return tree.tick


def bare() -> Callable[[], Any]:
    """A parallel of py_trees' own behaviors that stay RUNNING."""
    root = py_trees.composites.Parallel("parallel", py_trees.common.ParallelPolicy.SuccessOnAll())
    root.add_children([py_trees.behaviours.Running(f"leaf {i}") for i in range(LEAVES)])
    return root.tick_once


def best_of_turns(ticks: list[Callable[[], Any]]) -> list[float]:
    """Microseconds per tick of each, the best round of each."""
    best = [float("inf")] * len(ticks)
    for _ in range(ROUNDS):
        for index, tick in enumerate(ticks):
            seconds = timeit.timeit(tick, number=TICKS)
            best[index] = min(best[index], seconds / TICKS * 1e6)
    return best


def main() -> None:
    """Measure and print."""
    ours_us, bare_us = best_of_turns([ours(), bare()])
    print(f"tick of {LEAVES} running leaves: ours {ours_us:.0f} us, py_trees {bare_us:.0f} us")
    print(f"ratio {ours_us / bare_us:.2f}")


if __name__ == "__main__":
    main()
