"""A tree on a clock that the test advances, and its ticks as a table."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from textwrap import indent
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from bt_dualarm.behaviors.load import ArmTree, build_tree, load_tree_file
from bt_dualarm.behaviors.report import NodeView, StatusChange
from bt_dualarm.core.errors import Failure
from bt_dualarm.runtime.outcome import SeriesLog
from bt_dualarm.skill.cell import CellAccess, CellState
from bt_dualarm.skill.registry import kind_of, yaml_name
from bt_dualarm.skill.skill import Skill, SkillContext
from bt_dualarm.spec.node_types import PortModel, port

if TYPE_CHECKING:
    from bt_dualarm.arm.arm import Arm

LETTERS = {"INVALID": "-", "RUNNING": "R", "SUCCESS": "S", "FAILURE": "F"}


class Act(Skill):
    """Follows its script, one letter per tick; ``|`` separates the scripts of its starts."""

    class Ports(PortModel):
        script: str = port(..., "R, S or F for each tick")

    failures = {"SCRIPTED": "the script says so"}  # noqa: RUF012 - as `Skill` declares it
    ports: Ports
    starts: Mapping[str, list[int]]

    def run(self) -> Iterator[float | None]:
        scripts = self.ports.script.split("|")
        count = self.starts.setdefault(self.context.name, [0])  # type: ignore[attr-defined]
        script = scripts[min(count[0], len(scripts) - 1)]
        count[0] += 1
        for letter in script:
            if letter == "R":
                yield None
            elif letter == "F":
                raise Failure("SCRIPTED", "the script says so")


class Stage:
    """One tree, ticked at whole seconds."""

    def __init__(self, folder: Path, tree: str, *more: type[Skill]) -> None:
        self.now = 0.0
        self.events: list[StatusChange] = []
        self.released: list[str] = []
        starts: dict[str, list[int]] = {}
        act = type("Act", (Act,), {"__doc__": "Acts.", "starts": starts})
        self.skills: dict[str, type[Skill]] = {yaml_name(s): s for s in (act, *more)}
        node_types = {name: kind_of(skill, "the test") for name, skill in self.skills.items()}
        file = folder / "tree.yaml"
        head = f"bt_dualarm: 1\n{self.head()}arms:\n{self.other_arms()}"
        head += "  arm1:\n    robot: ur5\n    tree:\n"
        file.write_text(head + indent(tree.strip("\n"), "      "))
        self.tree = self.build(load_tree_file(file, node_types).arms["arm1"].tree)

    def head(self) -> str:
        """Sections of the file before its arms."""
        return ""

    def other_arms(self) -> str:
        """Arms of the file besides this one."""
        return ""

    def build(self, spec: Any) -> ArmTree:
        clock: Callable[[], float] = lambda: self.now  # noqa: E731 - read late, on purpose
        return build_tree("arm1", spec, self.skills, self.context, clock, self.events.append)

    def context(self, path: str) -> SkillContext:
        arm = cast(
            "Arm",
            SimpleNamespace(
                release=lambda **_: self.released.append(path),
                pending_fault=lambda: None,
                touched=lambda _: {},
                enter=lambda **_: None,
            ),
        )
        log = logging.getLogger("bt_dualarm.test")
        record = partial(SeriesLog().add, "arm1", path)
        rng = np.random.default_rng(0)
        return SkillContext(path, arm, lambda: self.now, rng, log, record)

    def tick(self, seconds: float = 1.0) -> str:
        """Ticks, then advances time; returns the letters of all nodes, parents before children."""
        self.tree.tick()
        letters = self.letters
        self.now += seconds
        return letters

    @property
    def letters(self) -> str:
        return " ".join(LETTERS[view.status] for view in _flat(self.tree.view()))

    def table(self, ticks: int) -> list[str]:
        return [self.tick() for _ in range(ticks)]


class Cells:
    """The trees of several arms that share a cell, ticked together at whole seconds.

    Args:
        folder: Where the file is written.
        cell: The section ``cell`` of the file.
        trees: Tree of each arm, by the arm's name, in the order of the file.
    """

    def __init__(self, folder: Path, cell: str, trees: Mapping[str, str]) -> None:
        self.now = 0.0
        self.events: list[StatusChange] = []
        act = type("Act", (Act,), {"__doc__": "Acts.", "starts": {}})
        self.skills: dict[str, type[Skill]] = {yaml_name(act): act}
        node_types = {name: kind_of(skill, "the test") for name, skill in self.skills.items()}
        text = f"bt_dualarm: 1\ncell:\n{indent(cell.strip(chr(10)), '  ')}\narms:\n"
        for arm, tree in trees.items():
            text += (
                f"  {arm}:\n    robot: ur5\n    tree:\n{indent(tree.strip(chr(10)), '      ')}\n"
            )
        path = folder / "cell.yaml"
        path.write_text(text)
        self.file = load_tree_file(path, node_types)
        self.cell = CellState(self.file.cell, lambda: self.now)
        self.trees: dict[str, ArmTree] = {}
        for arm in self.file.arms:
            self.spawn(arm)

    def spawn(self, arm: str) -> None:
        """Spawns an arm with its tree at the beginning."""
        access = CellAccess(self.cell, arm)

        def context(path: str) -> SkillContext:
            nothing = SimpleNamespace(
                release=lambda **_: None,
                pending_fault=lambda: None,
                touched=lambda _: {},
                enter=lambda **_: None,
            )
            return SkillContext(
                path,
                cast("Arm", nothing),
                lambda: self.now,
                np.random.default_rng(0),
                logging.getLogger("bt_dualarm.test"),
                cell=access,
            )

        def note(change: StatusChange) -> None:
            self.cell.note_change()
            self.events.append(change)

        root = self.file.arms[arm].tree
        clock: Callable[[], float] = lambda: self.now  # noqa: E731 - read late, on purpose
        self.trees[arm] = build_tree(arm, root, self.skills, context, clock, note, cell=access)
        self.cell.arm_back(arm)

    def remove(self, arm: str) -> None:
        """Removes an arm from the world between two ticks."""
        self.trees.pop(arm).halt()
        self.cell.arm_gone(arm, f"was removed at {self.now:.2f} s")

    def tick(self) -> str:
        """Ticks all trees, then advances time; returns letters of all nodes, ``|`` between arms."""
        running = {arm: tree for arm, tree in self.trees.items() if not is_over(tree)}
        for arm, tree in running.items():
            tree.tick()
            if is_over(tree):
                self.cell.arm_gone(arm, f"has ended with {tree.status} at {self.now:.2f} s")
        self.cell.commit({arm: tree for arm, tree in running.items() if not is_over(tree)})
        letters = self.letters
        self.now += 1.0
        return letters

    @property
    def letters(self) -> str:
        return " | ".join(
            " ".join(LETTERS[view.status] for view in _flat(tree.view()))
            for tree in self.trees.values()
        )

    def table(self, ticks: int) -> list[str]:
        return [self.tick() for _ in range(ticks)]

    def failures(self) -> list[tuple[str, str, str]]:
        """Arm, code and reason of every leaf or node that has failed by itself."""
        return [
            (change.arm, change.code, change.reason)
            for change in self.events
            if change.new == "FAILURE" and change.code
        ]


def is_over(tree: ArmTree) -> bool:
    """Whether a tree has ended."""
    return tree.status in ("SUCCESS", "FAILURE")


def _flat(view: NodeView) -> Iterator[NodeView]:
    yield view
    for child in view.children:
        yield from _flat(child)


def rows(table: str) -> list[str]:
    """Rows of a table in a test: ``3 | R S -  # why`` without its number and comment."""
    lines = [line.partition("#")[0].strip() for line in table.strip().splitlines()]
    return [line.partition("|")[2].strip() for line in lines if line]
