"""bt_dualarm: behaviour trees in YAML that make several robot arms do a task together.

A tree file declares a world, the arms in it and one tree per arm. It is run whole or in steps::

    import bt_dualarm as bt

    result = bt.run("pick_and_track", seed=3)
    print(result.outcome, result.arms["arm2"].leaves["sequence/track"].metrics)

    with bt.open("pick_and_track") as run:  # nothing has moved yet
        while not run.done:
            run.step(0.02)  # simulated seconds
            print(run.time, run.world.object_pose("cube"), run.arms["arm1"].tool_pose)

A skill is what a leaf does::

    from bt_dualarm import Failure, PortModel, Skill, Ticks, port

    class WaitForRest(Skill):
        \"\"\"Wait until the arm stands still.\"\"\"

        class Ports(PortModel):
            longest: float = port(5.0, "how long to wait at most", unit="s", gt=0, le=60)

        failures = {"STILL_MOVING": "the arm did not come to rest in time"}
        example = "wait_for_rest: {longest: 2.0}"
        ports: Ports

        def run(self) -> Ticks:
            began = self.time
            while not self.arm.controller.at_rest:
                yield  # one tick
                if self.time - began > self.ports.longest:
                    raise Failure("STILL_MOVING", "the arm still moves")
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from bt_dualarm.arm.arm import Arm as Arm
    from bt_dualarm.arm.gripper import ArmGripper as ArmGripper
    from bt_dualarm.errors import DualArmError as DualArmError
    from bt_dualarm.errors import Failure as Failure
    from bt_dualarm.errors import WorldError as WorldError
    from bt_dualarm.motion.grasping.ranking import RankedGrasp as RankedGrasp
    from bt_dualarm.motion.paths.blending import blended as _blended
    from bt_dualarm.motion.paths.cartesian_path import line as _line
    from bt_dualarm.motion.paths.curves import circle as _circle
    from bt_dualarm.motion.paths.curves import lissajous as _lissajous
    from bt_dualarm.motion.paths.rotation import turned_about as _turned_about
    from bt_dualarm.motion.paths.spline import drawn as _drawn
    from bt_dualarm.motion.planning.planners import Planner as Planner
    from bt_dualarm.motion.timing.trajectory import Trajectory as Trajectory
    from bt_dualarm.pose import Matrix as Matrix
    from bt_dualarm.pose import Pose as Pose
    from bt_dualarm.pose import Vector as Vector
    from bt_dualarm.runtime.api import check as check
    from bt_dualarm.runtime.api import open as open  # noqa: A004 - read as bt.open
    from bt_dualarm.runtime.api import run as run
    from bt_dualarm.runtime.outcome import Ending as Ending
    from bt_dualarm.runtime.outcome import Outcome as Outcome
    from bt_dualarm.runtime.result import ArmResult as ArmResult
    from bt_dualarm.runtime.result import LeafResult as LeafResult
    from bt_dualarm.runtime.result import RunResult as RunResult
    from bt_dualarm.runtime.run import Run as Run
    from bt_dualarm.runtime.series import Series as Series
    from bt_dualarm.skill.arrival import check_arrival as check_arrival
    from bt_dualarm.skill.directions import unit_vector as unit_vector
    from bt_dualarm.skill.following_error import FollowingError as FollowingError
    from bt_dualarm.skill.grasp_search import WantedGrasp as WantedGrasp
    from bt_dualarm.skill.grasp_search import grasps_on as grasps_on
    from bt_dualarm.skill.grip import Grip as Grip
    from bt_dualarm.skill.guarded_descent import guarded_descent as guarded_descent
    from bt_dualarm.skill.held_through import held_through as held_through
    from bt_dualarm.skill.left_standing import LeftStanding as LeftStanding
    from bt_dualarm.skill.left_standing import stands_without as stands_without
    from bt_dualarm.skill.looking_around import SIDES as SIDES
    from bt_dualarm.skill.looking_around import camera_now as camera_now
    from bt_dualarm.skill.looking_around import gazes as gazes
    from bt_dualarm.skill.looking_around import go_to_camera as go_to_camera
    from bt_dualarm.skill.looking_around import look_at as look_at
    from bt_dualarm.skill.mark_views import MarkViews as MarkViews
    from bt_dualarm.skill.path_following import follow_curve as follow_curve
    from bt_dualarm.skill.path_skill import PathSkill as PathSkill
    from bt_dualarm.skill.scoring import TrackingScore as TrackingScore
    from bt_dualarm.skill.setting_down import SettingDown as SettingDown
    from bt_dualarm.skill.setting_down import SettingDownPorts as SettingDownPorts
    from bt_dualarm.skill.sight_ports import SightPorts as SightPorts
    from bt_dualarm.skill.skill import Skill as Skill
    from bt_dualarm.skill.skill import SkillContext as SkillContext
    from bt_dualarm.skill.skill import Ticks as Ticks
    from bt_dualarm.skill.standing_size import other_size_standing as other_size_standing
    from bt_dualarm.skill.still_pictures import own_camera as own_camera
    from bt_dualarm.skill.still_pictures import still_picture as still_picture
    from bt_dualarm.skill.taking import Taking as Taking
    from bt_dualarm.skill.taking import refuse_too_frail as refuse_too_frail
    from bt_dualarm.skill.taking import thing_at as thing_at
    from bt_dualarm.skill.taking import twin_at as twin_at
    from bt_dualarm.skill.taking_ports import TakingPorts as TakingPorts
    from bt_dualarm.skill.touch_sense import TouchSense as TouchSense
    from bt_dualarm.skill.tracking_reference import TrackingGains as TrackingGains
    from bt_dualarm.skill.visual_servoing import PlaneTracking as PlaneTracking
    from bt_dualarm.spec.color import Color as Color
    from bt_dualarm.spec.goals import CarriedPose as CarriedPose
    from bt_dualarm.spec.goals import GripForce as GripForce
    from bt_dualarm.spec.goals import GripSpeed as GripSpeed
    from bt_dualarm.spec.goals import GripWidth as GripWidth
    from bt_dualarm.spec.goals import JointAngles as JointAngles
    from bt_dualarm.spec.goals import PostureName as PostureName
    from bt_dualarm.spec.goals import ToolPose as ToolPose
    from bt_dualarm.spec.offset import Offset as Offset
    from bt_dualarm.spec.plane import Plane as Plane
    from bt_dualarm.spec.ports import PortModel as PortModel
    from bt_dualarm.spec.ports import port as port
    from bt_dualarm.spec.problems import Problem as Problem
    from bt_dualarm.spec.problems import SpecError as SpecError
    from bt_dualarm.spec.values import Angle as Angle
    from bt_dualarm.spec.values import ArmName as ArmName
    from bt_dualarm.spec.values import Duration as Duration
    from bt_dualarm.spec.values import ObjectName as ObjectName
    from bt_dualarm.spec.values import PoseSpec as PoseSpec
    from bt_dualarm.spec.values import Speed as Speed
    from bt_dualarm.spec.values import Vector3 as Vector3
    from bt_dualarm.vision.hand_eye import MarkView as MarkView
    from bt_dualarm.vision.hand_eye import hand_eye as hand_eye
    from bt_dualarm.vision.known_shape import KnownShape as KnownShape
    from bt_dualarm.vision.sighted import SightedThing as SightedThing
    from bt_dualarm.vision.sighted import SightedThings as SightedThings
    from bt_dualarm.world.grippers.gripper import Gripper as Gripper
    from bt_dualarm.world.world import World as World

    blended_path = _blended
    line_path = _line
    circle_path = _circle
    lissajous_path = _lissajous
    turned_path = _turned_about
    drawn_path = _drawn

__version__: str
"""Version of the package that is installed."""

_CONTENTS: Final = {
    # The front door
    "run": "runtime.api:run",
    "open": "runtime.api:open",
    "check": "runtime.api:check",
    "Run": "runtime.run:Run",
    "RunResult": "runtime.result:RunResult",
    "ArmResult": "runtime.result:ArmResult",
    "LeafResult": "runtime.result:LeafResult",
    "Outcome": "runtime.outcome:Outcome",
    "Ending": "runtime.outcome:Ending",
    "Series": "runtime.series:Series",
    "Problem": "spec.problems:Problem",
    "SpecError": "spec.problems:SpecError",
    # What a skill is made of
    "Skill": "skill.skill:Skill",
    "SkillContext": "skill.skill:SkillContext",
    "Ticks": "skill.skill:Ticks",
    "PathSkill": "skill.path_skill:PathSkill",
    "PortModel": "spec.ports:PortModel",
    "port": "spec.ports:port",
    "Failure": "errors:Failure",
    "DualArmError": "errors:DualArmError",
    "WorldError": "errors:WorldError",
    # Types of ports
    "Angle": "spec.values:Angle",
    "ArmName": "spec.values:ArmName",
    "CarriedPose": "spec.goals:CarriedPose",
    "Color": "spec.color:Color",
    "Duration": "spec.values:Duration",
    "GripForce": "spec.goals:GripForce",
    "GripSpeed": "spec.goals:GripSpeed",
    "GripWidth": "spec.goals:GripWidth",
    "JointAngles": "spec.goals:JointAngles",
    "ObjectName": "spec.values:ObjectName",
    "Offset": "spec.offset:Offset",
    "Plane": "spec.plane:Plane",
    "Planner": "motion.planning.planners:Planner",
    "PoseSpec": "spec.values:PoseSpec",
    "PostureName": "spec.goals:PostureName",
    "Speed": "spec.values:Speed",
    "ToolPose": "spec.goals:ToolPose",
    "Vector3": "spec.values:Vector3",
    # What a skill works with
    "Arm": "arm.arm:Arm",
    "ArmGripper": "arm.gripper:ArmGripper",
    "Gripper": "world.grippers.gripper:Gripper",
    "World": "world.world:World",
    "Pose": "pose:Pose",
    "Vector": "pose:Vector",
    "Matrix": "pose:Matrix",
    "Trajectory": "motion.timing.trajectory:Trajectory",
    "circle_path": "motion.paths.curves:circle",
    "line_path": "motion.paths.cartesian_path:line",
    "lissajous_path": "motion.paths.curves:lissajous",
    "blended_path": "motion.paths.blending:blended",
    "drawn_path": "motion.paths.spline:drawn",
    "turned_path": "motion.paths.rotation:turned_about",
    "follow_curve": "skill.path_following:follow_curve",
    "check_arrival": "skill.arrival:check_arrival",
    "FollowingError": "skill.following_error:FollowingError",
    "PlaneTracking": "skill.visual_servoing:PlaneTracking",
    "TrackingGains": "skill.tracking_reference:TrackingGains",
    "TrackingScore": "skill.scoring:TrackingScore",
    "WantedGrasp": "skill.grasp_search:WantedGrasp",
    "grasps_on": "skill.grasp_search:grasps_on",
    "RankedGrasp": "motion.grasping.ranking:RankedGrasp",
    "Grip": "skill.grip:Grip",
    "held_through": "skill.held_through:held_through",
    "LeftStanding": "skill.left_standing:LeftStanding",
    "stands_without": "skill.left_standing:stands_without",
    "guarded_descent": "skill.guarded_descent:guarded_descent",
    "SettingDown": "skill.setting_down:SettingDown",
    "SettingDownPorts": "skill.setting_down:SettingDownPorts",
    "Taking": "skill.taking:Taking",
    "TakingPorts": "skill.taking_ports:TakingPorts",
    "refuse_too_frail": "skill.taking:refuse_too_frail",
    "thing_at": "skill.taking:thing_at",
    "twin_at": "skill.taking:twin_at",
    "TouchSense": "skill.touch_sense:TouchSense",
    "MarkView": "vision.hand_eye:MarkView",
    "MarkViews": "skill.mark_views:MarkViews",
    "hand_eye": "vision.hand_eye:hand_eye",
    "unit_vector": "skill.directions:unit_vector",
    "SIDES": "skill.looking_around:SIDES",
    "go_to_camera": "skill.looking_around:go_to_camera",
    "look_at": "skill.looking_around:look_at",
    "camera_now": "skill.looking_around:camera_now",
    "gazes": "skill.looking_around:gazes",
    "SightPorts": "skill.sight_ports:SightPorts",
    "other_size_standing": "skill.standing_size:other_size_standing",
    "own_camera": "skill.still_pictures:own_camera",
    "still_picture": "skill.still_pictures:still_picture",
    "KnownShape": "vision.known_shape:KnownShape",
    "SightedThing": "vision.sighted:SightedThing",
    "SightedThings": "vision.sighted:SightedThings",
}

__all__ = ["__version__", *_CONTENTS]


if not TYPE_CHECKING:  # a checker of types is to complain of names that are not there

    def __getattr__(name):
        """Import what is asked for, when it is asked for: ``import bt_dualarm`` costs nothing."""
        if name == "__version__":
            return importlib.import_module("importlib.metadata").version(__name__)
        if name not in _CONTENTS:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        module, _, attribute = _CONTENTS[name].partition(":")
        return getattr(importlib.import_module(f"{__name__}.{module}"), attribute)


def __dir__() -> list[str]:
    """What there is, whether it has been asked for yet or not."""
    return list(__all__)
