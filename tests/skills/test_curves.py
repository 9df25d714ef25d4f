"""Circles, Lissajous curves and drawings as the tool executed them."""

from __future__ import annotations

from itertools import cycle
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import yaml

from bt_dualarm.core.pose import Pose
from bt_dualarm.core.share import share_dir
from bt_dualarm.sim.world import World
from bt_dualarm.spec.values import Plane
from tests.families import some
from tests.plays import STOPPED, Play, Stage
from tests.skills.scenarios import PRESENTING, Scenario, Tree

NEAR = 4e-4
"""Servo error and the spline between waypoints, m."""

PLANES = {name: Plane.model_validate(name) for name in ("yz", "xz", "xy")}

Points = npt.NDArray[np.float64]


def executed(stage: Stage, node: Tree) -> tuple[Play, Pose, list[Pose]]:
    """The play, the tool pose at the start, and tool poses along the executed curve."""
    play = stage.play(Scenario(arm=PRESENTING).file(node))
    start = play.world.arms["arm1"].tool_pose
    poses: list[Pose] = []

    def record(world: World) -> None:
        poses.append(world.arms["arm1"].tool_pose)

    play.watchers.append(record)
    play.run()
    (leaf,) = play.arm().runs
    assert leaf.status == "SUCCESS", leaf.reason
    return play, start, poses


def in_plane(points: Points, plane: Plane) -> tuple[Points, Points]:
    """Coordinates along the plane's axes, of shape (n, 2), and heights above it."""
    u, v = (np.array(axis) for axis in plane.axes)
    return np.stack((points @ u, points @ v), axis=1), points @ np.cross(u, v)


@pytest.mark.parametrize("plane", ["yz", "xz", "xy"])
def test_circle_is_round_flat_and_keeps_the_orientation(plane: str, stage: Stage) -> None:
    node: Tree = {"circle": {"plane": plane, "radius": 0.06, "turns": 2, "speed": 1.0}}
    play, start, poses = executed(stage, node)
    points = np.array([pose.position for pose in poses]) - start.position
    flat, height = in_plane(points, PLANES[plane])
    assert np.abs(height).max() < NEAR
    radius = np.hypot(*flat.T)
    on_it = np.argmax(radius > 0.06 - NEAR)
    assert np.abs(radius[on_it:] - 0.06).max() < NEAR
    angle = np.unwrap(np.arctan2(flat[on_it:, 1], flat[on_it:, 0]))
    assert angle[-1] - angle[0] == pytest.approx(4 * np.pi, abs=0.02)
    assert np.diff(angle).min() > -1e-4, "it never reverses"
    assert max(pose.angle(start) for pose in poses) < 2e-3
    metrics = play.arm().runs[0].metrics
    assert 0.0 < float(metrics["path_rms_m"]) <= float(metrics["path_max_m"]) < NEAR


def test_circle_can_start_at_its_rim_and_run_clockwise(stage: Stage) -> None:
    """It starts at the tool pose, without a motion to the start, and turns the other way."""
    node: Tree = {"circle": {"radius": 0.05, "start": "from", "direction": "clockwise"}}
    _, start, poses = executed(stage, node)
    flat, _ = in_plane(np.array([pose.position for pose in poses]) - start.position, PLANES["yz"])
    center = np.array((-0.05, 0.0))
    assert np.abs(np.hypot(*(flat - center).T) - 0.05).max() < NEAR
    quarter = flat[np.argmax(flat[:, 0] < -0.05)]
    assert quarter[1] < 0.0


def test_lissajous_follows_its_formula(stage: Stage) -> None:
    """Every executed point lies on the curve, and all of it is covered: 0.08 sin t, 0.05 sin 2t."""
    node: Tree = {"lissajous": {"amplitudes": [0.08, 0.05], "frequencies": [1, 2], "speed": 1.0}}
    _, start, poses = executed(stage, node)
    points, height = in_plane(
        np.array([pose.position for pose in poses]) - start.position, PLANES["yz"]
    )
    t = np.linspace(0, 2 * np.pi, 4000)
    curve = np.stack((0.08 * np.sin(t), 0.05 * np.sin(2 * t)), axis=1)
    distances = np.linalg.norm(points[::2, None, :] - curve[None], axis=2)
    assert distances.min(axis=1).max() < NEAR
    assert distances.min(axis=0).max() < 2e-3
    assert np.abs(height).max() < NEAR


