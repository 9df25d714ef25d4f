"""Licenses on the page about dependencies are those in the installed files."""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path

import pytest
import yaml

from bt_dualarm.core.share import share_dir
from bt_dualarm.robots.urdf_arm import robot_data_dir

PAGE = Path(__file__).parents[2] / "docs" / "dependencies.md"
ROWS = [
    [cell.strip() for cell in line.strip("|").split(" | ")]
    for line in PAGE.read_text(encoding="utf-8").splitlines()
    if line.startswith("|") and " | " in line
]
PACKAGES = {row[0].strip("| "): row[-1].strip("| ") for row in ROWS if "≥" in row[1]}
DOCS_ONLY = {
    re.split(r"[^\w-]", line)[0]
    for line in tomllib.loads((PAGE.parents[1] / "pyproject.toml").read_text(encoding="utf-8"))[
        "project"
    ]["optional-dependencies"]["docs"]
}
ROBOTS = {
    name: (row[1].strip("`"), row[2].strip("| "))
    for row in ROWS
    if row[1].endswith("_description`")
    for name in re.findall(r"`(\w+)`", row[0])
}


@pytest.mark.parametrize("package", PACKAGES)
def test_page_has_the_license_of_the_package(package: str) -> None:
    """Only packages whose metadata has an SPDX expression are checked."""
    try:
        named = metadata(package).json.get("license_expression")
    except PackageNotFoundError:
        assert package in DOCS_ONLY
        pytest.skip("only `make docs-html` installs it")
    if named is not None:
        assert str(named) in PACKAGES[package]


@pytest.mark.parametrize("page", sorted(share_dir("assets").glob("robots/*.yaml")), ids=str)
def test_page_has_the_license_of_the_robot(page: Path) -> None:
    folder, named = ROBOTS[page.stem]
    assert yaml.safe_load(page.read_text())["urdf"].startswith(f"{folder}/")
    readme = (robot_data_dir() / folder / "README.md").read_text()
    assert f"license: {named}\n" in readme
