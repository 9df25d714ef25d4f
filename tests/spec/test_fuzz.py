"""Mutated files: only the project's own errors, in bounded time; check and builder agree."""

from __future__ import annotations

import importlib
import logging
import os
import re
import time
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from bt_dualarm.behaviors.load import build_tree, check_file, load_tree_file
from bt_dualarm.core.share import share_dir
from bt_dualarm.skill.registry import Registry
from bt_dualarm.skill.skill import SkillContext
from bt_dualarm.spec.problems import errors
from tests.fuzz.seeds import dice_of
from tests.spec.mutation import mutated
from tests.spec.test_mistakes import FOLDER

FILES = int(os.environ.get("BT_DUALARM_FUZZ_FILES", "1000"))
"""Number of files, for 8 s of one core; a longer run sets the variable to more, say 160000."""

CHUNKS = 4
"""Test cases, which workers can share; each has its own seed."""


_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


@cache
def seeds() -> list[Any]:
    """Files to mutate: all shipped trees, and those mistaken files that are YAML."""
    found = []
    for path in sorted([*share_dir("trees").rglob("*.yaml"), *FOLDER.glob("*.yaml")]):
        try:
            data = yaml.load(path.read_text(), _LOADER)  # noqa: S506 - a safe one
        except (yaml.YAMLError, ValueError):
            continue
        if isinstance(data, dict) and len(str(data)) < 10_000:
            found.append(data)
    return found


def build(path: Path, registry: Registry) -> None:
    """Build every tree of an accepted file; nothing is ticked."""
    arm: Any = SimpleNamespace(
        release=lambda **_: None, pending_fault=lambda: None, enter=lambda **_: None
    )
    arm.touched = lambda _: {}
    log = logging.getLogger("fuzz")
    rng = np.random.default_rng(0)
    context = SkillContext("leaf", arm, lambda: 0.0, rng, log)
    file = load_tree_file(path, registry.kinds)
    for name, spec in file.arms.items():
        build_tree(
            name, spec.tree, registry.skills, lambda _: context, lambda: 0.0, lambda _: None
        ).view()


LONGEST_S = 5.0
"""CPU seconds for one file: none needs a second on an idle machine, and what grows without bound
needs more on any machine."""


@pytest.mark.slow
@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_mutated_files_are_built_or_refused_in_time(
    chunk: int, tmp_path: Path, registry: Registry
) -> None:
    """No other exception is raised, no file takes long, and every accepted file can be built."""
    dice = dice_of(chunk)
    data = seeds()
    for module in {module for skill in registry.skills.values() for module in skill.needs}:
        importlib.import_module(module)  # takes a second by itself, once
    path = tmp_path / "task.yaml"
    accepted = 0
    for number in range(FILES // CHUNKS):
        text = mutated(dice.choice(data), dice)
        path.write_text(text)
        began = time.process_time()
        try:
            problems = check_file(path, registry.kinds)
            assert all(str(problem) for problem in problems)
            if not errors(problems) and re.search(
                r"^arms:\s", text, re.MULTILINE
            ):  # without arms, it is one to include
                accepted += 1
                build(path, registry)
        except Exception as error:
            raise AssertionError(f"file {number} of seed {chunk}:\n{text}") from error
        assert time.process_time() - began < LONGEST_S, text
    # One in a hundred is accepted: few files may have none.
    assert accepted > 0 or FILES < 10_000