def test_more_speed_takes_less_time_within_the_limits(stage: Stage) -> None:
    """`speed` scales velocity, acceleration and jerk; doubling it clearly shortens the curve."""
    times = []
    for speed in (0.25, 0.5, 1.0):
        play, _, _ = executed(stage, {"circle": {"speed": speed}})
        leaf = play.arm().runs[0]
        times.append(float(leaf.metrics["duration_s"]))
        assert play.arm().clipped_setpoints == 0
    assert times[0] > 1.3 * times[1] > 1.3 * 1.3 * times[2]


@pytest.mark.parametrize("payload", [False, True])
@pytest.mark.parametrize(
    "node",
    [
        {"circle": {"radius": 0.1, "waypoints": 20, "speed": 1.0}},
        {"lissajous": {"amplitudes": [0.1, 0.1], "waypoints": 20, "speed": 1.0}},
    ],
    ids=["circle", "lissajous"],
)
def test_full_speed_curve_is_accurate_and_nearly_time_optimal(
    node: Tree, payload: bool, stage: Stage
) -> None:
    """Limits are twice the measured errors and 1.1 times TOPP-RA's bound; with 1 kg or without.

    A servo that compared velocities of different instants had an RMS error of 0.08 mm; one that
    held the acceleration of a set-point until the next one 0.006 mm.
    """
    place = {"xyz": [0.70, 0.109, 0.70]}
    weight = {"shape": "box", "size": [0.05, 0.05, 0.05], "mass": 1.0, "pose": place}
    file = Scenario({"payload": weight} if payload else {}, arm=PRESENTING).file(node)
    play = stage.play(file)
    if payload:
        play.world.attach("arm1", "payload")
    play.run()
    (leaf,) = play.arm().runs
    assert leaf.status == "SUCCESS", leaf.reason
    numbers = {name: float(value) for name, value in leaf.metrics.items()}
    assert numbers["path_rms_m"] < 4e-6
    assert numbers["path_max_m"] < 8e-6
    assert numbers["shortest_s"] < numbers["duration_s"] < 1.1 * numbers["shortest_s"]
    assert play.arm().clipped_setpoints == 0
    if payload:
        assert play.world.attachments.attached_to("arm1") == ("payload",)


def test_drawing_passes_through_its_points_and_closes(stage: Stage) -> None:
    """Each round passes every point, in the plane, with a constant orientation of the tool."""
    points = [[0.08, 0.0], [0.0, 0.06], [-0.05, 0.01], [0.02, -0.07]]
    node: Tree = {"draw": {"points": points, "repeats": 2, "speed": 1.0}}
    _, start, poses = executed(stage, node)
    flat, height = in_plane(
        np.array([pose.position for pose in poses]) - start.position, PLANES["yz"]
    )
    assert np.abs(height).max() < NEAR
    assert max(pose.angle(start) for pose in poses) < 2e-3
    rounds = np.array_split(flat[np.argmax(flat[:, 0] > 0.08 - NEAR) :], 2)
    for one in rounds:
        for point in points:
            assert np.hypot(*(one - point).T).min() < 2e-3, "samples are up to 3 mm apart"
    assert np.hypot(*(flat[-1] - points[0])) < NEAR


def test_open_drawing_starts_at_its_first_point(stage: Stage) -> None:
    node: Tree = {
        "draw": {"points": [[0.1, 0.1], [0.1, 0.15], [0.15, 0.2]], "start": "from", "closed": False}
    }
    _, start, poses = executed(stage, node)
    flat, _ = in_plane(np.array([pose.position for pose in poses]) - start.position, PLANES["yz"])
    assert np.hypot(*flat[0]) < NEAR
    assert flat[-1] == pytest.approx((0.05, 0.1), abs=NEAR)


