"""Path constraints: violations, projections, plans that keep them, and failures."""

from __future__ import annotations

import itertools
import pickle
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.box_problems import problems
from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.planning.path_constraints import Cone, ConstrainedProblem, PathConstraint
from bt_dualarm.planning.problem import PlanningProblem, admitted
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.paths import line
from tests.sim.worlds import arm, box, file_of

UP = np.array((0.0, 0.0, 1.0))


def constraint(**limits: object) -> PathConstraint:
    """A constraint for the tool of a UR5 at the origin."""
    fields = {"robot": load_robot("ur5"), "base": Pose.identity(), "in_tool": Pose.identity()}
    return PathConstraint(**{**fields, **limits})  # type: ignore[arg-type]


def random_poses(count: int) -> list[Pose]:
    rng = np.random.default_rng(3)
    return [
        Pose.from_rpy(rng.uniform(-1, 1, 3).tolist(), rng.uniform(-np.pi, np.pi, 3).tolist())
        for _ in range(count)
    ]


def test_the_violation_is_the_angle_and_the_height_beyond_the_limits() -> None:
    keep = constraint(cones=(Cone("upright", UP, 0.1, UP),), lowest=0.2, highest=0.5)
    assert not keep.violation(Pose.from_rpy((0, 0, 0.3), (0.05, 0.0, 2.0)))
    found = keep.violation(Pose.from_rpy((0, 0, 0.55), (0.0, 0.3, 0.0)))
    assert (found.rad, found.m) == pytest.approx((0.2, 0.05))
    assert found.what == "upright: 17.2° of 5.73°; height: 0.5500 m, not 0.2 to 0.5 m"
    assert keep.violation(Pose.from_rpy((0, 0, 0.1))).m == pytest.approx(0.1)


@pytest.mark.parametrize(
    "cone",
    [
        Cone("upright", UP, 0.1, UP),
        Cone("facing", np.array((1.0, 0.0, 0.0)), 0.3, np.array((0.0, -0.6, 0.8))),
        Cone("facing", UP, 0.2, point=np.array((3.0, 0.2, 0.1))),
    ],
    ids=["upright", "direction", "point"],
)
def test_a_projected_pose_keeps_the_limits_and_turns_no_more_than_needed(cone: Cone) -> None:
    keep = constraint(cones=(cone,), lowest=-0.2, highest=0.4)
    for pose in random_poses(200):
        projected = keep.projected(pose)
        violation = keep.violation(projected)
        assert violation.rad < 1e-9
        assert violation.m == 0.0
        assert projected.position[:2] == pytest.approx(pose.position[:2])
        raised = Pose(projected.position, pose.quaternion)
        beyond = max(cone.angle(raised) - cone.most, 0.0)
        assert pose.angle(projected) == pytest.approx(beyond, abs=1e-6)


def test_the_opposite_of_a_cone_is_projected_as_well() -> None:
    keep = constraint(cones=(Cone("upright", UP, 0.1, UP),))
    assert (
        not keep.violation(keep.projected(Pose.from_rpy((0, 0, 0), (np.pi, 0.0, 0.0)))).rad > 1e-9
    )


def test_the_margin_never_excludes_start_or_goal() -> None:
    keep = constraint(cones=(Cone("upright", UP, 0.1, UP),), lowest=0.2, highest=0.5)
    inside = Pose.from_rpy((0, 0, 0.3))
    edge = Pose.from_rpy((0, 0, 0.2), (0.0999, 0.0, 0.0))
    assert keep.within(inside).cones[0].most == pytest.approx(0.1 - np.radians(0.5))
    assert (keep.within(inside).lowest, keep.within(inside).highest) == pytest.approx(
        (0.202, 0.498)
    )
    assert not keep.within(inside, edge).violation(edge)
    assert keep.within(inside, edge).cones[0].most <= 0.1


def upright(world: World, name: str, problem: PlanningProblem, most_deg: float) -> PathConstraint:
    """A constraint that keeps upright what points up in the tool at the start."""
    body = world.arms[name]
    start = Kinematics(body.robot, body.base).forward(problem.start)
    cone = Cone("upright", start.inverse.turn(UP), np.radians(most_deg), UP)
    return PathConstraint(body.robot, body.base, Pose.identity(), (cone,))


