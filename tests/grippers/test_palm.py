"""The measured palm limits the depth between the fingers."""

from __future__ import annotations

import gc

import mujoco
import numpy as np
import pytest

from bt_dualarm.arm.payload import jaw_measures
from bt_dualarm.core.share import share_dir
from bt_dualarm.robots.gripper import Gripper, GripperFile, gripper_of
from bt_dualarm.sim.world import World
from tests.plays import Stage
from tests.sim.worlds import arm, file_of
from tests.skills.scenarios import Scenario, Tree


@pytest.mark.parametrize("gripper", ["panda_hand", "robotiq_2f85"])
def test_palm_is_where_rays_between_the_pads_hit_it(gripper: str) -> None:
    """The face of the Franka Hand was assumed 7 mm too far back."""
    world = World(file_of({"arm1": arm("ur5", gripper=gripper)}, {}))
    mujoco.mj_forward(world.model, world.data)
    tool = world.arms["arm1"].tool_pose
    jaw = jaw_measures(world.grippers["arm1"].gripper, 0.8)
    back = -tool.rotation_matrix[:, 2]
    palm = {
        geom
        for geom in world.arms["arm1"].tool_geom_ids
        if world.model.body(world.model.geom_bodyid[geom]).name == "arm1/gripper/palm"
    }
    distances = []
    for x in np.linspace(-0.5, 0.5, 5) * jaw.pad_width:
        for y in np.linspace(-0.4, 0.4, 9) * jaw.widest_opening:
            start = tool.apply(np.array((x, y, 0.0)))
            geom = np.zeros(1, np.int32)
            distance = mujoco.mj_ray(world.model, world.data, start, back, None, 1, -1, geom, None)
            if int(geom[0]) in palm:
                distances.append(distance)
    assert jaw.palm == pytest.approx(min(distances), abs=5e-4)


def test_grippers_of_earlier_runs_are_not_kept() -> None:
    """Those of a user's own file are read again in each run: a sweep has thousands."""
    path = share_dir("assets") / "grippers" / "panda_hand.yaml"
    for _ in range(200):
        jaw_measures(gripper_of(GripperFile(path)), 0.8)
    kept = sum(isinstance(one, Gripper) for one in gc.get_objects())
    assert kept < 100


def test_tall_thin_object_is_grasped_below_the_palm(stage: Stage) -> None:
    """The palm had pressed on its top with 49 N, and the fingers slipped in three of four runs."""
    pen: Tree = {
        "pen": {
            "shape": "cylinder",
            "size": [0.012, 0.14],
            "mass": 0.05,
            "color": "blue",
            "pose": {"xyz": [0.45, -0.15, 0.07]},
        }
    }
    scenario = Scenario(pen, arm={"robot": "panda", "gripper": "panda_hand"}, scene="empty")
    file = scenario.file({"grasp": {"object": "pen"}})
    file["world"]["reality"] = "lab"
    leaf = stage.run(file, seed=0).leaf("grasp")
    assert leaf.status == "SUCCESS", leaf
    assert float(leaf.metrics["approach_force_n"]) < 10.0
