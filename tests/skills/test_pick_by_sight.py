"""A pick by sight uses the located pose, not that of the file or the simulator."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.core.pose import Pose
from tests.families import some
from tests.plays import Play, Stage

TREE = Path(__file__).parents[2] / "trees" / "pick_by_sight.yaml"
TEXT = TREE.read_text(encoding="utf-8").replace("bt_dualarm: 1\n", "")


def moves(name: str, x: float, y: float, yaw: float) -> Any:
    """Move a free object and turn it about the vertical."""

    def move(world: bt.World) -> None:
        start = world.pose_address(name)
        pose = Pose(world.data.qpos[start : start + 3].copy(), world.data.qpos[start + 3 :][:4])
        turned = Pose.from_rpy((0, 0, 0), (0, 0, np.radians(yaw))) @ Pose(
            np.zeros(3), pose.quaternion.copy()
        )
        world.data.qpos[start : start + 2] += (x, y)
        world.data.qpos[start + 3 : start + 7] = turned.quaternion

    return move


def final_position(play: Play) -> np.ndarray[Any, Any]:
    """True position of the cube at the end."""
    return play.world.object_pose("cube").position


@pytest.mark.parametrize(
    ("x", "y"), some([(0.03, 0.0), (-0.03, 0.0), (0.0, -0.03), (0.0, 0.03)], 4)
)
def test_displaced_cube_is_picked_and_placed(x: float, y: float, stage: Stage) -> None:
    """It is displaced by 30 mm and 20° before the camera looks."""
    play = stage.run(TEXT, seed=6, interventions=((0.0, moves("cube", x, y, 20.0)),))
    assert play.result is not None
    assert play.result.outcome == "SUCCESS", [leaf.reason for leaf in play.arm().runs]
    assert float(play.leaf("locate").metrics["located_error_m"]) < 0.002
    assert np.linalg.norm(final_position(play)[:2] - (0.20, -0.40)) < 0.003


def states_of(
    stage: Stage, *, poison: bool, text: str = TEXT, duration: float | None = None
) -> tuple[Any, Play]:
    """True joint positions of the world over time; `poison` falsifies the cube's pose."""
    play = stage.play(text, seed=7, duration=duration)
    world = play.world
    states = list[Any]()
    true = world.object_pose
    weld = world.attach

    def false(name: str) -> Pose:
        pose = true(name)
        return Pose(pose.position + np.array((0.1, -0.05, 0.02)), pose.quaternion)

    def attach(*given: Any) -> Any:
        world.object_pose = true  # type: ignore[method-assign]  # the weld is the simulator's
        held = weld(*given)
        world.object_pose = false  # type: ignore[method-assign]  # as below
        return held

    if poison:
        world.object_pose = false  # type: ignore[method-assign]  # that is the poison
        world.attach = attach  # type: ignore[assignment, method-assign]  # it is no skill's
    play.watchers.append(lambda world: states.append(world.data.qpos.copy()))
    play.run()
    return np.array(states), play


def test_true_pose_of_the_cube_is_never_read(stage: Stage) -> None:
    """With a falsified truth everything moves identically, bit for bit, until the cube is placed.

    Only then does the referee compare: it finds the cube elsewhere, and the run fails.
    """
    sound, good = states_of(stage, poison=False)
    poisoned, bad = states_of(stage, poison=True)
    assert good.result is not None
    assert good.result.outcome == "SUCCESS"
    assert float(bad.leaf("locate").metrics["located_error_m"]) > 0.1
    placed = bad.leaf("place")
    assert placed.code == "NOT_PLACED", placed.reason
    assert float(placed.metrics["believed_error_m"]) < 1e-3
    np.testing.assert_array_equal(poisoned, sound[: len(poisoned)])


def test_true_pose_is_read_without_sight(stage: Stage) -> None:
    """The test above can fail: an approach without ``at`` goes to the falsified pose."""
    blind = TEXT.replace(', at: "{cube}"', "").replace(', pose: "{cube}"', "")
    sound, _ = states_of(stage, poison=False, text=blind, duration=6.0)
    poisoned, bad = states_of(stage, poison=True, text=blind)
    assert bad.result is not None
    assert bad.result.outcome == "FAILURE"
    both = min(len(poisoned), len(sound))
    assert np.abs(poisoned[:both] - sound[:both]).max() > 1e-3