@pytest.mark.parametrize("number", [2, 3, 4])  # UR5, Panda, UR5; all need a search
def test_a_plan_keeps_the_tool_upright_at_every_set_point(number: int) -> None:
    world, name, problem = next(itertools.islice(problems(0), number, None))
    keep = upright(world, name, problem, 5.0)
    unpickled: ConstrainedProblem = pickle.loads(  # noqa: S301 - our own
        pickle.dumps(ConstrainedProblem(admitted(problem), keep))
    )
    motion = unpickled.motion()
    kinematics = Kinematics(keep.robot, keep.base)
    worst = max(keep.cones[0].angle(kinematics.forward(q)) for q in motion.q)
    assert worst <= np.radians(5.0)
    assert unpickled.keeps(motion)
    assert all(problem.checker.free(q) for q in motion.q[::5])
    goal = kinematics.forward(problem.goals[0])
    assert kinematics.forward(motion.q[-1]).distance(goal) < 1e-5
    again = ConstrainedProblem(admitted(problem), keep).motion()
    assert (again.q == motion.q).all()  # one seed, one plan


def test_a_missing_path_is_reported() -> None:
    """A wall between start and goal is higher than the tool may go."""
    wall = box((0.5, 0.0, 0.5), fixed=True).model_copy(update={"size": (1.6, 0.02, 1.0)})
    world = World(file_of({"arm1": arm("ur5", xyz=(0.0, 0.0, 0.0))}, {"wall": wall}))
    body = world.arms["arm1"]
    kinematics = Kinematics(body.robot, body.base)
    near = world.hardware["arm1"].q
    down = (np.pi, 0.0, 0.0)
    start = kinematics.solve(Pose.from_rpy((0.4, -0.3, 0.4), down), near)
    goal = kinematics.solve(Pose.from_rpy((0.4, 0.3, 0.4), down), near)
    checker = CollisionChecker(world, "arm1")
    problem = PlanningProblem(checker, start, (goal,), body.robot.limits, 0.004)
    keep = replace(constraint(), lowest=0.3, highest=0.5)
    with pytest.raises(Failure, match="along which the arm keeps height") as caught:
        ConstrainedProblem(problem, keep, 1500).motion()
    assert caught.value.code == "NO_PLAN"
    with pytest.raises(Failure, match="no longer needed"):
        ConstrainedProblem(problem, keep).motion(lambda: True)


def test_a_search_ends_where_all_paths_lead_to_another_configuration() -> None:
    """Upright, a UR5 cannot leave its branch; the search once went on until its budget ended."""
    world = World(file_of({"arm1": arm("ur5", xyz=(0.0, 0.0, 0.0))}))
    body = world.arms["arm1"]
    kinematics = Kinematics(body.robot, body.base)
    near = world.hardware["arm1"].q
    down = (np.pi, 0.0, 0.0)
    start = kinematics.solve(Pose.from_rpy((0.4, -0.2, 0.4), down), near)
    there = Pose.from_rpy((0.4, 0.2, 0.4), down)
    reached = kinematics.follow_on(line(kinematics.forward(start), there).poses, start)[-1]
    checker = CollisionChecker(world, "arm1")
    branches = kinematics.solutions(there, start, every_branch=True)
    others = tuple(q for q in branches if np.abs(q - reached).max() > 0.5 and checker.free(q))
    assert others
    problem = PlanningProblem(checker, start, others, body.robot.limits, 0.004)
    keep = upright(world, "arm1", problem, 5.0)
    with pytest.raises(Failure, match="except to another configuration") as caught:
        ConstrainedProblem(problem, keep, at_goals=True).motion()
    assert caught.value.code == "NO_PLAN"
    assert int(caught.value.numbers["states"]) < 20_000
    ends = ConstrainedProblem(problem, keep).motion().q[-1]
    assert ends == pytest.approx(reached, abs=1e-3)
