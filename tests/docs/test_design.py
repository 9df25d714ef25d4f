"""docs/design.md is true: its rooms are the rooms, and its walks lead through files that exist."""

from __future__ import annotations

import re
from itertools import pairwise

import pytest

from tests.source import MODULES, PACKAGE, ROOT, dotted_name, room_of
from tests.test_layers import FACADE, FLOOR

PAGE = (ROOT / "docs" / "design.md").read_text(encoding="utf-8")
LONGEST_WALK = 25

Walk = list[tuple[int, str, str]]


def walks() -> dict[str, Walk]:
    """Number, file and name of each line of the walks, by the walk's title."""
    section = PAGE.split("## Two walks")[1].split("\n## ")[0]
    rows = re.compile(r"^\| (\d+) \| `([\w/.]+)` \| `(\w+)` \|", re.MULTILINE)
    parts = section.split("\n### ")[1:]
    return {
        part.split("\n")[0]: [(int(n), file, name) for n, file, name in rows.findall(part)]
        for part in parts
    }


@pytest.mark.parametrize("title", walks())
def test_a_walk_leads_through_files_and_names_that_exist(title: str) -> None:
    walk = walks()[title]
    assert 10 < len(walk) <= LONGEST_WALK
    assert all(later == earlier + 1 for (earlier, *_), (later, *_) in pairwise(walk))
    for _, file, name in walk:
        place = ROOT / file if file.startswith("skills/") else PACKAGE / file
        assert place.is_file(), file
        defined = re.search(rf"^(?:class|def) {name}\b", place.read_text("utf-8"), re.MULTILINE)
        assert defined, f"{file} defines no {name}"


def test_the_rooms_of_the_page_are_the_rooms_of_the_package() -> None:
    table = PAGE.split("## Rooms")[1].split("\n## ")[0]
    floors: dict[str, int] = {}
    for floor, rooms in re.findall(r"^\| (\d+) \| ([^|]+) \|", table, re.MULTILINE):
        for room in re.findall(r"`([\w/]+)`", rooms):
            floors[room.strip("/").replace("/", ".")] = int(floor)
    rooms = {room_of(dotted_name(path)) for path in MODULES} - {FACADE, "motion", "__main__"}
    assert set(floors) == rooms
    assert floors == {room: FLOOR[room] for room in rooms}


def test_every_file_that_the_page_names_exists() -> None:
    for name in re.findall(r"`((?:\w+/)+\w+\.py)`", PAGE):
        assert any((root / name).is_file() for root in (ROOT, PACKAGE)), name
