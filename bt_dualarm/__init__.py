"""bt_dualarm: behaviour trees in YAML that make several robot arms do a task together.

A tree file declares a world, the arms in it and one tree per arm; a skill is what a leaf does::

    from bt_dualarm import Failure, PortModel, Skill, port

    class WaveOnce(Skill):
        class Ports(PortModel):
            angle: float = port(20.0, "How far to wave", unit="deg", gt=0, le=90)

        def run(self):
            ...  # each `yield` is a tick; return is success; raise Failure is failure
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bt_dualarm.arm import Arm as Arm
    from bt_dualarm.errors import DualArmError as DualArmError
    from bt_dualarm.errors import Failure as Failure
    from bt_dualarm.motion.follow_path import PathFollowing as PathFollowing
    from bt_dualarm.motion.paths import CartesianPath as CartesianPath
    from bt_dualarm.pose import Pose as Pose
    from bt_dualarm.skill import Skill as Skill
    from bt_dualarm.spec.color import Color as Color
    from bt_dualarm.spec.plane import Plane as Plane
    from bt_dualarm.spec.ports import PortModel as PortModel
    from bt_dualarm.spec.ports import port as port
    from bt_dualarm.spec.values import Duration as Duration
    from bt_dualarm.world.world import World as World
