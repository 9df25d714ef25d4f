"""An arm stops at once for a collision, and for nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.collision_detection import Bench, free, hit
from bt_dualarm.control.collision_detection import CollisionDetector
from bt_dualarm.control.dynamics import ArmDynamics
from bt_dualarm.core.errors import CollisionDetectedFailure
from bt_dualarm.skill.registry import Registry
from bt_dualarm.trajectory.set_points import SetPoint
from tests.plays import STOPPED, Stage
from tests.skills.scenarios import Tree
from tests.skills.trials import pushes

NODE_TYPES = Registry.load().kinds


@pytest.mark.parametrize(
    ("robot", "reality", "seed"),
    [("ur5", "lab", 0), ("ur5", "rough", 2), ("panda", "rough", 4), ("xarm7", "lab", 5)],
)
def test_collision_is_detected_within_20_ms(robot: str, reality: str, seed: int) -> None:
    found = hit(robot, reality, seed, NODE_TYPES)
    assert not found.by_link
    assert found.felt_s is not None, found
    assert 0.0 <= found.felt_s <= 0.02 + 1e-9, found


@pytest.mark.parametrize(
    ("robot", "reality", "seed"),
    [("ur10", "lab", 5), ("panda", "rough", 5), ("panda", "rough", 4)],
)
def test_free_motion_has_no_false_detection(robot: str, reality: str, seed: int) -> None:
    """The arm moves at full speed, with wrong friction and masses, from the first motion on.

    Motions of seed 4 caused a false detection when the noise had been learned only at rest.
    """
    assert free(robot, reality, seed, 6.0, NODE_TYPES) == []


def test_allowances_for_successive_changes_of_acceleration_add_up() -> None:
    """Noisy images change an arm's acceleration again and again; each change counts alike."""
    world = Bench("panda", "rough", 0, NODE_TYPES).world
    dynamics = ArmDynamics(world.nominal["arm1"])
    still = np.zeros(7)
    dynamics.update(world.hardware["arm1"].q, still)
    inertia = dynamics.inertia
    thresholds = []
    for changes in (0, 1, 5):
        detector = CollisionDetector(world.nominal["arm1"].friction, 1.0)
        for step in range(20):
            a = 5.0 * float(step > 10 and min(step - 10, changes) % 2)
            assert not detector.update(inertia, SetPoint(still, np.ones(7), np.full(7, a)), still)
        thresholds.append(detector.threshold)
    none, one, five = thresholds
    assert five - none == pytest.approx(5.0 * (one - none))
    assert (one > none).all()


@pytest.mark.parametrize("collision", [{"stop": False}, {"stop": True, "threshold": 1000.0}])
def test_collision_settings_of_the_file_apply(collision: dict[str, float]) -> None:
    assert "COLLISION" not in hit("panda", "lab", 0, NODE_TYPES, collision).reason.partition(":")[0]


def test_motion_that_may_touch_ignores_collisions() -> None:
    """The same push ends a motion that may not touch anything."""
    faults = []
    for may_touch in (True, False):
        bench = Bench("ur5", "lab", 0, NODE_TYPES)
        world = bench.world
        controller = bench.controller
        goal = controller.setpoint.q + np.array((0.6, -0.2, 0.0, 0.0, 0.0, 0.0))
        controller.follow(bench.to(goal, 0.5), may_touch=may_touch)
        for step in range(80):
            controller.update(world.time)
            body = world.arms["arm1"].tool_body
            world.data.xfrc_applied[body, :2] = 60.0 * (step > 50), -60.0 * (step > 50)
            world.step()
            world.step()
        faults.append(controller.fault)
    assert faults[0] is None
    assert isinstance(faults[1], CollisionDetectedFailure)
    assert faults[1].numbers["force_n"] == pytest.approx(85, rel=0.6)


def test_leaf_fails_with_the_joint_and_the_torque(stage: Stage) -> None:
    """The arm is at rest a second later although it is still being pushed."""
    leaf: Tree = {"move_linear": {"offset": {"xyz": [0, 0.25, 0]}, "speed": 0.3}}
    arm: Tree = {"robot": "ur5", "base": {"xyz": [0, 0, 0.4]}, "posture": "present"}
    tree: Tree = {"sequence": [{"force_success": {"child": leaf}}, {"wait": {"seconds": 1.0}}]}
    file: Tree = {
        "world": {"scene": "empty", "time_limit": 20, "reality": "lab"},
        "arms": {"arm1": arm | {"collision": {"stop": True}, "tree": tree}},
    }
    play = stage.run(file, interventions=[(0.4, pushes("arm1/wrist_3_link", 80.0))])
    found = play.leaf("move_linear")
    assert found.code == "COLLISION", (found.code, found.reason)
    assert float(found.metrics["torque_nm"]) > float(found.metrics["threshold_nm"])
    assert found.metrics["joint"] in play.world.robots["arm1"].joints
    assert found.ended_s is not None
    assert play.speed_after(found.ended_s + 0.9) < STOPPED
