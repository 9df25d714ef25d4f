"""In `track`, the arm and its held object do not run into obstacles."""

from __future__ import annotations

import pytest

from bt_dualarm.sim.world import World
from tests.families import some
from tests.plays import Stage
from tests.skills.scenarios import GRIPPING, Scenario
from tests.skills.trials import BLOCK, FOLLOW_HOLDING, FOLLOWED, LOOK_HOLDING, LOW_CAMERA


@pytest.mark.parametrize("blocked", [True, False])
def test_arm_stops_before_its_held_object_touches_an_obstacle(blocked: bool, stage: Stage) -> None:
    """The held cube pushed against the obstacle with 190 N."""

    def lead(world: World) -> None:
        y = -0.45 + min(max(0.03 * (world.time - 5.5), 0.0), 0.09)
        world.model.body_pos[world.object_body("other"), 1] = y

    objects = FOLLOWED | (BLOCK if blocked else {})
    scenario = Scenario(objects, arm=GRIPPING | {"camera": LOW_CAMERA}, scene="table")
    play = stage.play(scenario.file(*LOOK_HOLDING, FOLLOW_HOLDING))
    play.watchers.append(lead)
    play.run()
    leaf = play.leaf("track")
    assert (leaf.code or leaf.status) == ("IN_COLLISION" if blocked else "SUCCESS"), leaf
    assert ("block" in leaf.reason) is blocked
    assert "touched" not in leaf.metrics, leaf


@pytest.mark.parametrize("blocked", [True, False])
def test_empty_hand_stops_before_it_touches_an_obstacle(blocked: bool, stage: Stage) -> None:
    """Without a held object nothing was checked: the fingers ran into the obstacle."""

    def lead(world: World) -> None:
        y = -0.45 + min(max(0.03 * (world.time - 1.5), 0.0), 0.09)
        world.model.body_pos[world.object_body("other"), 1] = y

    tall = BLOCK["block"] | {"size": [0.04, 0.04, 0.3], "pose": {"xyz": [0.30, -0.275, 0.55]}}
    objects = {"other": FOLLOWED["other"]} | ({"block": tall} if blocked else {})
    scenario = Scenario(objects, arm=GRIPPING | {"camera": LOW_CAMERA}, scene="table")
    play = stage.play(scenario.file(LOOK_HOLDING[1], FOLLOW_HOLDING))
    play.watchers.append(lead)
    play.run()
    leaf = play.leaf("track")
    assert (leaf.code or leaf.status) == ("IN_COLLISION" if blocked else "SUCCESS"), leaf
    assert ("block" in leaf.reason) is blocked
    assert not any(play.world.touches("arm1", name) for name in objects)


@pytest.mark.parametrize("aside_m", some([0.06, 0.095, 0.12], 2))
def test_fast_hand_stops_before_an_obstacle(aside_m: float, stage: Stage) -> None:
    """The check assumed maximal braking; the actual, softer braking led into the obstacle."""

    def lead(world: World) -> None:
        back = min(max(0.05 * (world.time - 4.0), 0.0), aside_m)
        world.model.body_pos[world.object_body("other"), 1] = -0.45 + aside_m - back

    tall = BLOCK["block"] | {"size": [0.04, 0.04, 0.3], "pose": {"xyz": [0.30, -0.275, 0.55]}}
    objects = {"other": FOLLOWED["other"], "block": tall}
    scenario = Scenario(objects, arm=GRIPPING | {"camera": LOW_CAMERA}, scene="table")
    play = stage.play(scenario.file(LOOK_HOLDING[1], FOLLOW_HOLDING))
    play.watchers.append(lead)
    play.run()
    assert not any(play.world.touches("arm1", name) for name in objects)
    assert play.leaf("track").status == "SUCCESS", play.leaf("track")
