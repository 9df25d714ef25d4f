"""A grasp: where the tool is on the object, and what it takes to hold it there."""

from __future__ import annotations

from dataclasses import dataclass

from bt_dualarm.pose import Pose


@dataclass(frozen=True, eq=False)
class Grasp:
    """A way to take an object.

    Attributes:
        tool: Pose of the tool frame in the object's frame.
        width: Distance of the pads in m when they touch; 0 of suction.
        force: Least force in N, of each pad or of the suction, that bears the load.
        margin: Largest force of the gripper over that force: how many times the load it bears.
    """

    tool: Pose
    width: float
    force: float
    margin: float
