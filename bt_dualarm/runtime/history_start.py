"""What a history says before the first step: the tree, its skills' code, seeds, versions."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from bt_dualarm.recording.block import Block
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.processor import processor
from bt_dualarm.runtime.summary import json_ready, versions
from bt_dualarm.skill.skill import Skill
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.world.robots.page_path import is_page


@dataclass(frozen=True)
class Start:
    """What a run is made from.

    Attributes:
        file: The tree file, as it is run.
        skills: Classes of all skills, by name.
        options: What overrides the file.
        seed: Seed of everything random.
        renderer: Renderer of the cameras, None without any.
        timestep: Seconds of one physics step.
    """

    file: TreeFile
    skills: Mapping[str, type[Skill]]
    options: RunOptions
    seed: int
    renderer: str | None
    timestep: float

    def block(self) -> Block:
        """The first block of a history."""
        file, options = self.file, self.options
        objects = {name: thing.model_dump(mode="json") for name, thing in file.objects.items()}
        data = {
            "name": file.name,
            "path": str(file.path.absolute()),
            "texts": dict(file.texts),
            "params": dict(file.given),
            "seed": self.seed,
            "renderer": self.renderer,
            "reality": _reality(options),
            "duration": options.duration,
            "timestep": self.timestep,
            "time_limit": file.world.time_limit,
            "objects": objects,
            "arms": {name: self._arm(name) for name in file.arms},
            "pages": {name: _digest(path) for name, path in self._pages()},
            "skills": self._skills(),
            "versions": versions(),
            "processor": processor(),
        }
        return Block("start", {name: json_ready(value) for name, value in data.items()})

    def _arm(self, name: str) -> dict[str, object]:
        arm = self.file.arms[name]
        said = arm.model_dump(mode="json", exclude={"tree"})
        return {**said, "tree": tree_facts(arm.tree)}

    def _pages(self) -> Iterator[tuple[str, Path]]:
        """Robots' pages that lie beside the tree file."""
        for arm in self.file.arms.values():
            if is_page(arm.robot):
                yield arm.robot, self.file.root / arm.robot

    def _skills(self) -> dict[str, dict[str, str]]:
        """Files of the skills that the trees name, and digests of their code."""
        kinds = {node.kind for arm in self.file.arms.values() for node in arm.tree.walk()}
        found = {}
        for kind in sorted(kinds & self.skills.keys()):
            path = _file_of(self.skills[kind])
            found[kind] = {"file": str(path or ""), "sha256": "" if path is None else _digest(path)}
        return found


def _reality(options: RunOptions) -> object:
    if options.reality is None or isinstance(options.reality, str):
        return options.reality
    return options.reality.model_dump(mode="json", exclude_unset=True)


def tree_facts(node: NodeSpec) -> dict[str, object]:
    """A node with what is below it, and its place in the file."""
    place = node.place
    return {
        "kind": node.kind,
        "name": node.name,
        "ports": json_ready(dict(node.ports)),
        "place": f"{Path(place.file).name}:{place.line}" if place.line else Path(place.file).name,
        "children": [tree_facts(child) for child in node.children],
    }


def _file_of(skill: type[Skill]) -> Path | None:
    """The file of a skill; None of one that was typed in."""
    try:
        path = Path(inspect.getfile(skill))
    except (OSError, TypeError):
        return None
    return path if path.is_file() else None


def _digest(path: Path) -> str:
    """SHA-256 of a file, empty where it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""
