"""Plan monitor: a running motion is checked against the world as it changes."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.core.errors import Failure
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.safety.guard import AHEAD_S, MONITOR_PERIOD_S, PlanMonitor
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.path_timing import point_to_point
from bt_dualarm.trajectory.set_points import TrajectorySource
from tests.control.walls import DT, LEFT, RIGHT, wall
from tests.sim.worlds import arm, box, file_of

FAR = (0.0, 1.5, 0.3)
"""Position out of reach, m."""


AWAY = (0.0, -3.0, 0.4)


class Scene:
    """An arm that moves slowly from right to left, objects that can appear, and a clock."""

    def __init__(
        self,
        speed: float = 0.1,
        other: tuple[float, float, float] = AWAY,
        *,
        standing: bool = False,
    ) -> None:
        objects = {
            "wall": wall(spawned=standing),
            "cube": box(FAR, fixed=False),
            "far": box((0.0, 1.8, 0.3), fixed=True, spawned=False),
        }
        arms = {"arm1": arm("ur5"), "arm2": arm("ur5", other)}
        self.world = World(file_of(arms, objects))
        body = self.world.arms["arm1"]
        body.data.qpos[body.qpos_ids] = RIGHT
        self.world.sense()
        limits = body.robot.limits.scaled(speed)
        self.motion = TrajectorySource(point_to_point(RIGHT, LEFT, limits, DT))
        self.monitor = PlanMonitor(self.world, "arm1", self.motion, frozenset())
        self.time = 0.0

    def advance(self, seconds: float) -> None:
        """Advance the motion; the monitor checks when it is due."""
        for _ in range(round(seconds / DT)):
            self.motion.next(self.time)
            self.time += DT
            self.monitor.look(self.time)

    def put(self, obj: str, place: tuple[float, float, float]) -> None:
        """Move an object."""
        model = self.world.model
        start = int(model.jnt_qposadr[model.body_jntadr[self.world.object_body(obj)]])
        self.world.data.qpos[start : start + 3] = place
        self.world.sense()


def test_obstacles_at_planning_time_do_not_stop_the_motion() -> None:
    """The plan took it into account; objects that move elsewhere make no difference."""
    scene = Scene(standing=True)
    scene.advance(1.0)
    scene.put("cube", (0.0, 1.4, 0.3))
    scene.advance(1.0)
    scene.world.remove_object("wall")
    scene.advance(2 * MONITOR_PERIOD_S)
    scene.world.spawn_object("wall")
    with pytest.raises(Failure, match="wall now blocks the path"):
        scene.advance(2 * MONITOR_PERIOD_S)


def test_a_thin_wall_that_appears_in_the_path_is_detected_within_a_period() -> None:
    scene = Scene()
    scene.advance(0.5)
    scene.world.spawn_object("wall")
    before = scene.time
    with pytest.raises(Failure, match="wall now blocks the path of arm1/") as caught:
        scene.advance(5.0)
    assert caught.value.code == "IN_COLLISION"
    assert caught.value.numbers["second"] == "wall"
    assert caught.value.numbers["progress"] == pytest.approx(scene.motion.progress)
    assert scene.time <= before + MONITOR_PERIOD_S


def test_an_object_at_the_far_end_of_the_path_is_detected_in_time() -> None:
    """The object moves only once, long before the arm is near."""
    scene = Scene(speed=0.05)
    goal = end_of_motion(scene)
    scene.advance(0.3)
    scene.put("cube", goal)
    scene.advance(1.0)  # the end is farther ahead than is checked
    remaining = scene.motion.trajectory.duration - scene.time
    assert remaining > AHEAD_S + 1.0
    with pytest.raises(Failure, match="cube now blocks the path"):
        scene.advance(remaining)
    assert scene.motion.trajectory.duration - scene.time > 0.5


def test_an_object_beside_the_path_does_not_matter() -> None:
    scene = Scene(speed=1.0)
    scene.advance(0.3)
    scene.world.spawn_object("far")
    scene.put("cube", (0.0, 1.4, 0.3))
    scene.advance(scene.motion.trajectory.duration)
    assert scene.motion.done


def test_a_paused_arm_checks_no_farther_and_can_go_on() -> None:
    """Between two checks it does not advance; an object that moved beside it is checked once."""
    scene = Scene()
    scene.advance(0.3)
    body = scene.world.arms["arm1"]
    x, y, z = Kinematics(body.robot, body.base).forward(RIGHT).position.tolist()
    scene.put("cube", (x, y - 0.2, z))  # behind it, within reach
    for _ in range(4):  # the guard sends no new set-points meanwhile
        scene.time += MONITOR_PERIOD_S
        scene.monitor.look(scene.time)
    assert not scene.motion.done
    scene.world.spawn_object("wall")
    with pytest.raises(Failure, match="wall now blocks the path"):
        scene.advance(2 * MONITOR_PERIOD_S)


@pytest.mark.parametrize("speed", [0.01, 0.02])
def test_a_creeping_arm_detects_an_object_at_the_end_of_its_path(speed: float) -> None:
    """Between two checks it advances by less than two of the configurations that are checked."""
    scene = Scene(speed)
    scene.motion = TrajectorySource(
        point_to_point(RIGHT, 0.8 * RIGHT, scene.world.robots["arm1"].limits.scaled(speed), DT)
    )
    scene.monitor = PlanMonitor(scene.world, "arm1", scene.motion, frozenset())
    body = scene.world.arms["arm1"]
    goal = Kinematics(body.robot, body.base).forward(0.8 * RIGHT).position
    scene.advance(0.3)
    scene.put("cube", (float(goal[0]), float(goal[1]), float(goal[2])))
    with pytest.raises(Failure, match="cube now blocks the path"):
        scene.advance(scene.motion.trajectory.duration)


def test_an_object_held_by_a_moving_arm_is_no_obstacle_yet() -> None:
    """It becomes an obstacle only when the arm that holds it stops."""
    scene = Scene(other=(0.8, 0.9, 0.4))
    scene.world.attach("arm2", "cube")
    scene.monitor = PlanMonitor(scene.world, "arm1", scene.motion, frozenset())
    other = scene.world.arms["arm2"]
    body = scene.world.arms["arm1"]
    x, y, z = Kinematics(body.robot, body.base).forward(0.6 * RIGHT + 0.4 * LEFT).position.tolist()
    other.data.qvel[other.dof_ids[0]] = 1.0
    scene.put("cube", (x, y, z))
    scene.advance(0.5)
    other.data.qvel[other.dof_ids[0]] = 0.0
    scene.world.sense()
    with pytest.raises(Failure, match="cube now blocks the path"):
        scene.advance(0.5)


def test_an_arm_that_passes_by_does_not_matter_but_one_that_stays_does() -> None:
    """The guard handles moving arms; one that has stopped in the path is an obstacle."""
    scene = Scene(other=(0.8, 0.0, 0.4))
    other = scene.world.arms["arm2"]
    scene.advance(0.3)
    other.data.qpos[other.qpos_ids[0]] += np.pi  # toward the first arm
    other.data.qvel[other.dof_ids[0]] = 1.0
    scene.world.sense()
    scene.advance(0.5)
    other.data.qvel[other.dof_ids[0]] = 0.0
    scene.world.sense()
    with pytest.raises(Failure, match="arm2/"):
        scene.advance(0.5)


def test_a_motion_without_another_plan_waits_for_an_arm_that_stays() -> None:
    """The guard holds it; an object that another arm has put down there is in its path for good."""
    scene = Scene(other=(0.8, 0.0, 0.4))
    scene.monitor = PlanMonitor(scene.world, "arm1", scene.motion, frozenset(), waits_for_arms=True)
    other = scene.world.arms["arm2"]
    scene.advance(0.3)
    other.data.qpos[other.qpos_ids[0]] += np.pi  # toward the first arm
    scene.world.sense()
    scene.advance(1.0)
    body = scene.world.arms["arm1"]
    q = scene.motion.trajectory.q[round(scene.motion.parameter.s / DT) + 200]
    x, y, z = Kinematics(body.robot, body.base).forward(q).position.tolist()
    scene.put("cube", (x, y, z))  # nearer than the arm
    with pytest.raises(Failure, match="cube now blocks the path"):
        scene.advance(2 * MONITOR_PERIOD_S)


def end_of_motion(scene: Scene) -> tuple[float, float, float]:
    """Position of the tool at the end of the motion, m."""
    body = scene.world.arms["arm1"]
    place = Kinematics(body.robot, body.base).forward(LEFT).position
    return float(place[0]), float(place[1]), float(place[2])
