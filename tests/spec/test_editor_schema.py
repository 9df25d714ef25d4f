"""Schema for editors: it is up to date, and every shipped tree names it."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_dualarm.behaviors.language import LANGUAGE
from bt_dualarm.core.share import share_dir
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.reference import schema_text

SCHEMA = share_dir("assets") / "schema" / "tree.schema.json"
TREES = sorted(share_dir("trees").rglob("*.yaml"))
MODELINE = "# yaml-language-server: $schema="


def test_the_schema_is_up_to_date() -> None:
    hint = f"stale: renew it with: bt-skills --schema {SCHEMA}"
    assert SCHEMA.read_text(encoding="utf-8") == schema_text(
        {**LANGUAGE, **Registry.load().kinds}
    ), hint


@pytest.mark.parametrize("path", TREES, ids=lambda path: path.stem)
def test_every_shipped_tree_names_the_schema_in_its_first_line(path: Path) -> None:
    first = path.read_text(encoding="utf-8").splitlines()[0]
    assert first.startswith(MODELINE)
    assert (path.parent / first.removeprefix(MODELINE)).resolve() == SCHEMA.resolve()
