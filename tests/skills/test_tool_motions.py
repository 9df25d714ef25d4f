"""Lines, rotations, blended lines and tilted circles are accurate, or refused without motion."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.sim.world import World
from tests.plays import Play, Stage

WORLD = """
name: test
world: {scene: empty}
arms:
  arm1:
    robot: ROBOT
    base: {xyz: [0, 0, 0.4]}
    posture: POSTURE
    tree: {SKILL}
"""
NEAR = 4e-4  # m


def staged(stage: Stage, skill: str, robot: str = "ur5") -> Play:
    posture = "present" if robot == "ur5" else "home"
    text = WORLD.replace("SKILL", skill).replace("ROBOT", robot).replace("POSTURE", posture)
    return stage.play(text)


def tool(world: World) -> Pose:
    return world.arms["arm1"].tool_pose


def path_of(play: Play) -> list[Pose]:
    """Run the play; returns the tool pose at every step."""
    poses: list[Pose] = []
    play.watchers.append(lambda world: poses.append(tool(world)))
    play.run()
    return poses


@pytest.mark.parametrize("robot", ["ur5", "panda"])
def test_move_linear_is_straight(stage: Stage, robot: str) -> None:
    skill = "move_linear: {offset: {xyz: [0, 0.1, 0.05], rpy: [10, 0, 0]}, speed: 1.0}"
    play = staged(stage, skill, robot)
    start = tool(play.world)
    poses = path_of(play)
    assert play.leaf("move_linear").status == "SUCCESS"
    step = np.array((0.0, 0.1, 0.05))
    assert poses[-1].position - start.position == pytest.approx(step, abs=NEAR)
    assert np.degrees(poses[-1].angle(start)) == pytest.approx(10.0, abs=0.05)
    offsets = np.array([pose.position - start.position for pose in poses])
    deviations = offsets - np.outer(offsets @ step / (step @ step), step)
    assert np.linalg.norm(deviations, axis=1).max() < 3e-4


def test_move_linear_in_the_tool_frame_goes_along_the_tool(stage: Stage) -> None:
    play = staged(stage, "move_linear: {offset: {xyz: [0, 0, -0.1], frame: tool}}")
    start = tool(play.world)
    play.run()
    assert start.inverse.apply(tool(play.world).position) == pytest.approx((0, 0, -0.1), abs=NEAR)


def test_move_linear_to_a_place_keeps_the_orientation(stage: Stage) -> None:
    play = staged(stage, "move_linear: {to: {xyz: [0.6, 0.15, 0.75]}}")
    start = tool(play.world)
    play.run()
    assert tool(play.world).position == pytest.approx((0.6, 0.15, 0.75), abs=NEAR)
    assert tool(play.world).angle(start) < 1e-3


@pytest.mark.parametrize(
    ("skill", "code"),
    [
        ("rotate_tool: {axis: z, angle: 720}", "PATH_BROKEN"),
        ("move_linear: {offset: {xyz: [0.5, 0, 0]}}", "SINGULAR"),
        ("rotate_tool: {angle: 0}", "INVALID_TARGET"),
        ("rotate_tool: {angle: 30, axis: [0, 0, 0]}", "INVALID_TARGET"),
        ("rotate_tool: {angle: 30, frame: object}", "INVALID_TARGET"),
        ("move_through: {poses: [{xyz: [0.6, 0, 0.7]}, {xyz: [0.6, 0, 0.7]}]}", "INVALID_TARGET"),
    ],
)
def test_infeasible_motion_is_refused_without_motion(stage: Stage, skill: str, code: str) -> None:
    play = staged(stage, skill)
    play.run()
    leaf = play.leaf(skill.partition(":")[0])
    assert (leaf.status, leaf.code) == ("FAILURE", code), leaf.reason
    assert play.speed_after(0.0) < 0.02
    if code in ("PATH_BROKEN", "SINGULAR"):
        assert 0.0 < float(leaf.metrics["fraction"]) < 1.0


def test_rotate_tool_keeps_the_point_in_place(stage: Stage) -> None:
    play = staged(stage, "rotate_tool: {axis: y, angle: 25, point: [0, 0, 0.1], speed: 1.0}")
    tip = np.array((0.0, 0.0, 0.1))
    start = tool(play.world)
    poses = path_of(play)
    distances = [np.linalg.norm(pose.apply(tip) - start.apply(tip)) for pose in poses]
    assert max(distances) < 3e-4
    turn = start.inverse @ tool(play.world)
    assert np.degrees(turn.rotation.as_rotvec()) == pytest.approx((0, 25, 0), abs=0.05)


def test_rotate_tool_about_an_axis_of_the_world(stage: Stage) -> None:
    play = staged(stage, "rotate_tool: {axis: z, angle: -20, frame: world}")
    start = tool(play.world)
    play.run()
    turn = (tool(play.world).rotation * start.rotation.inv()).as_rotvec(degrees=True)
    assert turn == pytest.approx((0, 0, -20), abs=0.05)


def test_move_through_rounds_corners_within_the_blend_and_does_not_stop(stage: Stage) -> None:
    skill = (
        "move_through: {poses: [{xyz: [0.6, 0.2, 0.8]}, {xyz: [0.6, 0.0, 0.8]}, "
        "{xyz: [0.6, 0.0, 0.65]}], blend: 0.03}"
    )
    play = staged(stage, skill)
    poses = np.array([pose.position for pose in path_of(play)])
    assert poses[-1] == pytest.approx((0.6, 0.0, 0.65), abs=NEAR)
    for corner in ((0.6, 0.2, 0.8), (0.6, 0.0, 0.8)):
        distances = np.linalg.norm(poses - corner, axis=1)
        nearest = int(np.argmin(distances))
        assert distances[nearest] < 0.03
        assert np.linalg.norm(poses[nearest + 1] - poses[nearest]) > 1e-5  # in one step of 2 ms


def test_circle_tilts_the_tool_toward_its_center(stage: Stage) -> None:
    """Tool axis along x, circle in yz: the tool axes of all poses meet in one point."""
    play = staged(stage, "circle: {plane: yz, radius: 0.05, tilt: 20}")
    start = tool(play.world)
    tilts = [np.degrees(pose.angle(start)) for pose in path_of(play)]
    assert play.leaf("circle").status == "SUCCESS"
    assert max(tilts) == pytest.approx(20.0, abs=0.1)


def test_half_circle_ends_at_the_opposite_point(stage: Stage) -> None:
    """Half a turn from the circle's point at +y of its center, over +z, to -y."""
    play = staged(stage, "circle: {plane: yz, radius: 0.05, turns: 0.5, start: from}")
    start = tool(play.world)
    play.run()
    moved = tool(play.world).position - start.position
    assert moved == pytest.approx((0, -0.1, 0), abs=NEAR)


def test_arc_starts_at_the_given_angle(stage: Stage) -> None:
    """From the top of the circle, over its point at -y, to the bottom."""
    play = staged(stage, "circle: {radius: 0.05, turns: 0.5, begin: 90, start: from, tilt: 10}")
    start = tool(play.world)
    play.run()
    assert play.leaf("circle").status == "SUCCESS"
    moved = tool(play.world).position - start.position
    assert moved == pytest.approx((0, 0, -0.1), abs=NEAR)
    assert np.degrees(tool(play.world).angle(start)) == pytest.approx(10.0, abs=0.1)


def test_fraction_of_a_lissajous_curve(stage: Stage) -> None:
    """A quarter of it: A sin t and B sin 2t end at A and 0."""
    play = staged(stage, "lissajous: {amplitudes: [0.08, 0.05], repeats: 0.25, start: from}")
    start = tool(play.world)
    play.run()
    moved = tool(play.world).position - start.position
    assert moved == pytest.approx((0, 0.08, 0), abs=NEAR)
