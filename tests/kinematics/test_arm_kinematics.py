from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bt_dualarm.cli.bt_skills import robot_summary
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.robot_description import load_robot, robot_names
from bt_dualarm.trajectory.paths import line
from tests.sim.worlds import ROBOTS, WORLD

BASE = Pose.from_rpy((0.3, -0.6, 0.1), (0.1, -0.2, 1.0))
ARMS = {name: Kinematics(load_robot(name, WORLD), BASE) for name in ROBOTS}

shares = st.lists(st.floats(0.0, 1.0), min_size=7, max_size=7)
arms = st.sampled_from(sorted(ARMS))


def configuration(arm: Kinematics, share: list[float]) -> Vector:
    q: Vector = arm.lower + np.array(share[: arm.dof]) * (arm.upper - arm.lower)
    return q


def home(arm: Kinematics) -> Vector:
    return arm.robot.postures["home"]


def home_pose(arm: Kinematics) -> Vector:
    """Quaternion of the tool at home."""
    return arm.forward(home(arm)).quaternion


def circle(arm: Kinematics, radius: float, count: int) -> list[Pose]:
    start = arm.forward(home(arm))
    angles = np.linspace(0.0, 2.0 * np.pi, count)
    return [
        Pose(
            start.position + radius * np.array((0.0, np.sin(a), np.cos(a) - 1.0)),
            start.quaternion,
        )
        for a in angles
    ]


@given(arms, shares)
@example("panda", [0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0])  # in a corner of the joints' ranges
@settings(max_examples=60, deadline=None)
def test_solution_reaches_its_target_within_the_limits(name: str, share: list[float]) -> None:
    """FK(IK(x)) = x for every pose x of some configuration."""
    arm = ARMS[name]
    target = arm.forward(configuration(arm, share))
    q = arm.solve(target, home(arm))
    distance, angle = arm.residual(q, target)
    assert distance <= 1e-5
    assert angle <= 1e-4
    assert np.all(q >= arm.lower)
    assert np.all(q <= arm.upper)


