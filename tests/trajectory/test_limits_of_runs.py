"""All set-points of whole runs respect the limits of position, velocity, acceleration, jerk."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.set_points import SetPoint
from bt_dualarm.trajectory.trajectory import Trajectory, use_of_limits
from tests.plays import Stage

TWO_ARMS = """
name: test
world: {scene: empty}
arms:
  arm1: {robot: ur5, base: {xyz: [0, 0, 0.4]}, tree: {TREE1}}
  arm2: {robot: panda, base: {xyz: [1.1, 0, 0.4], rpy: [0, 0, 180]}, tree: {TREE2}}
"""
REACH = "{reach_to_pose: {to: {xyz: [0.55, Y, 0.8]}, speed: 1.0, give_way: true, patience: 10}}"
RUNS = {
    "in each other's way": (
        f"sequence: [{REACH.replace('Y', '0.2')}, {REACH.replace('Y', '-0.2')}]",
        f"sequence: [{REACH.replace('Y', '-0.2')}, {REACH.replace('Y', '0.2')}]",
    ),
    "halted half-way": (
        "repeat: {times: 3, child: {force_success: {child: {timeout: {seconds: 0.7, child: "
        "{sequence: [{reach_to_pose: {posture: up, speed: 1.0}}, {go_home: {}}]}}}}}}",
        "repeat: {times: 4, child: {force_success: {child: {timeout: {seconds: 0.5, child: "
        "{move_joints: {by: {panda_joint1: 40}, speed: 1.0}}}}}}}",
    ),
    "along paths": (
        "circle: {plane: yz, radius: 0.08, waypoints: 20, speed: 1.0}",
        "move_linear: {offset: {xyz: [0, 0, 0.1]}, speed: 1.0}",
    ),
}


@pytest.mark.parametrize("run", RUNS)
def test_every_set_point_respects_the_limits(stage: Stage, run: str) -> None:
    first, second = RUNS[run]
    play = stage.play(
        TWO_ARMS.replace("{TREE1}", f"{{{first}}}").replace("{TREE2}", f"{{{second}}}")
    )
    sent: dict[str, list[SetPoint]] = {"arm1": [], "arm2": []}

    def record(_: World) -> None:
        for station in play.opened.assembly.arms.present:
            controller: Any = station._controller
            sent[station.name].append(controller.setpoint)

    play.watchers.append(record)
    play.run()
    for name, points in sent.items():
        arm = play.arm(name)
        assert arm.clipped_setpoints == 0
        points = points[:: round(0.004 / play.world.timestep)]
        q, v, a = (np.array([getattr(p, key) for p in points]) for key in ("q", "v", "a"))
        use = use_of_limits(Trajectory(0.004, q, v, a), play.world.robots[name].limits)
        assert use.velocity > 0.05
        assert max(use.velocity, use.acceleration, use.jerk) <= 1 + 1e-6
        assert use.position_margin >= 0.0
