"""Guard: an arm slows down near another one, stops before it, and goes on when it can."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.collision.distance import ArmDistance
from bt_dualarm.core.errors import Number
from bt_dualarm.safety.guard import CLEAR_M, NEARER_M, NOISE_M, clearance
from bt_dualarm.sim.world import World
from tests.plays import Stage
from tests.sim.worlds import arm, file_of

FACING = """
name: test
world: {scene: empty}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.4]}
    tree: {TREE1}
  arm2:
    robot: ur5
    base: {xyz: [1.1, 0, 0.4], rpy: [0, 0, 180]}
    tree: {TREE2}
"""
TO_THE_SIDE = "sequence: [{move_joints: {to: {shoulder_pan_joint: 70}, speed: 1.0}}]"


def swings(stage: Stage, one: str, other: str) -> tuple[float, dict[str, dict[str, Number]]]:
    """The smallest true distance between the arms in mm, and the guards' reports."""
    play = stage.play(FACING.replace("TREE1", one).replace("TREE2", other), duration=12.0)
    separation = ArmDistance(play.world, "arm1")
    gaps: list[float] = []
    play.watchers.append(lambda _: gaps.append(separation.gap({}).meters))
    play.run()
    guards = {name: dict(play.arm(name).guard) for name in ("arm1", "arm2")}
    return 1e3 * min(gaps), guards


def test_arms_that_are_far_apart_are_not_disturbed(stage: Stage) -> None:
    nearest, guards = swings(stage, "go_home: {}", "go_home: {}")
    assert nearest > 100.0
    assert all(guard["slowed"] == guard["stopped"] == 0 for guard in guards.values())


@pytest.mark.parametrize("speed", [0.3, 1.0])
def test_arms_that_reach_for_one_place_do_not_collide(stage: Stage, speed: float) -> None:
    """Both move at once, and neither plan knows of the other's motion."""
    skill = (
        f"reach_to_pose: {{to: {{xyz: [0.55, Y, 0.75]}}, speed: {speed}, patience: 2, "
        "give_way: false}"
    )
    nearest, guards = swings(stage, skill.replace("Y", "0.02"), skill.replace("Y", "-0.02"))
    assert nearest > 10.0
    assert sum(int(str(guard["stopped"])) for guard in guards.values()) > 0
    assert any("would come to within" in str(guard["last_reason"]) for guard in guards.values())


def test_an_arm_waits_for_another_one_to_leave_its_goal(stage: Stage) -> None:
    """Arm 1 blocks the goal of arm 2, and leaves after three seconds."""
    there = "reach_to_pose: {to: {xyz: [0.55, 0, 0.75]}, speed: 1.0}"
    first = f"sequence: [{{{there}}}, {{wait: {{seconds: 3}}}}, {{go_home: {{}}}}]"
    second = f"sequence: [{{wait: {{seconds: 2}}}}, {{{there}}}]"
    play = stage.run(FACING.replace("TREE1", first).replace("TREE2", second), duration=20.0)
    assert play.leaf("reach_to_pose", "arm1").status == "SUCCESS"
    leaf = play.leaf("reach_to_pose", "arm2")
    assert leaf.status == "SUCCESS", leaf.reason
    assert leaf.ended_s is not None
    assert leaf.ended_s > 4.0


def test_clearance_is_reduced_for_arms_that_begin_near_each_other() -> None:
    assert clearance(float("inf"), CLEAR_M) == CLEAR_M
    assert clearance(0.02, CLEAR_M) == pytest.approx(0.02 - NEARER_M)
    assert clearance(0.005, CLEAR_M) == pytest.approx(0.005 - NOISE_M)


def test_separation_is_the_distance_between_the_arms() -> None:
    """For two mirrored arms, it is the same from either arm."""
    world = World(file_of({"arm1": arm("ur5"), "arm2": arm("ur5", (1.1, 0.0, 0.4), 180.0)}))
    first, second = (ArmDistance(world, name) for name in ("arm1", "arm2"))
    near = {name: np.array((0.0, -0.6, 0.9, -1.9, -1.57, 0.0)) for name in ("arm1", "arm2")}
    assert first.gap({}).meters == float("inf")
    gap = first.gap(near)
    assert gap.meters == pytest.approx(second.gap(near).meters, abs=1e-9)
    assert gap.first.startswith("arm1/")
    assert gap.second.startswith("arm2/")


def test_two_arms_that_swap_places_yield(stage: Stage) -> None:
    """Neither can go first, and both homes are between them."""
    reach = "{reach_to_pose: {to: {xyz: [0.55, Y, 0.75]}, give_way: true, patience: 20}}"

    def tree(side: float) -> str:
        return f"sequence: [{reach.replace('Y', str(side))}, {reach.replace('Y', str(-side))}]"

    play = stage.run(FACING.replace("TREE1", tree(0.2)).replace("TREE2", tree(-0.2)), duration=60.0)
    for name in ("arm1", "arm2"):
        leaves = play.leaves("reach_to_pose", name)
        assert [leaf.status for leaf in leaves] == ["SUCCESS"] * 2, leaves[-1].reason
