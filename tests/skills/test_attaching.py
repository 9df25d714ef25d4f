"""After `approach_and_attach`, the fingers open, and the arm is free to move."""

from __future__ import annotations

from itertools import product

import mujoco
import numpy as np
import pytest

from bt_dualarm.sim.world import World
from tests.families import some
from tests.plays import Stage
from tests.skills.scenarios import CUBE, GRIPPING, ON_TABLE, PICK, Scenario, Tree


@pytest.mark.parametrize("gripper", ["robotiq_2f85", "panda_hand"])
def test_fingers_open_while_an_object_is_attached_to_their_tips(gripper: str, stage: Stage) -> None:
    """They shut to form a tip; pressed against the object welded to the hand, they jammed."""
    arm = GRIPPING | {"gripper": gripper}
    release: Tree = {"release": {"width": 0.02}}
    file = Scenario(ON_TABLE, arm=arm, scene="table").file(PICK, release, {"open_gripper": {}})
    play = stage.run(file)
    assert play.arm().outcome == "SUCCESS", play.arm().runs
    assert play.leaf("release").metrics["width_m"] == pytest.approx(0.02, abs=1.5e-3)
    assert play.world.attachments.attached_to("arm1") == ("cube",)


def test_detached_object_collides_with_the_fingers_again(stage: Stage) -> None:
    """Only a weld disables contact with the tips: afterwards fingers grasp it as any object."""
    up: Tree = {"move_linear": {"offset": {"xyz": [0, 0, 0.1]}}}
    grasp: Tree = {"grasp": {"object": "cube"}}
    file = Scenario(ON_TABLE, arm=GRIPPING, scene="table").file(
        PICK, {"detach": {"object": "cube"}}, up, grasp
    )
    play = stage.run(file)
    assert play.arm().outcome == "SUCCESS", play.arm().runs
    assert play.world.object_pose("cube").position[2] > 0.43


@pytest.mark.parametrize("robot", ["ur5", "panda"])
def test_arm_can_move_after_it_touched_the_wrong_object(robot: str, stage: Stage) -> None:
    """It came down on another object at that location, and stayed in contact with it."""
    other = {"other": CUBE | {"pose": {"xyz": [0.25, -0.45, 0.425]}}}

    def swap(world: World) -> None:
        for name, shift in (("cube", -0.15), ("other", 0.15)):
            world.data.qpos[world.pose_address(name)] += shift

    arm = {"robot": robot, "base": {"xyz": [0, 0, 0.4]}}
    aside: Tree = {"reach_to_pose": {"offset": {"xyz": [0, 0.05, 0.05]}}}
    scenario = Scenario(ON_TABLE | other, arm=arm, scene="table")
    play = stage.play(scenario.file({"selector": [PICK, aside]}), interventions=((1.0, swap),))
    play.run()
    first, second = play.arm().runs[:2]
    assert first.code == "PROXIMITY_NOT_REACHED", first
    assert second.status == "SUCCESS", second
    assert "touched" not in second.metrics, second


@pytest.mark.parametrize(
    ("gripper", "robot", "reality"),
    some(
        product(
            ["robotiq_2f85", "panda_hand", "suction_cup"],
            ["ur5", "panda", "xarm7"],
            ["ideal", "rough"],
        ),
        5,
    ),
)
def test_contact_force_on_an_object_on_a_table_is_small(
    robot: str, gripper: str, reality: str, stage: Stage
) -> None:
    """A stiff arm pressed on it with up to 70 N, and without joint friction might never come to
    rest."""
    top = 0.05
    table = {"shape": "box", "size": [0.4, 0.3, 0.02], "mass": 50, "fixed": True}
    play = stage.play(
        {
            "world": {"scene": "empty", "reality": reality, "time_limit": 30},
            "objects": {
                "cube": CUBE | {"pose": {"xyz": [0.25, -0.3, top + 0.025]}},
                "bench": table | {"pose": {"xyz": [0.25, -0.3, top - 0.01]}},
            },
            "arms": {"arm1": {"robot": robot, "gripper": gripper, "tree": PICK}},
        }
    )
    world = play.world
    pressed = [0.0]
    force = np.empty(6)

    def record_force() -> None:
        pairs = world.data.contact.geom.tolist()
        cube = world.object_geom("cube")
        tool = world.arms["arm1"].tool_geom_ids
        for number, pair in enumerate(pairs):
            if cube in pair and tool & set(pair):
                mujoco.mj_contactForce(world.model, world.data, number, force)
                pressed[0] = max(pressed[0], float(force[0]))

    world.on_forces.append(record_force)
    play.run()
    assert play.arm().outcome == "SUCCESS", play.arm().runs
    assert 0.0 < pressed[0] < 20.0


@pytest.mark.parametrize(
    ("robot", "place", "wall", "direction"),
    [
        ("ur5", (-0.267, 0.348), (-0.154, 0.462, 45.3), (0.430, -0.876, -0.218)),
        ("panda", (-0.530, -0.052), (-0.392, 0.029, 30.4), (0.035, -0.380, -0.924)),
    ],
)
def test_every_ik_branch_is_tried_beside_a_wall(
    robot: str,
    place: tuple[float, float],
    wall: tuple[float, float, float],
    direction: tuple[float, float, float],
    stage: Stage,
) -> None:
    """In the first branch of each tool rotation, the arm hits the wall: OUT_OF_REACH."""
    fixed = {"shape": "box", "mass": 20, "fixed": True}
    x, y = place
    stand = fixed | {"size": [0.12, 0.12, 0.3], "pose": {"xyz": [x, y, 0.15]}}
    beside = {"xyz": [*wall[:2], 0.35], "rpy": [0, 0, wall[2]]}
    file: Tree = {
        "world": {"scene": "empty", "reality": "lab", "time_limit": 30},
        "objects": {
            "box": CUBE | {"size": [0.06, 0.06, 0.1], "pose": {"xyz": [x, y, 0.35]}},
            "stand": stand,
            "wall": fixed | {"size": [0.05, 0.3, 0.7], "pose": beside},
        },
        "arms": {
            "arm1": {
                "robot": robot,
                "base": {"xyz": [0, 0, 0.1]},
                "tree": {"approach_and_attach": {"object": "box", "direction": list(direction)}},
            }
        },
    }
    play = stage.run(file)
    assert play.arm().outcome == "SUCCESS", play.arm().runs


