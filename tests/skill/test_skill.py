"""The base class that authors of skills meet."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from bt_dualarm.skill.skill import STANDARD_FAILURES, Skill, SkillContext
from bt_dualarm.spec.node_types import NoPorts

if TYPE_CHECKING:
    from bt_dualarm.arm.arm import Arm


def make(written: list[tuple[str, Any]] | None = None) -> Skill:
    arm = cast("Arm", object())
    log = logging.getLogger("test")
    rng = np.random.default_rng(0)
    context = SkillContext("leaf", arm, lambda: 1.5, rng, log)
    return Skill(NoPorts(), context, lambda *item: (written or []).append(item))


def test_what_a_skill_finds_in_its_hands() -> None:
    skill = make()
    assert skill.arm is skill.context.arm
    assert skill.time == 1.5
    assert skill.progress is None
    assert skill.metrics == {}


def test_the_base_has_no_behaviour() -> None:
    with pytest.raises(NotImplementedError):
        next(iter(make().run()))


def test_outputs_go_where_the_leaf_says() -> None:
    written: list[tuple[str, Any]] = [("first", 0)]
    make(written).output("length", 2.0)
    assert written[-1] == ("length", 2.0)


def test_standard_failures_are_codes_with_a_meaning() -> None:
    assert all(code.isupper() and meaning for code, meaning in STANDARD_FAILURES.items())
