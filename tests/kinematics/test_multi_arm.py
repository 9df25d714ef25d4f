"""Inverse kinematics of several arms: relative poses, residuals and joint limits."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.kinematics.multi_arm import MultiArmKinematics as Arms
from bt_dualarm.kinematics.multi_arm import ToolTarget
from bt_dualarm.robots.robot_description import load_robot

BASES = {
    "arm1": ("ur5", Pose.from_rpy((0.0, 0.0, 0.4))),
    "arm2": ("panda", Pose.from_rpy((1.3, 0.0, 0.2), (0.0, 0.0, np.pi))),
}
ARMS = {name: (load_robot(robot), base) for name, (robot, base) in BASES.items()}
NEAR = {name: robot.postures["home"] for name, (robot, _) in ARMS.items()}
ALONE = {name: Kinematics(robot, base) for name, (robot, base) in ARMS.items()}


@pytest.fixture(scope="module")
def body() -> Arms:
    return Arms(ARMS)


def assert_within_limits(q: dict[str, Vector]) -> None:
    for name, (robot, _) in ARMS.items():
        assert np.all(q[name] >= robot.limits.lower)
        assert np.all(q[name] <= robot.limits.upper)


def held(body: Arms) -> Pose:
    """The Panda's tool seen from the UR5's, both at home."""
    return body.forward("arm1", NEAR).inverse @ body.forward("arm2", NEAR)


@pytest.mark.parametrize("name", sorted(ARMS))
def test_forward_kinematics_agree_with_each_arm_alone(name: str, body: Arms) -> None:
    alone = ALONE[name].forward(NEAR[name])
    assert body.forward(name, NEAR).distance(alone) < 1e-9
    assert body.forward(name, NEAR).angle(alone) < 1e-7


def test_two_different_arms_keep_a_relative_pose_along_a_line(
    body: Arms,
) -> None:
    """One tool moves 0.2 m; the other follows it within 1e-4 m and 1e-3 rad, checked per arm."""
    start = body.forward("arm1", NEAR)
    grip = held(body)
    line = [
        Pose(start.position + share * np.array((0.0, 0.14, -0.14)), start.quaternion)
        for share in np.linspace(0.0, 1.0, 60)
    ]
    steps = [(ToolTarget("arm1", pose), ToolTarget("arm2", grip, "arm1")) for pose in line]
    paths = body.follow(steps, NEAR)
    for i, pose in enumerate(line):
        one, two = (ALONE[name].forward(paths[name][i]) for name in ARMS)
        assert one.distance(pose) < 1e-4
        assert one.angle(pose) < 1e-3
        assert (one.inverse @ two).distance(grip) < 1e-4
        assert (one.inverse @ two).angle(grip) < 1e-3
        assert_within_limits({name: path[i] for name, path in paths.items()})
    for name, path in paths.items():
        np.testing.assert_allclose(path[0], NEAR[name], atol=1e-4)
        assert np.abs(np.diff(path, axis=0)).max() < 0.05


def test_closed_path_closes_in_the_joints_of_both_arms(body: Arms) -> None:
    start = body.forward("arm1", NEAR)
    grip = held(body)
    angles = np.linspace(0.0, 2.0 * np.pi, 80)
    circle = [
        Pose(start.position + 0.05 * np.array((0.0, np.sin(a), np.cos(a) - 1)), start.quaternion)
        for a in angles
    ]
    steps = [(ToolTarget("arm1", pose), ToolTarget("arm2", grip, "arm1")) for pose in circle]
    for path in body.follow(steps, NEAR).values():
        np.testing.assert_allclose(path[-1], path[0], atol=1e-5)


def test_relative_target_alone_moves_both_arms_slightly(body: Arms) -> None:
    """The pose in the world is free, so both arms move, and neither far."""
    grip = held(body) @ Pose.from_rpy((0.0, 0.0, 0.05))
    q = body.solve([ToolTarget("arm2", grip, "arm1")], NEAR)
    one, two = (ALONE[name].forward(q[name]) for name in ARMS)
    assert (one.inverse @ two).distance(grip) < 1e-5
    assert max(np.abs(q[name] - NEAR[name]).max() for name in ARMS) < 0.5
    assert all(np.abs(q[name] - NEAR[name]).max() > 1e-4 for name in ARMS)


def test_far_targets_are_found_by_seeded_restarts(body: Arms) -> None:
    """Targets are poses of random configurations; a new problem finds the same solution."""
    rng = np.random.default_rng(3)
    for _ in range(10):
        q = {
            name: rng.uniform(robot.limits.lower, robot.limits.upper)
            for name, (robot, _) in ARMS.items()
        }
        targets = [ToolTarget(name, ALONE[name].forward(q[name])) for name in ARMS]
        found = body.solve(targets, NEAR)
        assert_within_limits(found)
        again = Arms(ARMS).solve(targets, NEAR)
        for name in ARMS:
            assert ALONE[name].residual(found[name], targets[list(ARMS).index(name)].pose)[0] < 1e-5
            np.testing.assert_allclose(again[name], found[name], atol=1e-8)


def test_arm_without_a_target_stays(body: Arms) -> None:
    goal = body.forward("arm1", NEAR) @ Pose.from_rpy((0.0, 0.0, 0.1))
    q = body.solve([ToolTarget("arm1", goal)], NEAR)
    np.testing.assert_allclose(q["arm2"], NEAR["arm2"], atol=1e-9)


def test_unreachable_target_is_refused_with_its_name_and_residual(
    body: Arms,
) -> None:
    away = Pose.from_rpy((0.0, 0.0, 5.0))
    targets = [ToolTarget("arm1", body.forward("arm1", NEAR)), ToolTarget("arm2", away, "arm1")]
    with pytest.raises(Failure, match="the tool of arm2 seen from arm1 gets no closer") as caught:
        body.solve(targets, NEAR)
    assert caught.value.code == "UNREACHABLE"
    assert float(caught.value.numbers["residual_m"]) > 2.0


def test_path_that_one_arm_cannot_follow_is_refused_as_a_whole(body: Arms) -> None:
    start = body.forward("arm1", NEAR)
    grip = held(body)
    line = [
        Pose(start.position + share * np.array((0.0, 0.0, 1.5)), start.quaternion)
        for share in np.linspace(0.0, 1.0, 100)
    ]
    steps = [(ToolTarget("arm1", pose), ToolTarget("arm2", grip, "arm1")) for pose in line]
    with pytest.raises(Failure, match="PATH_BROKEN") as caught:
        body.follow(steps, NEAR)
    assert 0.0 < float(caught.value.numbers["fraction"]) < 1.0


@pytest.mark.parametrize(
    ("targets", "reason"),
    [
        ([], "no target"),
        ([ToolTarget("arm3", Pose.identity())], "no arm 'arm3'"),
        ([ToolTarget("arm1", Pose.identity(), "arm1")], "given relative to itself"),
        ([ToolTarget("arm1", Pose.identity()), ToolTarget("arm1", Pose.identity())], "two targets"),
        ([ToolTarget("arm1", Pose(np.zeros(3), np.full(4, np.nan)))], "is not a pose"),
    ],
)
def test_invalid_targets_are_refused(targets: list[ToolTarget], reason: str, body: Arms) -> None:
    with pytest.raises(Failure, match=reason) as caught:
        body.solve(targets, NEAR)
    assert caught.value.code == "INVALID_TARGET"


def test_single_arm_is_solved() -> None:
    body = Arms({"arm1": ARMS["arm1"]})
    goal = ALONE["arm1"].forward(NEAR["arm1"] + 0.3)
    q = body.solve([ToolTarget("arm1", goal)], {"arm1": NEAR["arm1"]})["arm1"]
    assert ALONE["arm1"].residual(q, goal)[0] < 1e-5
