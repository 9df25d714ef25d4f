"""bt_dualarm: behaviour trees in YAML that make several robot arms do a task together.

A tree file declares a world, the arms in it and one tree per arm; a skill is what a leaf does::

    from bt_dualarm import Failure, PortModel, Skill, port

    class WaitForRest(Skill):
        \"\"\"Wait until the arm stands still.\"\"\"

        class Ports(PortModel):
            longest: float = port(5.0, "how long to wait at most", unit="s", gt=0, le=60)

        failures = {"STILL_MOVING": "the arm did not come to rest in time"}
        example = "wait_for_rest: {longest: 2.0}"
        ports: Ports

        def run(self):
            began = self.time
            while not self.arm.controller.at_rest:
                yield  # one tick
                if self.time - began > self.ports.longest:
                    raise Failure("STILL_MOVING", "the arm still moves")
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from bt_dualarm.arm import Arm as Arm
    from bt_dualarm.arrival import check_arrival as check_arrival
    from bt_dualarm.curve import follow_curve as follow_curve
    from bt_dualarm.errors import DualArmError as DualArmError
    from bt_dualarm.errors import Failure as Failure
    from bt_dualarm.errors import WorldError as WorldError
    from bt_dualarm.motion.blending import blended as blended_path
    from bt_dualarm.motion.curves import circle as circle_path
    from bt_dualarm.motion.curves import lissajous as lissajous_path
    from bt_dualarm.motion.drawing import drawn as drawn_path
    from bt_dualarm.motion.paths import line as line_path
    from bt_dualarm.motion.planners import Planner as Planner
    from bt_dualarm.motion.trajectory import Trajectory as Trajectory
    from bt_dualarm.motion.turning import turned_about as turned_path
    from bt_dualarm.pose import Matrix as Matrix
    from bt_dualarm.pose import Pose as Pose
    from bt_dualarm.pose import Vector as Vector
    from bt_dualarm.scoring import TrackingScore as TrackingScore
    from bt_dualarm.skill import Skill as Skill
    from bt_dualarm.skill import SkillContext as SkillContext
    from bt_dualarm.spec.aims import CarriedPose as CarriedPose
    from bt_dualarm.spec.aims import JointAngles as JointAngles
    from bt_dualarm.spec.aims import PostureName as PostureName
    from bt_dualarm.spec.aims import ToolPose as ToolPose
    from bt_dualarm.spec.color import Color as Color
    from bt_dualarm.spec.offset import Offset as Offset
    from bt_dualarm.spec.plane import Plane as Plane
    from bt_dualarm.spec.ports import PortModel as PortModel
    from bt_dualarm.spec.ports import port as port
    from bt_dualarm.spec.values import Angle as Angle
    from bt_dualarm.spec.values import ArmName as ArmName
    from bt_dualarm.spec.values import Duration as Duration
    from bt_dualarm.spec.values import ObjectName as ObjectName
    from bt_dualarm.spec.values import PoseSpec as PoseSpec
    from bt_dualarm.spec.values import Speed as Speed
    from bt_dualarm.spec.values import Vector3 as Vector3
    from bt_dualarm.tracking import PlaneTracking as PlaneTracking
    from bt_dualarm.tracking import TrackingGains as TrackingGains
    from bt_dualarm.world.world import World as World

_CONTENTS: Final = {
    # What a skill is made of
    "Skill": "skill:Skill",
    "SkillContext": "skill:SkillContext",
    "PortModel": "spec.ports:PortModel",
    "port": "spec.ports:port",
    "Failure": "errors:Failure",
    "DualArmError": "errors:DualArmError",
    "WorldError": "errors:WorldError",
    # Types of ports
    "Angle": "spec.values:Angle",
    "ArmName": "spec.values:ArmName",
    "CarriedPose": "spec.aims:CarriedPose",
    "Color": "spec.color:Color",
    "Duration": "spec.values:Duration",
    "JointAngles": "spec.aims:JointAngles",
    "ObjectName": "spec.values:ObjectName",
    "Offset": "spec.offset:Offset",
    "Plane": "spec.plane:Plane",
    "Planner": "motion.planners:Planner",
    "PoseSpec": "spec.values:PoseSpec",
    "PostureName": "spec.aims:PostureName",
    "Speed": "spec.values:Speed",
    "ToolPose": "spec.aims:ToolPose",
    "Vector3": "spec.values:Vector3",
    # What a skill works with
    "Arm": "arm:Arm",
    "World": "world.world:World",
    "Pose": "pose:Pose",
    "Vector": "pose:Vector",
    "Matrix": "pose:Matrix",
    "Trajectory": "motion.trajectory:Trajectory",
    "circle_path": "motion.curves:circle",
    "line_path": "motion.paths:line",
    "lissajous_path": "motion.curves:lissajous",
    "blended_path": "motion.blending:blended",
    "drawn_path": "motion.drawing:drawn",
    "turned_path": "motion.turning:turned_about",
    "follow_curve": "curve:follow_curve",
    "check_arrival": "arrival:check_arrival",
    "PlaneTracking": "tracking:PlaneTracking",
    "TrackingGains": "tracking:TrackingGains",
    "TrackingScore": "scoring:TrackingScore",
}

__all__ = [
    "Angle",
    "Arm",
    "ArmName",
    "CarriedPose",
    "Color",
    "DualArmError",
    "Duration",
    "Failure",
    "JointAngles",
    "Matrix",
    "ObjectName",
    "Offset",
    "Plane",
    "PlaneTracking",
    "Planner",
    "PortModel",
    "Pose",
    "PoseSpec",
    "PostureName",
    "Skill",
    "SkillContext",
    "Speed",
    "ToolPose",
    "TrackingGains",
    "TrackingScore",
    "Trajectory",
    "Vector",
    "Vector3",
    "World",
    "WorldError",
    "blended_path",
    "check_arrival",
    "circle_path",
    "drawn_path",
    "follow_curve",
    "line_path",
    "lissajous_path",
    "port",
    "turned_path",
]


def __getattr__(name: str) -> Any:
    """Import what is asked for, when it is asked for: ``import bt_dualarm`` costs nothing."""
    if name not in _CONTENTS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, _, attribute = _CONTENTS[name].partition(":")
    return getattr(importlib.import_module(f"{__name__}.{module}"), attribute)