@given(arms, shares, shares)
@settings(max_examples=20, deadline=None)
def test_solution_does_not_depend_on_earlier_ones(
    name: str, share: list[float], other: list[float]
) -> None:
    arm = ARMS[name]
    target = arm.forward(configuration(arm, share))
    first = arm.solve(target, home(arm))
    arm.solve(arm.forward(configuration(arm, other)), configuration(arm, other))
    # Not to the bit: Eigen's order of summation depends on memory addresses of its matrices, and
    # the last step then differs by some 1e-10 rad.
    np.testing.assert_allclose(arm.solve(target, home(arm)), first, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("name", ROBOTS)
def test_solution_for_the_present_pose_is_the_present_configuration(name: str) -> None:
    arm = ARMS[name]
    q = arm.solve(arm.forward(home(arm)), home(arm))
    np.testing.assert_allclose(q, home(arm), atol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_jacobian_is_the_derivative_of_the_tool_pose(name: str) -> None:
    arm = ARMS[name]
    q = home(arm) + 0.1
    h = 1e-6
    for joint in range(arm.dof):
        plus = q.copy()
        minus = q.copy()
        plus[joint] += h
        minus[joint] -= h
        after = arm.forward(plus)
        before = arm.forward(minus)
        linear = (after.position - before.position) / (2 * h)
        angular = (after.rotation * before.rotation.inv()).as_rotvec() / (2 * h)
        np.testing.assert_allclose(arm.jacobian(q)[:, joint], [*linear, *angular], atol=1e-6)


@pytest.mark.parametrize("name", ROBOTS)
def test_tool_returns_the_same_matrix_and_jacobian_as_separate_calls(name: str) -> None:
    arm = ARMS[name]
    q = home(arm)
    arm.matrix(q + 0.1)
    matrix, jacobian = arm.tool(q)
    np.testing.assert_array_equal(matrix, arm.matrix(q))
    np.testing.assert_array_equal(jacobian, arm.jacobian(q))


def test_base_pose_is_that_of_the_base_link() -> None:
    """Tool poses move with the base pose, wherever the URDF's root link is."""
    robot = load_robot("ur5")
    here = Kinematics(robot, Pose.identity()).forward(robot.postures["home"])
    there = Kinematics(robot, BASE).forward(robot.postures["home"])
    assert there.distance(BASE @ here) < 1e-12
    assert there.angle(BASE @ here) < 1e-7


def test_unreachable_target_is_refused_with_its_residual() -> None:
    arm = ARMS["ur5"]
    with pytest.raises(Failure) as caught:
        arm.solve(Pose(BASE.position + np.array((1.15, 0.0, 0.1)), home_pose(arm)), home(arm))
    assert caught.value.code == "UNREACHABLE"
    assert 0.1 < float(caught.value.numbers["residual_m"]) < 0.4


@pytest.mark.parametrize("name", robot_names())
def test_bounding_ball_contains_the_workspace_tightly(name: str) -> None:
    """No tool is outside the ball, and the farthest one is beyond 60 % of its radius."""
    arm = ARMS[name]
    rng = np.random.default_rng(0)
    center, radius = arm.bounding_ball
    tools = [arm.forward(rng.uniform(arm.lower, arm.upper)).position for _ in range(1000)]
    farthest = max(float(np.linalg.norm(tool - center)) for tool in tools)
    assert 0.6 * radius < farthest <= radius


@pytest.mark.parametrize("name", robot_names())
def test_no_reachable_pose_is_beyond_the_bound(name: str) -> None:
    """A hand at the edge of the workspace that points back to the base is beyond it."""
    arm = ARMS[name]
    rng = np.random.default_rng(0)
    tools = [arm.forward(rng.uniform(arm.lower, arm.upper)) for _ in range(1000)]
    assert not any(arm.is_beyond(tool) for tool in tools)
    center, radius = arm.bounding_ball
    away = Pose.from_rpy((0.0, 0.0, radius))
    back = Pose.from_rpy((0.0, 0.0, 0.0), (np.pi, 0.0, 0.0))
    assert arm.is_beyond(Pose(center, np.array((1.0, 0.0, 0.0, 0.0))) @ away @ back)


@pytest.mark.parametrize("name", ["ur3e", "panda"])
def test_most_unreachable_poses_of_a_camera_are_beyond_the_bound(name: str) -> None:
    """Hands that point down at the height of the shoulder and above, in front of the arm."""
    arm = ARMS[name]
    home = arm.robot.postures["home"]
    rng = np.random.default_rng(3)
    center, radius = arm.bounding_ball
    count = refused = 0
    while count < 15:
        place = center + rng.uniform((0.3, -0.5, 0.2), (0.9, 0.5, 0.6)) * radius
        pose = Pose.from_rpy(tuple(place.tolist()), (np.pi, 0.0, rng.uniform(-np.pi, np.pi)))
        try:
            arm.solve(pose, home)
            assert not arm.is_beyond(pose)
        except Failure as failure:
            if failure.code == "UNREACHABLE":
                count += 1
                refused += arm.is_beyond(pose)
    assert refused >= 12


def test_target_outside_the_workspace_is_invalid() -> None:
    """There is no search for it, and a path that ends there is refused."""
    arm = ARMS["ur5"]
    start = arm.forward(home(arm))
    away = Pose.from_rpy((5.0, 0.0, 0.0))
    with pytest.raises(Failure, match="outside the workspace") as caught:
        arm.solve(away, home(arm))
    assert caught.value.code == "INVALID_TARGET"
    assert float(caught.value.numbers["distance_m"]) > 4.0
    reach = robot_summary(load_robot("ur5")).reach_m
    assert float(caught.value.numbers["reach_m"]) == pytest.approx(reach, abs=0.005), (
        "the same number"
    )
    with pytest.raises(Failure, match="INVALID_TARGET"):
        arm.follow([start, away], home(arm))


@pytest.mark.parametrize(
    "quaternion", [(2.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), (float("nan"), 0.0, 0.0, 1.0)]
)
def test_invalid_pose_is_refused(quaternion: tuple[float, ...]) -> None:
    arm = ARMS["ur5"]
    with pytest.raises(Failure, match="INVALID_TARGET"):
        arm.solve(Pose(np.zeros(3), np.array(quaternion)), home(arm))


@pytest.mark.parametrize("name", robot_names())
def test_circle_is_followed_without_a_jump_and_closes_in_the_joints(name: str) -> None:
    arm = ARMS[name]
    poses = circle(arm, 0.05, 150)
    rows = arm.follow(poses, home(arm))
    assert rows.shape == (150, arm.dof)
    assert np.abs(np.diff(rows, axis=0)).max() < 0.05
    np.testing.assert_allclose(rows[0], home(arm), atol=1e-6)
    np.testing.assert_allclose(rows[-1], rows[0], atol=1e-6)
    for q, pose in zip(rows, poses, strict=True):
        assert arm.residual(q, pose)[0] <= 1e-5


def test_path_that_becomes_unreachable_is_refused_with_the_possible_fraction() -> None:
    arm = ARMS["ur5"]
    start = arm.forward(home(arm))
    away = (start.position - BASE.position) / np.linalg.norm(start.position - BASE.position)
    poses = [Pose(start.position + x * away, start.quaternion) for x in np.arange(0, 0.6, 2 / 199)]
    with pytest.raises(Failure) as caught:
        arm.follow(poses, home(arm))
    assert caught.value.code == "PATH_BROKEN"
    assert 0.0 < float(caught.value.numbers["fraction"]) < 1.0


def test_condition_grows_at_a_singularity() -> None:
    arm = ARMS["ur5"]
    stretched = np.deg2rad((0.0, -90.0, 0.0, -90.0, 0.0, 0.0))
    assert arm.condition(home(arm)) < 50.0 < arm.condition(stretched)


def steps(start: Pose, offset: tuple[float, float, float]) -> list[Pose]:
    return line(start, Pose(start.position + np.array(offset), start.quaternion)).poses


@pytest.mark.parametrize(
    ("q", "offset"),
    [
        ((-2.27, 0.33, -1.34, -2.23, -1.18, 0.43, 1.35), (-0.1, -0.26, 0.11)),
        ((-2.13, -1.55, -2.54, -2.32, 0.32, 1.6, -1.66), (-0.21, -0.16, -0.14)),
    ],
)
def test_redundant_arm_keeps_away_from_its_limits_along_a_path(
    q: tuple[float, ...], offset: tuple[float, float, float]
) -> None:
    """The shortest steps would follow a joint's limit; the elbow moves aside by 3°."""
    arm = ARMS["panda"]
    start = np.array(q)
    rows = arm.follow(steps(arm.forward(start), offset), start)
    assert np.abs(rows[0] - start).max() < 1e-6
    assert arm.room(rows) > 0.0499


@pytest.mark.parametrize("name", ["panda", "ur5", "xarm7"])
def test_best_conditioned_solution_is_conditioned_no_worse_than_the_nearest(name: str) -> None:
    arm = ARMS[name]
    rng = np.random.default_rng(5)
    gains = []
    for _ in range(12):
        target = arm.forward(rng.uniform(arm.lower, arm.upper))
        nearest = arm.solve(target, home(arm))
        best = arm.solve(target, home(arm), prefer="conditioned")
        assert arm.residual(best, target)[0] <= 1e-5
        assert np.abs(nearest - home(arm)).sum() <= np.abs(best - home(arm)).sum() * 1.5
        if arm.room(nearest) > 0.1:  # the distance to the limits takes priority
            gains.append(arm.condition(nearest) / arm.condition(best))
    assert min(gains) > 0.999
    assert max(gains) > 1.2


def poses_followed(arm: Kinematics, poses: list[Pose], q: Vector) -> int:
    """Number of poses, from one configuration, until a joint jumps or a pose is unreachable."""
    for count, pose in enumerate(poses):
        try:
            last = q
            q = arm.solve(pose, q)
        except Failure:
            return count
        if np.abs(q - last).max() > 0.2:
            return count
    return len(poses)


def test_path_that_the_start_branch_cannot_follow_uses_another_branch() -> None:
    """The present elbow allows two thirds of the path; with the shoulder turned it is possible."""
    arm = Kinematics(load_robot("ur5"), Pose.identity())
    here = np.array((0.47, -2.45, 1.15, -1.92, -2.21, 0.48))
    poses = steps(arm.forward(here), (0.17, -0.15, -0.15))
    assert poses_followed(arm, poses, here) < 0.7 * len(poses)
    rows = arm.follow(poses, here)
    assert np.abs(rows[0] - here).max() > 1.0
    assert np.abs(np.diff(rows, axis=0)).max() < 0.2
    assert max(arm.residual(q, pose)[0] for q, pose in zip(rows, poses, strict=True)) <= 1e-5
    assert max(arm.condition(q) for q in rows) < 50.0


def bad_start(arm: Kinematics, share: list[float]) -> Vector:
    """Any configuration, also near joint limits and singularities."""
    inside = 0.02 + 0.96 * np.array(share[: arm.dof])
    return configuration(arm, inside.tolist())


@given(arms, shares)
@settings(max_examples=60, deadline=None)
def test_follow_on_starts_at_the_configuration_and_never_jumps(
    name: str, share: list[float]
) -> None:
    """The first row is the configuration to the last bit; `follow` might choose another branch."""
    arm = ARMS[name]
    start = bad_start(arm, share)
    here = arm.forward(start)
    try:
        rows = arm.follow_on(line(here, here @ Pose.from_rpy((0, 0, 0.03))).poses, start)
    except Failure:
        return  # at a limit, or stretched: the path is unreachable
    assert np.array_equal(rows[0], start)
    assert np.abs(np.diff(rows, axis=0)).max() <= 0.2 + 1e-9
    assert arm.residual(rows[-1], here @ Pose.from_rpy((0, 0, 0.03)))[0] <= 1e-5


def test_branches_of_a_path_are_complete_and_different() -> None:
    """Each of a Panda's branches starts at the first pose and ends at the last."""
    arm = ARMS["panda"]
    start = arm.forward(home(arm))
    poses = steps(start, (0.0, 0.0, -0.1))
    ends = []
    for rows in arm.branches_along(poses, home(arm)):
        assert arm.residual(rows[0], poses[0])[0] <= 1e-5
        assert arm.residual(rows[-1], poses[-1])[0] <= 1e-5
        ends.append(rows[-1])
    assert len(ends) > 1
    apart = [np.abs(a - b).max() for i, a in enumerate(ends) for b in ends[:i]]
    assert min(apart) > 1e-3


def test_redundant_arm_changes_its_posture_where_the_present_one_becomes_singular() -> None:
    """A Panda that had opened a door could not close it: it became singular on the return path."""
    panda = Kinematics(
        load_robot("panda"), Pose(np.array((0.0, 0.0, 0.4)), np.array((1.0, 0, 0, 0)))
    )
    q = np.array((0.31303, -0.5602, 0.07268, -2.84748, -0.92258, 2.12606, 2.84933))
    anchor = np.array((0.5905, 0.0790, 0.0))
    start = Pose.from_matrix(panda.matrix(q))
    turns = (Pose.from_rpy((0, 0, 0), (0, 0, angle)) for angle in np.linspace(0.0, 0.925, 32))
    poses = [
        Pose(anchor, turn.quaternion) @ Pose(-anchor, np.array((1.0, 0, 0, 0))) @ start
        for turn in turns
    ]
    with pytest.raises(Failure, match="SINGULAR"):
        panda.follow_on(poses, q)
    rows = panda.follow_on(poses, q, changes_posture=True)
    assert (rows[0] == q).all()
    assert np.abs(np.diff(rows, axis=0)).max() < 0.2
    for pose, row in zip(poses, rows, strict=True):
        reached = Pose.from_matrix(panda.matrix(row))
        assert reached.distance(pose) < 1e-4
        assert reached.angle(pose) < 1e-3
