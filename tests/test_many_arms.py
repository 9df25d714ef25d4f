"""Small versions of the benchmarks of many arms: distant arms do not disturb one another."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from benchmarks.crowd import Solo, cannot_meet
from benchmarks.crowd_members import Member
from benchmarks.many_arms import judged
from benchmarks.third_arm import Place, failures, places, run_beside
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.runtime.outcome import ArmResult
from bt_dualarm.skill.registry import Registry
from tests.families import some

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("seed", some((1, 0, 2), 3))
def test_arms_that_cannot_meet_end_as_alone(seed: int, registry: Registry) -> None:
    """No arm touches another, or is refused because of an arm that it was not near."""
    finding = judged(seed, registry)
    assert finding.wrong == []


def test_arms_can_meet_if_the_path_of_one_comes_near_the_other() -> None:
    """Regardless of their distance at the start."""
    folded = np.array([load_robot("ur10").postures["home"]])
    stretched = np.array([[turn, *np.zeros(5)] for turn in (0.0, np.pi)])
    stands, reaches = (
        Solo(
            Member(name, "ur10", (x, 0.0, 0.3), 0.0, 1.0, tasks=("wait: 1",)),
            cast("ArmResult", None),
            path,
            folded,
        )
        for name, x, path in (("arm1", 0.0, folded), ("arm2", 1.6, np.vstack((folded, stretched))))
    )
    assert cannot_meet(stands, replace(reaches, path=folded))
    assert not cannot_meet(stands, reaches)


@pytest.mark.parametrize("place", places(1, seed=0), ids=str)
def test_main_job_succeeds_beside_a_third_arm(place: Place, registry: Registry) -> None:
    """More than a meter away, the third arm does not affect the others."""
    assert failures(run_beside(place, registry)) == []
