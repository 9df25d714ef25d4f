"""Laws of the source itself: imports point down the layers, and the library keeps quiet."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "bt_dualarm"

LAYERS = (
    {"errors", "pose", "share"},
    {"spec"},
    {"world"},
    {"motion", "vision"},
    {
        *("arm", "arm_state", "arm_motion", "arm_planning", "arm_travel"),
        *("arrival", "curve", "tracking", "scoring"),
        *("skill", "registry", "preflight"),
    },
    {"tree"},
    {"run"},
    {"experiments", "testing", "tuning"},
    {"cli"},
)
"""The rooms of the package, lowest first; a room may use its own layer and those before it."""

FACADE = "__init__"
"""What authors of skills import; it offers what lies up to layer 4, and nothing inside uses it."""

FACADE_LAYER = 4

MODULES = sorted(PACKAGE.rglob("*.py"))
SKILLS = sorted((ROOT / "skills").rglob("*.py"))


def room_of(dotted: str) -> str:
    """The room of ``bt_dualarm.room.module``; the façade is a room of its own."""
    parts = dotted.split(".")
    return parts[1] if len(parts) > 1 else FACADE


def layer_of(room: str) -> int:
    if room == FACADE:
        return FACADE_LAYER
    return next(number for number, rooms in enumerate(LAYERS) if room in rooms)


def dotted_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def is_module(dotted: str) -> bool:
    place = ROOT.joinpath(*dotted.split("."))
    return place.is_dir() or place.with_suffix(".py").is_file()


def imports_of(path: Path) -> Iterator[tuple[int, str]]:
    """Line and absolute dotted name of everything that a file imports, wherever it does so."""
    package = dotted_name(path) if path.stem == "__init__" else dotted_name(path).rpartition(".")[0]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            origin = node.module or ""
            if node.level:
                parents = package.split(".")[: len(package.split(".")) - node.level + 1]
                origin = ".".join([*parents, origin] if origin else parents)
            for alias in node.names:
                name = f"{origin}.{alias.name}"
                yield node.lineno, name if is_module(name) else origin


def test_every_module_lives_in_a_known_room() -> None:
    rooms = {room_of(dotted_name(path)) for path in MODULES} - {FACADE}
    assert rooms <= set().union(*LAYERS), "place the new room in LAYERS and in docs/design.md"


@pytest.mark.parametrize("path", MODULES, ids=dotted_name)
def test_imports_point_down_the_layers(path: Path) -> None:
    own = layer_of(room_of(dotted_name(path)))
    upward = [
        f"line {line}: {name}"
        for line, name in imports_of(path)
        if name.split(".")[0] == "bt_dualarm" and layer_of(room_of(name)) > own
    ]
    assert upward == []


@pytest.mark.parametrize("path", MODULES, ids=dotted_name)
def test_nothing_inside_imports_the_facade(path: Path) -> None:
    assert [line for line, name in imports_of(path) if name == "bt_dualarm"] == []


def test_rooms_of_one_layer_do_not_import_one_another_in_a_circle() -> None:
    uses: dict[str, set[str]] = {}
    for path in MODULES:
        room = room_of(dotted_name(path))
        names = {name for _, name in imports_of(path) if name.startswith("bt_dualarm.")}
        uses.setdefault(room, set()).update({room_of(name) for name in names} - {room, FACADE})
    while uses:
        free = [room for room, used in uses.items() if not used & set(uses)]
        assert free, f"these rooms import one another in a circle: {sorted(uses)}"
        for room in free:
            del uses[room]


@pytest.mark.parametrize("path", SKILLS, ids=lambda path: path.stem)
def test_skills_know_only_the_facade(path: Path) -> None:
    """Shipped skills have no privileges: what they need, any author can import."""
    inside = [
        f"line {line}: {name}"
        for line, name in imports_of(path)
        if name.split(".")[0] in {"bt_dualarm", "skills"} and name != "bt_dualarm"
    ]
    assert inside == []


def calls_and_raises(path: Path) -> Iterator[tuple[int, str]]:
    """Line and name of everything that a file calls or raises, as it is written."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            yield node.lineno, ast.unparse(node.func)
        elif isinstance(node, ast.Raise) and node.exc is not None:
            yield node.lineno, ast.unparse(node.exc)


@pytest.mark.parametrize("path", [*MODULES, *SKILLS], ids=lambda path: path.stem)
def test_only_the_command_line_prints_asks_and_exits(path: Path) -> None:
    if path.is_relative_to(PACKAGE / "cli"):
        return
    forbidden = {"print", "input", "breakpoint", "exit", "quit", "sys.exit", "os._exit"}
    found = [
        f"line {line}: {name}"
        for line, name in calls_and_raises(path)
        if name in forbidden or name.startswith("SystemExit")
    ]
    assert found == []
