"""Laws of the source itself: imports point down the rooms, and the library keeps quiet."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.source import (
    MODULES,
    PACKAGE,
    SKILLS,
    circles,
    dotted_name,
    imports_of,
    inner_imports,
    parsed,
    room_of,
)

FLOORS = (
    {"errors", "pose", "share"},
    {"spec", "kernels", "recording"},
    {"world.urdf"},
    {"world.robots"},
    {"world.hardware", "world.nominal", "world.grippers"},
    {"world"},
    {"world.rendering", "motion.pinching"},
    {
        "world.cameras",
        "motion.paths",
        "motion.timing",
        "motion.kinematics",
        "motion.collision",
        "motion.chains",
        "motion.grasping",
    },
    {"motion.search"},
    {"vision", "motion.planning", "motion.setpoints", "motion.identification"},
    {"motion.safety", "motion.hits"},
    {"motion", "motion.control"},
    {"arm"},
    {"skill", "preflight"},
    {"tree"},
    {"runtime"},
    {"experiments", "replay", "testing", "tuning"},
    {"live"},
    {"cli"},
    {"__main__"},
)
"""The rooms of the package, lowest first; a room uses itself and what lies below its floor."""

FACADE = "bt_dualarm"
"""The table of contents: nothing inside uses it."""

ROOT_FILES = {"__init__", "__main__", "errors", "pose", "share"}
"""Four modules, and the one that Python asks for by ``python -m bt_dualarm``."""

FLOOR = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}


def test_every_module_lives_in_a_known_room() -> None:
    rooms = {room_of(dotted_name(path)) for path in MODULES} - {FACADE}
    assert rooms == set(FLOOR), "place the new room in FLOORS and in docs/design.md"


@pytest.mark.parametrize("path", MODULES, ids=dotted_name)
def test_imports_point_down_the_rooms(path: Path) -> None:
    own = room_of(dotted_name(path))
    if own == FACADE:
        return
    upward = [
        f"line {line}: {name}"
        for line, name in imports_of(path)
        if name.startswith(f"{FACADE}.")
        and room_of(name) != own
        and FLOOR[room_of(name)] >= FLOOR[own]
    ]
    assert upward == []


@pytest.mark.parametrize("path", MODULES, ids=dotted_name)
def test_nothing_inside_imports_the_facade(path: Path) -> None:
    assert [line for line, name in imports_of(path) if name == FACADE] == []


def test_no_files_import_one_another_in_a_circle() -> None:
    """Imports inside functions count: they hide a circle, they do not open it."""
    graph = {dotted_name(path): inner_imports(path) - {FACADE} for path in MODULES}
    del graph[FACADE]
    print(f"{len(graph)} files, {sum(map(len, graph.values()))} imports")
    assert circles(graph) == []


def test_a_circle_would_be_found() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": set(), "e": {"e"}}
    assert circles(graph) == [["a", "b", "c"], ["e"]]


def test_the_root_holds_its_four_files() -> None:
    assert {path.stem for path in PACKAGE.glob("*.py")} == ROOT_FILES


@pytest.mark.parametrize("path", SKILLS, ids=lambda path: path.stem)
def test_skills_know_only_the_facade(path: Path) -> None:
    """Shipped skills have no privileges: what they need, any author can import."""
    inside = [
        f"line {line}: {name}"
        for line, name in imports_of(path)
        if name.split(".")[0] in {FACADE, "skills"} and name != FACADE
    ]
    assert inside == []


def calls_and_raises(path: Path) -> Iterator[tuple[int, str]]:
    """Line and name of everything that a file calls or raises, as it is written."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Call):
            yield node.lineno, ast.unparse(node.func)
        elif isinstance(node, ast.Raise) and node.exc is not None:
            yield node.lineno, ast.unparse(node.exc)


@pytest.mark.parametrize("path", [*MODULES, *SKILLS], ids=dotted_name)
def test_only_the_command_line_prints_asks_and_exits(path: Path) -> None:
    if path.is_relative_to(PACKAGE / "cli") or path == PACKAGE / "__main__.py":
        return
    forbidden = {"print", "input", "breakpoint", "exit", "quit", "sys.exit", "os._exit"}
    found = [
        f"line {line}: {name}"
        for line, name in calls_and_raises(path)
        if name in forbidden or name.startswith("SystemExit")
    ]
    assert found == []
