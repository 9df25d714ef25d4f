"""Arms and objects are spawned and removed while other arms work."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.plays import Stage

TWO = """
world: {scene: empty, time_limit: 30}
objects:
  ball: {shape: sphere, size: [0.03], mass: 0.1, pose: {xyz: [0.5, -0.5, 0.03]}, spawned: false}
  box: {shape: box, size: [0.1, 0.1, 0.1], mass: 1, pose: {xyz: [-0.5, -0.5, 0.05]}, spawned: false}
arms:
  arm1: {robot: ur5, tree: {sequence: [LEAVES]}}
  arm2:
    robot: panda
    base: {xyz: [0, 1.5, 0]}
    spawned: false
    tree: {reach_to_pose: {offset: {xyz: [0, 0, 0.05]}}}
"""

LEAVES = {
    "ball": "{spawn: {object: ball}}",
    "box": "{spawn: {object: box}}",
    "arm": "{spawn: {arm: arm2}}",
    "wait": "{wait: {seconds: 0.3}}",
    "gone": "{remove: {object: ball}}",
}


@pytest.mark.parametrize("order", list(itertools.permutations(("ball", "box", "arm"))), ids=str)
def test_arms_and_objects_spawn_in_any_order(order: tuple[str, ...], stage: Stage) -> None:
    """Everything is present and at rest where declared, and the second arm's tree has run."""
    leaves = ", ".join([*(LEAVES[name] for name in order), "{wait: {seconds: 2}}"])
    play = stage.run(TWO.replace("LEAVES", leaves))
    assert play.arm("arm1").outcome == "SUCCESS"
    assert play.arm("arm2").outcome == "SUCCESS"
    assert set(play.world.objects) == {"ball", "box"}
    assert play.world.object_pose("box").position == pytest.approx((-0.5, -0.5, 0.05), abs=2e-3)
    assert play.world.object_pose("ball").position[2] == pytest.approx(0.03, abs=2e-3)


def test_spawned_arm_starts_its_tree_when_it_appears(stage: Stage) -> None:
    play = stage.run(TWO.replace("LEAVES", "{wait: {seconds: 0.5}}, {spawn: {arm: arm2}}"))
    (leaf,) = play.arm("arm2").runs
    assert leaf.started_s == pytest.approx(0.5, abs=0.05)
    assert leaf.status == "SUCCESS"
    (spawn,) = play.leaves("spawn", "arm1")
    assert spawn.status == "SUCCESS"


def test_arm_that_is_never_spawned_does_not_delay_the_end(stage: Stage) -> None:
    play = stage.run(TWO.replace("LEAVES", "{wait: {seconds: 0.1}}"))
    assert play.arm("arm2").outcome == "NOT_SPAWNED"
    assert play.result is not None
    assert play.result.outcome == "SUCCESS"


def test_object_and_arm_can_be_spawned_and_removed_twice(stage: Stage) -> None:
    """The arm's tree runs anew each time."""
    again = [LEAVES["ball"], LEAVES["gone"]] * 2
    arm = ["{spawn: {arm: arm2}}", "{wait: {seconds: 1}}", "{remove: {arm: arm2}}"] * 2
    play = stage.run(TWO.replace("LEAVES", ", ".join(again + arm)))
    assert play.arm("arm1").outcome == "SUCCESS"
    assert [leaf.status for leaf in play.arm("arm2").runs] == ["SUCCESS", "SUCCESS"]
    assert set(play.world.objects) == set()
    assert set(play.world.arms) == {"arm1"}


def test_spawning_others_does_not_disturb_a_moving_arm(stage: Stage) -> None:
    """The model is recompiled in the middle of a motion; the path agrees to 0.01 mm."""

    def path(leaves: str) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
        text = TWO.replace("arm2:", "arm2:\n    camera: null", 0).replace("LEAVES", leaves)
        play = stage.play(text)
        tools: list[np.ndarray[tuple[int], np.dtype[np.float64]]] = []
        play.watchers.append(lambda world: tools.append(world.arms["arm1"].tool_pose.position))
        play.run()
        assert play.arm("arm1").outcome == "SUCCESS", play.arm("arm1").runs
        return np.array(tools[:700])

    move = "{reach_to_pose: {offset: {xyz: [0, 0.2, 0.1]}}}"
    busy = ", ".join(
        f"{{delay: {{seconds: {0.2 + 0.1 * i:.1f}, child: {leaf}}}}}"
        for i, leaf in enumerate((LEAVES["ball"], LEAVES["box"], LEAVES["arm"]))
    )
    together = f"{{parallel: [{move}, {busy}]}}"
    assert np.abs(path(move) - path(together)).max() < 1e-5


TRACKED = """
world: {scene: empty, time_limit: 40}
objects:
  cube:
    {shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, color: yellow, fixed: FIXED,
     pose: {xyz: [0.68, 0.11, 0.70]}}
  stand:
    {shape: box, size: [0.03, 0.06, 0.674], mass: 5, color: white, fixed: true,
     pose: {xyz: [0.68, 0.11, 0.337]}}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.40]}
    posture: present
    tree:
      sequence:
        - approach_and_attach: {object: cube, direction: [1, 0, 0], standoff: 0.08}
        - remove: {object: stand}
        - circle: {plane: yz, radius: 0.10, turns: 50}
  arm2:
    robot: panda
    base: {xyz: [1.60, 0.11, 0.28], rpy: [0, 0, 180]}
    posture: look_out
    camera: {mount: wrist, fps: 30}
    tree: {track: {lost_timeout: 1.0, max_error: 0.05}}
"""


def test_tracking_fails_when_the_arm_that_holds_the_target_is_removed(stage: Stage) -> None:
    """The held object falls; the tracking arm stops and fails with LOST."""
    removed = 6.0
    play = stage.play(
        TRACKED.replace("FIXED", "false"),
        interventions=((removed, lambda w: w.remove_arm("arm1")),),
    )
    play.run()
    assert play.arm("arm1").outcome == "REMOVED"
    track = play.leaf("track", "arm2")
    assert track.code == "LOST", track.reason
    assert removed + 0.9 < (track.ended_s or 0.0) < removed + 3.0
    assert play.world.object_pose("cube").position[2] < 0.1
    assert play.speed_after((track.ended_s or 0.0) + 1.0, "arm2") < 0.02