POINTS = [[0.05, 0.0], [0.0, 0.04], [-0.03, 0.01], [0.02, -0.05]]
RETURNING: dict[str, Tree] = {
    "a circle": {"circle": {"radius": 0.05}},
    "an arc": {"circle": {"radius": 0.05, "turns": 0.3, "begin": 60, "direction": "clockwise"}},
    "a leaning circle": {"circle": {"radius": 0.04, "tilt": 20}},
    "a curve": {"lissajous": {"amplitudes": [0.05, 0.04], "phase": 70}},
    "a part of a curve": {"lissajous": {"amplitudes": [0.05, 0.04], "repeats": 0.4}},
    "one that begins and ends in the middle": {"lissajous": {"amplitudes": [0.05, 0.04]}},
    "a drawing": {"draw": {"points": POINTS}},
    "an open drawing": {"draw": {"points": POINTS, "closed": False}},
}
"""Curves that end away from their center, unless ``end: center`` is set."""


def ending_at(node: Tree, plane: str, end: str) -> Tree:
    ((skill, ports),) = node.items()
    return {skill: {**ports, "plane": plane, "end": end, "speed": 1.0}}


@pytest.mark.parametrize(
    ("node", "plane"),
    some(zip(RETURNING.values(), cycle(PLANES), strict=False), 2),
    ids=some(RETURNING, 2),
)
def test_curve_that_ends_at_its_center_can_be_repeated_without_drift(
    node: Tree, plane: str, stage: Stage
) -> None:
    """After two repetitions the tool has its initial pose."""
    node = ending_at(node, plane, "center")
    play = stage.play(Scenario(arm=PRESENTING).file({"repeat": {"times": 2, "child": node}}))
    start = play.world.arms["arm1"].tool_pose
    play.run()
    assert [leaf.status for leaf in play.arm().runs] == ["SUCCESS"] * 2, play.arm().leaves
    end = play.world.arms["arm1"].tool_pose
    assert end.distance(start) < NEAR
    assert end.angle(start) < 2e-3


@pytest.mark.parametrize("end", ["rim", "center"])
def test_circle_from_its_rim_ends_at_the_declared_point(end: str, stage: Stage) -> None:
    node: Tree = {"circle": {"radius": 0.05, "start": "from", "end": end, "speed": 1.0}}
    _, start, poses = executed(stage, node)
    middle = start.position - (0.0, 0.05, 0.0)  # it begins at angle 0 of the plane yz
    goal = start.position if end == "rim" else middle
    assert np.linalg.norm(poses[-1].position - goal) < NEAR


def test_blocked_return_path_is_refused_before_any_motion(stage: Stage) -> None:
    """The whole curve is checked first: the circle goes around a post at its center."""
    place = {"xyz": [0.66, 0.109, 0.70]}
    post = {"shape": "sphere", "size": [0.02], "mass": 1, "fixed": True, "spawned": False}
    before: tuple[Tree, ...] = (
        {"move_linear": {"offset": {"xyz": [0, 0.12, 0]}}},
        {"spawn": {"object": "post"}},
    )
    scenario = Scenario({"post": post | {"pose": place}}, PRESENTING, before)
    for end, code in (("rim", ""), ("center", "IN_COLLISION")):
        play = stage.run(scenario.file({"circle": {"radius": 0.12, "start": "from", "end": end}}))
        leaf = play.leaf("circle")
        assert leaf.code == code, leaf.reason
    assert "post" in leaf.reason
    assert play.speed_after(leaf.started_s + 0.1) < STOPPED


