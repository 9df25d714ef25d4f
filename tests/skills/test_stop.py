"""`stop` and `go_home`."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.robots.robot_description import load_robot
from tests.plays import STOPPED, Stage, joints

WORLD = """
name: test
world: {scene: empty}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.4]}
    posture: present
    tree:
      TREE
"""


def test_stop_ends_the_motion_of_another_leaf(stage: Stage) -> None:
    """The moving leaf fails with INTERRUPTED; the arm rests when `stop` has succeeded."""
    tree = """parallel:
        policy: any
        on_failure: continue
        children:
          - circle: {turns: 5}
          - sequence: [{wait: {seconds: 1.0}}, stop]
    """
    play = stage.run(WORLD.replace("TREE", tree), duration=4.0)
    circle = play.leaf("circle")
    stop = play.leaf("stop")
    assert (circle.status, circle.code) == ("FAILURE", "INTERRUPTED")
    assert 0.0 < float(stop.metrics["stopping_s"]) < 1.0
    assert stop.ended_s is not None
    assert play.speed_after(stop.ended_s + 0.02) < STOPPED


@pytest.mark.parametrize("longest", [5.0, 7.0])
def test_stop_waits_as_long_as_it_is_told(longest: float, stage: Stage) -> None:
    """A play of the encoder lets the arm swing; `stop` gave up after 5 s, with another code."""
    raised = "{timeout: {seconds: 0.5, child: {reach_to_pose: {offset: {xyz: [0, 0, 0.1]}}}}}"
    tree = f"sequence: [{{force_success: {{child: {raised}}}}}, {{stop: {{longest: {longest}}}}}]"
    fault = "{kind: loose_joint, arm: arm1, joint: shoulder_lift_joint, play: 6, begin: 0.1}"
    file = WORLD.replace("TREE", tree).replace("posture: present", "posture: home")
    stop = stage.run(f"{file}faults: {{swings: {fault}}}", duration=10.0).leaf("stop")
    assert stop.code == "TIMED_OUT", stop.reason
    assert longest < float(stop.metrics["took_s"]) < longest + 0.1


def test_stop_succeeds_at_rest(stage: Stage) -> None:
    play = stage.run(WORLD.replace("TREE", "stop: {}"))
    assert play.leaf("stop").metrics == {"stopping_s": 0.0}


def test_go_home_ends_in_the_home_posture(stage: Stage) -> None:
    play = stage.run(WORLD.replace("TREE", "go_home: {speed: 1.0}"))
    assert play.leaf("go_home").status == "SUCCESS"
    home = load_robot("ur5").postures["home"]
    assert np.abs(joints(play.world) - home).max() == pytest.approx(0.0, abs=1e-3)
