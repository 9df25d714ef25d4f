"""Cost of a tick of 100 running leaves, compared with bare py_trees, in one process.

Prints microseconds per tick of each (the best of many alternating rounds) and their ratio.
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
    """Skill that runs forever."""

    def run(self) -> Iterator[float | None]:
        """Yield forever."""
        while True:
            yield None


def ours() -> Callable[[], Any]:
    """Tick of a parallel node of our leaves, which run skills."""
    idle = SimpleNamespace(
        enter=lambda anew: None,  # noqa: ARG005 - a leaf calls it by this name
        release=lambda: None,
        pending_fault=lambda: None,
    )
    context: Any = SkillContext(
        "busy",
        idle,  # type: ignore[arg-type]  # sufficient here
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
    """Tick of a parallel node of py_trees behaviors that stay RUNNING."""
    root = py_trees.composites.Parallel("parallel", py_trees.common.ParallelPolicy.SuccessOnAll())
    root.add_children([py_trees.behaviours.Running(f"leaf {i}") for i in range(LEAVES)])
    return root.tick_once


def best_of_rounds(ticks: list[Callable[[], Any]]) -> list[float]:
    """Microseconds per tick of each in its best round."""
    best = [float("inf")] * len(ticks)
    for _ in range(ROUNDS):
        for index, tick in enumerate(ticks):
            seconds = timeit.timeit(tick, number=TICKS)
            best[index] = min(best[index], seconds / TICKS * 1e6)
    return best


def main() -> None:
    """Measure both, and print the figures."""
    ours_us, bare_us = best_of_rounds([ours(), bare()])
    print(f"tick of {LEAVES} running leaves: ours {ours_us:.0f} us, py_trees {bare_us:.0f} us")
    print(f"ratio {ours_us / bare_us:.2f}")


if __name__ == "__main__":
    main()
