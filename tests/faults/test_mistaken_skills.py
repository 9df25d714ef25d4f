"""Mistakes in the use of the arm fail the leaf with a reason that says what is right."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_dualarm.skill.registry import Registry
from tests.plays import Stage

SKILLS = Path(__file__).parent / "skills"

TREE = """
    world: {{scene: empty, time_limit: 20}}
    arms:
      arm1: {{robot: panda, tree: {tree}}}
      other:
        robot: ur5
        base: {{xyz: [0, 1.5, 0]}}
        tree: {{reach_to_pose: {{offset: {{xyz: [0, 0, 0.05]}}}}}}
"""

REASONS = {
    "no goal": ("INVALID_TARGET", "there is no goal"),
    "a goal without a list": ("INVALID_TARGET", "a single one is given as [q]"),
    "a goal of two joints": ("INVALID_TARGET", "are not the angles of 7 joints"),
    "speed 0": ("EXCEPTION", "speed 0.0 is not a fraction of the arm's limits, above 0 to 1"),
    "speed 2": ("EXCEPTION", "speed 2.0 is not a fraction"),
    "a configuration of two joints": ("INVALID_TARGET", "are not the angles of 7 joints"),
    "no camera": ("EXCEPTION", "arm1 has no camera that moves with it"),
    "a stream of arrays": ("EXCEPTION", "a stream returns a SetPoint"),
    "a stream of lists": ("EXCEPTION", "a stream returns a SetPoint"),
    "a stream of two joints": ("EXCEPTION", "arrays of shape (7,)"),
    "another period": ("INVALID_TARGET", "0.1 s apart, and those of the arm 0.004 s"),
    "two joints": ("INVALID_TARGET", "2 angles at each set-point, and panda has 7 joints"),
    "no numbers": ("INVALID_TARGET", "set-points that are not numbers"),
    "a jump": ("INVALID_TARGET", "positions do not change by its velocities"),
    "no rest": ("INVALID_TARGET", "instead of at rest"),
    "beyond a limit": ("JOINT_LIMIT", "panda_joint1 would be"),
    "too fast": ("INVALID_TARGET", "exceeds the velocity, acceleration or jerk limits"),
}


@pytest.fixture(scope="module")
def registry() -> Registry:
    return Registry.load([SKILLS])


@pytest.mark.parametrize("mistake", REASONS)
def test_mistake_fails_its_leaf_and_nothing_else(mistake: str, stage: Stage) -> None:
    """A stream of arrays ended the whole run; jumps and NaN counted as SUCCESS."""
    play = stage.run(TREE.format(tree=f"{{mistaken: {{mistake: {mistake}}}}}"))
    leaf = play.leaf("mistaken", "arm1")
    code, reason = REASONS[mistake]
    assert (leaf.status, leaf.code) == ("FAILURE", code), leaf.reason
    assert reason in leaf.reason
    assert play.arm("other").outcome == "SUCCESS"
    assert play.arm("arm1").clipped_setpoints == 0


@pytest.mark.parametrize("what", ["q", "setpoint"])
def test_returned_arrays_belong_to_the_skill(what: str, stage: Stage) -> None:
    """`q = arm.q; q[0] += 0.3` changed the reading of an encoder or the last set-point."""
    play = stage.run(TREE.format(tree=f"{{writing: {{what: {what}}}}}"))
    leaf = play.leaf("writing", "arm1")
    assert leaf.status == "SUCCESS", leaf.reason
    assert leaf.metrics["kept"]
    assert float(leaf.metrics["error_rad"]) < 1e-3