OPEN = {
    "tray": [0.18, 0.16, 0.067],
    "bin": [0.2, 0.16, 0.1],
    "bowl": [0.075, 0.04],
    "cup": [0.04, 0.09],
    "tube": [0.03, 0.09],
}


ALTERNATING = [
    (robot, shape)
    for number, shape in enumerate(OPEN)
    for robot in (("ur5", "panda") if number % 2 == 0 else ("panda", "ur5"))
]
"""Pairs of which half are tested: every shape, and both robots."""


@pytest.mark.parametrize(("robot", "shape"), some(ALTERNATING, 2))
def test_open_container_is_attached_at_its_rim(robot: str, shape: str, stage: Stage) -> None:
    """The tool moved into the empty space above its floor, and stopped there."""
    size = OPEN[shape]
    pose = {"xyz": [0.40, -0.40, 0.4 + 0.5 * size[-1]], "rpy": [0, 0, 20]}
    obj = {"shape": shape, "size": size, "mass": 0.3, "pose": pose}
    arm = {"robot": robot, "base": {"xyz": [0, 0, 0.4]}}
    file = Scenario({"thing": obj}, arm=arm, scene="table").file(
        {"approach_and_attach": {"object": "thing"}}
    )
    play = stage.run(file)
    assert play.arm().outcome == "SUCCESS", play.arm().runs
    assert play.leaf("approach_and_attach").metrics["gap_m"] < 0.0


@pytest.mark.parametrize("robot", ["ur5", "panda"])
def test_object_that_settled_after_planning_is_touched(robot: str, stage: Stage) -> None:
    """It falls by 3 mm after the approach was planned, which ends 2 mm below its surface."""
    obj = CUBE | {"pose": {"xyz": [0.40, -0.40, 0.428]}}
    arm = {"robot": robot, "base": {"xyz": [0, 0, 0.4]}}
    file = Scenario({"cube": obj}, arm=arm, scene="table").file(PICK)
    play = stage.run(file)
    assert play.arm().outcome == "SUCCESS", play.arm().runs
    assert play.leaf("approach_and_attach").metrics["gap_m"] < 0.0


@pytest.mark.parametrize("tick_hz", [50, 60, 100])
@pytest.mark.parametrize("settle", [0.05, 0.25, 0.3])
def test_object_at_rest_is_detached_however_short_the_wait(
    settle: float, tick_hz: float, stage: Stage
) -> None:
    """Rest is told from 0.25 s: the wait ended one tick before, and the object "still moved"."""
    wait: Tree = {"wait": {"seconds": 0.5}}
    arm = {"robot": "ur5", "base": {"xyz": [0, 0, 0.4]}, "tick_hz": tick_hz}
    file = Scenario(ON_TABLE, arm=arm, scene="table").file(
        wait, {"detach": {"object": "cube", "settle": settle}}
    )
    leaf = stage.run(file).leaf("detach")
    assert leaf.status == "SUCCESS", leaf.reason


HOLE = """
        world: {{scene: table, time_limit: 20}}
        objects:
          peg: {{shape: cylinder, size: [0.01, 0.08], mass: 0.1, pose: {{xyz: [{x}, -0.45, 0.44]}}}}
          left: {{shape: box, size: [0.03, 0.08, 0.02], fixed: true,
            pose: {{xyz: [0.3747, -0.45, 0.41]}}}}
          right: {{shape: box, size: [0.03, 0.08, 0.02], fixed: true,
            pose: {{xyz: [0.4253, -0.45, 0.41]}}}}
          front: {{shape: box, size: [0.02, 0.03, 0.02], fixed: true,
            pose: {{xyz: [0.4, -0.4753, 0.41]}}}}
          back: {{shape: box, size: [0.02, 0.03, 0.02], fixed: true,
            pose: {{xyz: [0.4, -0.4247, 0.41]}}}}
        arms:
          arm1:
            robot: ur5
            base: {{xyz: [0, 0, 0.4]}}
            tree: {{sequence: [approach_and_attach: {{object: peg}}, {then}]}}
"""


def test_motion_out_of_a_hole_without_a_line_says_what_encloses_the_peg(stage: Stage) -> None:
    """Only the number of checked configurations was reported, as if the planner were at fault."""
    leaf = stage.run("\n        name: out" + HOLE.format(x=0.4, then="go_home: {}")).leaf("go_home")
    assert leaf.code == "NO_PLAN"
    assert leaf.reason.endswith(": `move_linear` can take it out first")
    assert "; peg is between " in leaf.reason


def test_motion_into_a_hole_without_a_line_says_what_encloses_the_peg_there(stage: Stage) -> None:
    """As above; `insert` with less `depth` than that of the hole plans to such a pose."""
    into = "transport: {to: {xyz: [0.4, -0.45, 0.442]}, speed: 0.5}"
    text = "\n        name: into" + HOLE.format(x=0.25, then=into)
    leaf = stage.run(text).leaf("transport")
    assert leaf.code == "NO_PLAN"
    assert "; at the goal, peg would be between " in leaf.reason
