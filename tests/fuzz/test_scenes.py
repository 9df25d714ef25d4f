"""Mutated scenes, in YAML and MJCF, and mutated cookbook trees are refused or can be opened.

Opening composes the world and sets up arms, objects and trees.
"""

from __future__ import annotations

import os
import random
import shutil
import time
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
import yaml

import bt_dualarm as bt
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.runtime.file_check import check
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.problems import errors
from tests.fuzz import mjcf_mutation
from tests.fuzz.seeds import dice_of
from tests.spec.mutation import mutated

TIMES = float(os.environ.get("BT_DUALARM_FUZZ_TIMES", "1"))
"""Factor of the number of mutants: 1 takes 4 s of one core; `make fuzz` uses more."""

CHUNKS = 8 if TIMES > 1 else 2
MUTANTS = int(TIMES * 40 / CHUNKS)

LONGEST_S = 10.0
"""CPU time limit for one mutant, s: a run's world takes at most a tenth of it."""

COOKBOOK = Path(__file__).parents[2] / "docs" / "cookbook"


def read(path: Path) -> Any:
    """Content of a YAML file, in which `on` is a name, not a truth value."""

    def named(data: Any) -> Any:
        if isinstance(data, dict):
            return {"on" if key is True else key: named(value) for key, value in data.items()}
        return [named(value) for value in data] if isinstance(data, list) else data

    return named(yaml.safe_load(path.read_text(encoding="utf-8")))


def write_mutant(dice: random.Random, folder: Path) -> tuple[Path, str]:
    """Writes a tree and its scene, one of them mutated; returns the tree and the mutated text."""
    tree = dice.choice(sorted(COOKBOOK.glob("*.yaml")))
    data = read(tree)
    scene = COOKBOOK / data["world"]["scene"]
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "scenes").mkdir(parents=True)
    shutil.copy(scene, folder / "scenes")
    path = folder / tree.name
    if dice.random() < 0.3:
        text = mutated(data, dice)
        path.write_text(text, encoding="utf-8")
        return path, text
    shutil.copy(tree, path)
    target = folder / "scenes" / scene.name
    if scene.suffix == ".xml":
        content = mjcf_mutation.mutated(ET.parse(scene).getroot(), dice)  # noqa: S314 - own data
    else:
        content = mutated(read(scene), dice).encode()
    target.write_bytes(content)
    return path, content.decode(errors="replace")


@pytest.mark.slow
@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_mutated_scene_or_tree_is_refused_or_can_be_opened(
    chunk: int, tmp_path: Path, registry: Registry
) -> None:
    """No mutant raises another exception, takes long, or is accepted but cannot be opened."""
    dice = dice_of(100 + chunk)
    accepted = 0
    for number in range(MUTANTS):
        path, text = write_mutant(dice, tmp_path / "mutant")
        began = time.process_time()
        try:
            found = check(path, registry.kinds)
            assert all(str(problem) for problem in found.problems)
            if not errors(found.problems) and found.file is not None:
                accepted += 1
                bt.open(path).close()
        except DualArmError as error:
            raise AssertionError(f"mutant {number} was accepted, then refused:\n{text}") from error
        except Exception as error:
            raise AssertionError(f"mutant {number}:\n{text}") from error
        assert time.process_time() - began < LONGEST_S, text
    # One in 25 is accepted: a small number of mutants may include none.
    assert accepted > 0 or TIMES < 10
