"""The base class of skills, as their authors use it."""

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


def test_skill_exposes_its_context() -> None:
    skill = make()
    assert skill.arm is skill.context.arm
    assert skill.time == 1.5
    assert skill.progress is None
    assert skill.metrics == {}


def test_base_class_has_no_behavior() -> None:
    with pytest.raises(NotImplementedError):
        next(iter(make().run()))


def test_outputs_are_passed_to_the_leaf() -> None:
    written: list[tuple[str, Any]] = [("first", 0)]
    make(written).output("length", 2.0)
    assert written[-1] == ("length", 2.0)


def test_standard_failures_are_codes_with_a_description() -> None:
    assert all(code.isupper() and meaning for code, meaning in STANDARD_FAILURES.items())
