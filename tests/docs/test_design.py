"""docs/design.md has the packages, layers and names of the code."""

from __future__ import annotations

import re
import tomllib
from itertools import pairwise

import pytest

from bt_dualarm.behaviors.language import LANGUAGE
from tests.source import PACKAGE, ROOT

PAGE = (ROOT / "docs" / "design.md").read_text(encoding="utf-8")
LONGEST_WALK = 25

Walk = list[tuple[int, str, str]]


def layers() -> list[list[str]]:
    """Packages and modules of the contract in pyproject.toml, those of the lowest layer first."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    (lines,) = (contract["layers"] for contract in contracts if contract["id"] == "layers")
    return [re.split(r" [|:] ", line) for line in reversed(lines)]


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
def test_walk_leads_through_existing_files_and_names(title: str) -> None:
    walk = walks()[title]
    assert 10 < len(walk) <= LONGEST_WALK
    assert all(later == earlier + 1 for (earlier, *_), (later, *_) in pairwise(walk))
    for _, file, name in walk:
        path = ROOT / file if file.startswith("skills/") else PACKAGE / file
        assert path.is_file(), file
        defined = re.search(rf"^(?:class|def) {name}\b", path.read_text("utf-8"), re.MULTILINE)
        assert defined, f"{file} defines no {name}"


def test_packages_on_the_page_are_those_of_the_layers_and_the_code() -> None:
    table = PAGE.split("## Packages")[1].split("\n## ")[0]
    page = {
        name: int(n)
        for n, name in re.findall(r"^\| (\d+) \| `(\w+)(?:/|\.py)` \|", table, re.MULTILINE)
    }
    held = {name: number for number, layer in enumerate(layers(), 1) for name in layer}
    del held["__main__"]
    assert page == held
    packages = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    modules = {path.stem for path in PACKAGE.glob("*.py")} - {"__init__", "__main__"}
    assert set(page) == packages | modules


@pytest.mark.parametrize("page", ["docs/design.md", "CONTRIBUTING.md"])
def test_files_named_on_the_page_exist(page: str) -> None:
    """Files that the reader writes, like ``NAME.py``, are excepted."""
    text = (ROOT / page).read_text(encoding="utf-8")
    names = set(re.findall(r"`((?:\w+/)+\w+\.(?:py|yaml|md))`", text))
    assert names
    for name in names:
        written = "NAME" in name
        assert written or any((root / name).is_file() for root in (ROOT, PACKAGE)), name


def test_counts_of_node_types_and_skills_are_correct() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    skills = [path for path in (ROOT / "skills").glob("*.py") if not path.name.startswith("_")]
    assert f"a tree may contain: {len(skills)} skills" in readme
    assert f"of the {len(LANGUAGE)} node types" in PAGE
