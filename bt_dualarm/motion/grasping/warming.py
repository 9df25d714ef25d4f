"""The kernels of this room, called once with what they are given later."""

from __future__ import annotations

import numpy as np

from bt_dualarm.motion.grasping.gripper_measures import CupMeasures, JawMeasures, Load
from bt_dualarm.motion.grasping.jaw_grasps import jaw_grasps
from bt_dualarm.motion.grasping.ranking import Obstacle, ranked
from bt_dualarm.motion.grasping.solids import Box
from bt_dualarm.motion.grasping.suction import cup_grasps
from bt_dualarm.pose import Pose


def grasp_something() -> None:
    """Have candidates of fingers and of a cup, and the room around them, worked out once."""
    box, under = Box(np.full(3, 0.02)), Obstacle(Box(np.full(3, 0.1)), Pose.from_rpy((0, 0, -0.13)))
    load = Load(0.1, np.array((0.0, 0.0, -9.81)), 8.0, np.zeros(3))
    jaw = JawMeasures(0.0, 0.085, 0.03, 0.022, 0.056, 0.015, 0.016, 20.0, 235.0, 0.8)
    ranked(jaw_grasps(box, jaw, load, 0.8), Pose.identity(), jaw, [under], lambda _: 0.0)
    cup_grasps(box, CupMeasures(0.01, 1e-3, 60.0, 0.5), load)