@pytest.mark.parametrize(
    ("robot", "pose", "curve", "walls"),
    [
        (
            "ur3",
            {"xyz": [0.171, -0.212, 0.421], "rpy": [142.3, -28.2, 154.2]},
            {"plane": "xy", "radius": 0.063},
            [(0.138, 0.257, 4.1), (0.218, 0.09, 103.7), (0.251, 0.109, 17.7)],
        ),
        (
            "ur5",
            {"xyz": [0.346, -0.148, 0.417], "rpy": [171.9, -29.8, -168.3]},
            {"plane": "xz", "radius": 0.0891},
            [(0.577, 0.026, 157.1), (0.347, 0.304, -37.0), (0.332, -0.082, -91.4)],
        ),
    ],
)
def test_every_ik_branch_is_tried_beside_walls(
    robot: str, pose: Tree, curve: Tree, walls: list[tuple[float, float, float]], stage: Stage
) -> None:
    """In the current branch of the arm, some link would hit a wall on the curve."""
    fixed = {"shape": "box", "size": [0.04, 0.25, 0.4], "mass": 20, "fixed": True}
    tree: Tree = {"sequence": [{"reach_to_pose": {"to": pose}}, {"circle": curve}]}
    file: Tree = {
        "world": {"scene": "empty", "reality": "lab", "time_limit": 30},
        "objects": {
            f"wall{i}": fixed | {"pose": {"xyz": [x, y, 0.2], "rpy": [0, 0, yaw]}}
            for i, (x, y, yaw) in enumerate(walls)
        },
        "arms": {"arm1": {"robot": robot, "base": {"xyz": [0, 0, 0.1]}, "tree": tree}},
    }
    play = stage.run(file)
    assert play.arm().outcome == "SUCCESS", play.arm().runs


@pytest.mark.parametrize("robot", some(["xarm7", "ur10"], 2))
def test_obstacle_between_tool_and_curve_is_avoided(robot: str, stage: Stage) -> None:
    """For a near start, only the straight path to it was tried: IN_COLLISION."""
    post: Tree = {"shape": "cylinder", "size": [0.006, 0.1], "mass": 1, "fixed": True}
    tree: Tree = {
        "sequence": [
            {"reach_to_pose": {"to": {"xyz": [0.5, 0, 0.5], "rpy": [180, 0, 0]}}},
            {"circle": {"plane": "xy", "radius": 0.14, "begin": 90}},
        ]
    }
    file: Tree = {
        "world": {"scene": "empty", "reality": "lab", "time_limit": 30},
        "objects": {"post": post | {"pose": {"xyz": [0.5, 0.07, 0.5]}}},
        "arms": {"arm1": {"robot": robot, "base": {"xyz": [0, 0, 0.2]}, "tree": tree}},
    }
    play = stage.run(file)
    assert play.arm().outcome == "SUCCESS", play.arm().runs


def test_a_slow_arm_may_be_as_fast_as_it_can(stage: Stage, tmp_path: Path) -> None:
    """Friction lets a joint be too fast by 0.02 rad/s in `rough`: 8 % of this arm's limit."""
    description = yaml.safe_load((share_dir("assets") / "robots/ur5.yaml").read_text("utf-8"))
    description["limits"]["velocity"] = {"value": 0.25, "source": "chosen for this test"}
    (tmp_path / "slow.yaml").write_text(yaml.safe_dump(description), encoding="utf-8")
    tree = {"circle": {"plane": "xy", "radius": 0.08, "speed": 1.0}}
    arm = {"robot": str(tmp_path / "slow.yaml"), "tree": tree}
    world = {"scene": "empty", "reality": "rough"}
    leaf = stage.run({"name": "slow", "world": world, "arms": {"arm1": arm}}, seed=2).leaf("circle")
    assert leaf.status == "SUCCESS", leaf.reason


def test_joint_that_friction_lets_go_is_not_too_fast(stage: Stage) -> None:
    """For some milliseconds, joint 2 of this FR3 exceeds its limit of 1 rad/s by 0.06 rad/s."""
    circle = {"circle": {"plane": "xy", "radius": 0.05, "speed": 1.0}}
    arm = {"robot": "fr3", "gripper": "panda_hand", "base": {"xyz": [-0.1, 0, 0]}, "tree": circle}
    world = {"scene": "empty", "reality": "rough"}
    leaf = stage.run({"name": "fast", "world": world, "arms": {"arm1": arm}}, seed=0).leaf("circle")
    assert leaf.status == "SUCCESS", leaf.reason
