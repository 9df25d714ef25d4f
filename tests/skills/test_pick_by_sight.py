"""A pick by sight takes the thing where it is, not where the file or the simulator says."""

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


def rested_at(play: Play) -> np.ndarray[Any, Any]:
    """Where the cube stands in truth when all is over."""
    return play.world.object_pose("cube").position


@pytest.mark.parametrize(
    ("x", "y"), some([(0.03, 0.0), (-0.03, 0.0), (0.0, -0.03), (0.0, 0.03)], 4)
)
def test_a_cube_that_was_moved_is_picked(x: float, y: float, stage: Stage) -> None:
    """By 30 mm and 20°, unseen by the tree, before it looks; it ends where it is to be put."""
    play = stage.run(TEXT, seed=6, deeds=((0.0, moves("cube", x, y, 20.0)),))
    assert play.result is not None
    assert play.result.outcome == "SUCCESS", [leaf.reason for leaf in play.arm().runs]
    assert float(play.leaf("locate").metrics["located_error_m"]) < 0.002
    assert np.linalg.norm(rested_at(play)[:2] - (0.20, -0.40)) < 0.003


def ways(
    stage: Stage, *, poison: bool, text: str = TEXT, duration: float | None = None
) -> tuple[Any, Play]:
    """Everything's way in truth; with a poison, who asks where the cube is, is told nonsense."""
    play = stage.play(text, seed=7, duration=duration)
    world = play.world
    way = list[Any]()
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
    play.watchers.append(lambda world: way.append(world.data.qpos.copy()))
    play.run()
    return np.array(way), play


def test_nobody_reads_where_the_cube_is(stage: Stage) -> None:
    """With a poisoned truth everything moves the same, to the last bit, until it is put down.

    Only then the referee compares: it finds the cube elsewhere, and the run ends there.
    """
    sound, good = ways(stage, poison=False)
    poisoned, bad = ways(stage, poison=True)
    assert good.result is not None
    assert good.result.outcome == "SUCCESS"
    assert float(bad.leaf("locate").metrics["located_error_m"]) > 0.1
    placed = bad.leaf("place")
    assert placed.code == "NOT_PLACED", placed.reason
    assert float(placed.metrics["believed_error_m"]) < 1e-3
    np.testing.assert_array_equal(poisoned, sound[: len(poisoned)])


def test_without_sight_the_truth_is_read(stage: Stage) -> None:
    """The test above can fail: an approach without ``at`` goes where the poison says."""
    blind = TEXT.replace(', at: "{cube}"', "").replace(', pose: "{cube}"', "")
    sound, _ = ways(stage, poison=False, text=blind, duration=6.0)
    poisoned, bad = ways(stage, poison=True, text=blind)
    assert bad.result is not None
    assert bad.result.outcome == "FAILURE"
    both = min(len(poisoned), len(sound))
    assert np.abs(poisoned[:both] - sound[:both]).max() > 1e-3
