"""The page about metrics explains every number that is written."""

from __future__ import annotations

import ast
from dataclasses import fields
from pathlib import Path

import pytest

from bt_dualarm.core.share import share_dir
from bt_dualarm.runtime.outcome import Holding
from bt_dualarm.safety.guard import GuardReport
from tests.glossary import METRICS

SKILLS = sorted(share_dir("skills").glob("*.py"))


def written_by(path: Path) -> set[str]:
    """Names in ``self.metrics["name"] = …`` and ``self.metrics |= {"name": …}``."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Subscript) and ast.unparse(node.value) == "self.metrics":
            found.add(ast.literal_eval(node.slice))
        elif isinstance(node, ast.AugAssign) and ast.unparse(node.target) == "self.metrics":
            keys = [k for d in ast.walk(node.value) if isinstance(d, ast.Dict) for k in d.keys]
            found |= {ast.literal_eval(key) for key in keys if key is not None}
    return found


@pytest.mark.parametrize("path", SKILLS, ids=lambda path: path.stem)
def test_metrics_of_a_skill_are_explained(path: Path) -> None:
    """Metrics from the façade are checked in the runs of the shipped trees."""
    assert written_by(path) <= METRICS


def test_metrics_of_the_runner_are_explained() -> None:
    held = {field.name for field in fields(Holding)} - {"arm", "object"}
    assert {field.name for field in fields(GuardReport)} | held <= METRICS
