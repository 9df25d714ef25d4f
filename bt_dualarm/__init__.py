"""bt_dualarm: behavior trees in YAML for several robot arms in one simulated world.

A tree file declares a world, the arms in it and one tree per arm. Run it at once or in steps::

    import bt_dualarm as bt

    result = bt.run("pick_and_track", seed=3)
    print(result.outcome, result.arms["arm2"].leaves["sequence/track"].metrics)

    with bt.open("pick_and_track") as run:  # nothing has moved yet
        while not run.done:
            run.step(0.02)  # simulated seconds
            print(run.time, run.world.object_pose("cube"), run.arms["arm1"].tool_pose)

Skills are the leaves of trees::

    from bt_dualarm import Failure, PortModel, Skill, Ticks, port

    class WaitForRest(Skill):
        \"\"\"Wait until the arm is at rest.\"\"\"

        class Ports(PortModel):
            longest: float = port(5.0, "longest wait", unit="s", gt=0, le=60)

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
    from bt_dualarm.arm.branches import beginning_at as beginning_at
    from bt_dualarm.arm.branches import first_possible as first_possible
    from bt_dualarm.arm.gripper import ArmGripper as ArmGripper
    from bt_dualarm.arm.known_objects import Released as Released
    from bt_dualarm.arm.passengers import PassengerCheck as PassengerCheck
    from bt_dualarm.arm.passengers import passengers_to as passengers_to
    from bt_dualarm.collision.distance import HANDS_APART_M as HANDS_APART_M
    from bt_dualarm.control.tool_following import ToolFollowing as ToolFollowing
    from bt_dualarm.core.errors import DualArmError as DualArmError
    from bt_dualarm.core.errors import Failure as Failure
    from bt_dualarm.core.errors import WorldError as WorldError
    from bt_dualarm.core.errors import nearest_to_success as nearest_to_success
    from bt_dualarm.core.free_axes import nearest_allowed as nearest_allowed
    from bt_dualarm.core.pose import Matrix as Matrix
    from bt_dualarm.core.pose import Pose as Pose
    from bt_dualarm.core.pose import Vector as Vector
    from bt_dualarm.grasping.candidates import RankedGrasp as RankedGrasp
    from bt_dualarm.learning.api import gym as gym
    from bt_dualarm.perception.known_shape import KnownShape as KnownShape
    from bt_dualarm.perception.scan import MarkView as MarkView
    from bt_dualarm.perception.scan import SightedObject as SightedObject
    from bt_dualarm.perception.scan import SightedObjects as SightedObjects
    from bt_dualarm.perception.scan import hand_eye as hand_eye
    from bt_dualarm.planning.path_search import Planner as Planner
    from bt_dualarm.replay.data import ArmTrack as ArmTrack
    from bt_dualarm.replay.data import GripperTrack as GripperTrack
    from bt_dualarm.replay.data import ObjectTrack as ObjectTrack
    from bt_dualarm.replay.data import RunData as RunData
    from bt_dualarm.replay.data import load as load
    from bt_dualarm.replay.timeline import RecordedFrame as RecordedFrame
    from bt_dualarm.robots.gripper import Gripper as Gripper
    from bt_dualarm.runtime.api import check as check
    from bt_dualarm.runtime.api import open as open  # noqa: A004 - read as bt.open
    from bt_dualarm.runtime.api import run as run
    from bt_dualarm.runtime.interruption import StopRequest as StopRequest
    from bt_dualarm.runtime.outcome import ArmResult as ArmResult
    from bt_dualarm.runtime.outcome import Ending as Ending
    from bt_dualarm.runtime.outcome import LeafResult as LeafResult
    from bt_dualarm.runtime.outcome import Outcome as Outcome
    from bt_dualarm.runtime.outcome import RunResult as RunResult
    from bt_dualarm.runtime.outcome import Series as Series
    from bt_dualarm.runtime.run import Run as Run
    from bt_dualarm.sim.frame import Frame as Frame
    from bt_dualarm.sim.world import World as World
    from bt_dualarm.skill.articulated import HandForce as HandForce
    from bt_dualarm.skill.articulated import JointPath as JointPath
    from bt_dualarm.skill.articulated import MovedPart as MovedPart
    from bt_dualarm.skill.carry_planning import CarryPorts as CarryPorts
    from bt_dualarm.skill.carrying import Carrying as Carrying
    from bt_dualarm.skill.cell import CellWait as CellWait
    from bt_dualarm.skill.condition import Condition as Condition
    from bt_dualarm.skill.following_error import FollowingError as FollowingError
    from bt_dualarm.skill.grasp_approach import UnsuitedGoalFailure as UnsuitedGoalFailure
    from bt_dualarm.skill.grasp_search import GRAVITY as GRAVITY
    from bt_dualarm.skill.grasp_search import TakingPorts as TakingPorts
    from bt_dualarm.skill.grasp_search import WantedGrasp as WantedGrasp
    from bt_dualarm.skill.grasp_search import grasps_on as grasps_on
    from bt_dualarm.skill.grasp_search import half_open as half_open
    from bt_dualarm.skill.grip import Grip as Grip
    from bt_dualarm.skill.grip import TouchSense as TouchSense
    from bt_dualarm.skill.grip import held_through as held_through
    from bt_dualarm.skill.grip import make_room as make_room
    from bt_dualarm.skill.guarded_move import guarded_descent as guarded_descent
    from bt_dualarm.skill.handover import HandoverPlan as HandoverPlan
    from bt_dualarm.skill.handover import HandoverSearch as HandoverSearch
    from bt_dualarm.skill.handover import HandoverWish as HandoverWish
    from bt_dualarm.skill.handover import LoadSense as LoadSense
    from bt_dualarm.skill.handover import handover_label as handover_label
    from bt_dualarm.skill.handover import let_go_of as let_go_of
    from bt_dualarm.skill.handover import let_leave as let_leave
    from bt_dualarm.skill.handover import object_in_hand as object_in_hand
    from bt_dualarm.skill.handover import object_in_tool as object_in_tool
    from bt_dualarm.skill.handover import retreat_from as retreat_from
    from bt_dualarm.skill.handover import tool_pose_of as tool_pose_of
    from bt_dualarm.skill.inserting import HoleAxes as HoleAxes
    from bt_dualarm.skill.inserting import Inserting as Inserting
    from bt_dualarm.skill.inserting import InsertingPorts as InsertingPorts
    from bt_dualarm.skill.joint import JointPart as JointPart
    from bt_dualarm.skill.joint import into_held as into_held
    from bt_dualarm.skill.joint import shared_grasp as shared_grasp
    from bt_dualarm.skill.keeping import KeptPath as KeptPath
    from bt_dualarm.skill.left_standing import LeftStanding as LeftStanding
    from bt_dualarm.skill.left_standing import is_tied_to as is_tied_to
    from bt_dualarm.skill.left_standing import stands_without as stands_without
    from bt_dualarm.skill.looking import SIDES as SIDES
    from bt_dualarm.skill.looking import Coverage as Coverage
    from bt_dualarm.skill.looking import MarkViews as MarkViews
    from bt_dualarm.skill.looking import SightPorts as SightPorts
    from bt_dualarm.skill.looking import arms_in_view as arms_in_view
    from bt_dualarm.skill.looking import camera_now as camera_now
    from bt_dualarm.skill.looking import gazes as gazes
    from bt_dualarm.skill.looking import go_to_camera as go_to_camera
    from bt_dualarm.skill.looking import hidden_by_arms as hidden_by_arms
    from bt_dualarm.skill.looking import hidden_point as hidden_point
    from bt_dualarm.skill.looking import least_hidden as least_hidden
    from bt_dualarm.skill.looking import look_at as look_at
    from bt_dualarm.skill.looking import own_camera as own_camera
    from bt_dualarm.skill.looking import standing_of as standing_of
    from bt_dualarm.skill.looking import still_picture as still_picture
    from bt_dualarm.skill.path_following import PathSkill as PathSkill
    from bt_dualarm.skill.path_following import check_arrival as check_arrival
    from bt_dualarm.skill.path_following import follow_curve as follow_curve
    from bt_dualarm.skill.picking import MovedAwayFailure as MovedAwayFailure
    from bt_dualarm.skill.picking import Taking as Taking
    from bt_dualarm.skill.picking import object_at as object_at
    from bt_dualarm.skill.picking import refuse_too_frail as refuse_too_frail
    from bt_dualarm.skill.picking import twin_at as twin_at
    from bt_dualarm.skill.placing import SettingDown as SettingDown
    from bt_dualarm.skill.placing import SettingDownPorts as SettingDownPorts
    from bt_dualarm.skill.placing import other_headings as other_headings
    from bt_dualarm.skill.scoring import TrackingScore as TrackingScore
    from bt_dualarm.skill.skill import Skill as Skill
    from bt_dualarm.skill.skill import SkillContext as SkillContext
    from bt_dualarm.skill.skill import Ticks as Ticks
    from bt_dualarm.skill.skill import unit_vector as unit_vector
    from bt_dualarm.skill.symmetry import goals_alike as goals_alike
    from bt_dualarm.skill.symmetry import poses_alike as poses_alike
    from bt_dualarm.skill.symmetry import true_error as true_error
    from bt_dualarm.skill.tracking import PlaneTracking as PlaneTracking
    from bt_dualarm.skill.tracking import TrackingGains as TrackingGains
    from bt_dualarm.skill.tracking_end import EndConditions as EndConditions
    from bt_dualarm.skill.tracking_end import TrackingEnd as TrackingEnd
    from bt_dualarm.skill.tracking_end import refuse_lost as refuse_lost
    from bt_dualarm.skill.viewpoints import Viewpoints as Viewpoints
    from bt_dualarm.spec.node_types import Counterpart as Counterpart
    from bt_dualarm.spec.node_types import PortModel as PortModel
    from bt_dualarm.spec.node_types import port as port
    from bt_dualarm.spec.path_file import PathFile as PathFile
    from bt_dualarm.spec.path_file import points_in as points_in
    from bt_dualarm.spec.path_keep import Keep as Keep
    from bt_dualarm.spec.problems import Problem as Problem
    from bt_dualarm.spec.problems import SpecError as SpecError
    from bt_dualarm.spec.relative_pose import CarriedPose as CarriedPose
    from bt_dualarm.spec.relative_pose import ObjectPose as ObjectPose
    from bt_dualarm.spec.relative_pose import PointPose as PointPose
    from bt_dualarm.spec.relative_pose import ToolPose as ToolPose
    from bt_dualarm.spec.values import Angle as Angle
    from bt_dualarm.spec.values import ArmName as ArmName
    from bt_dualarm.spec.values import Color as Color
    from bt_dualarm.spec.values import Direction as Direction
    from bt_dualarm.spec.values import Duration as Duration
    from bt_dualarm.spec.values import FreeAxes as FreeAxes
    from bt_dualarm.spec.values import GripForce as GripForce
    from bt_dualarm.spec.values import GripSpeed as GripSpeed
    from bt_dualarm.spec.values import GripWidth as GripWidth
    from bt_dualarm.spec.values import JointAngles as JointAngles
    from bt_dualarm.spec.values import JointName as JointName
    from bt_dualarm.spec.values import JointOffsets as JointOffsets
    from bt_dualarm.spec.values import JointPosition as JointPosition
    from bt_dualarm.spec.values import ObjectName as ObjectName
    from bt_dualarm.spec.values import Offset as Offset
    from bt_dualarm.spec.values import OtherArmName as OtherArmName
    from bt_dualarm.spec.values import OtherObjectName as OtherObjectName
    from bt_dualarm.spec.values import PartName as PartName
    from bt_dualarm.spec.values import PickedObjectName as PickedObjectName
    from bt_dualarm.spec.values import Plane as Plane
    from bt_dualarm.spec.values import PlaneOrFree as PlaneOrFree
    from bt_dualarm.spec.values import PoseSpec as PoseSpec
    from bt_dualarm.spec.values import PostureName as PostureName
    from bt_dualarm.spec.values import Speed as Speed
    from bt_dualarm.spec.values import Vector3 as Vector3
    from bt_dualarm.sweeps.api import compare as compare
    from bt_dualarm.sweeps.api import sweep as sweep
    from bt_dualarm.sweeps.sweep import SweepResult as SweepResult
    from bt_dualarm.trajectory.paths import blended as _blended
    from bt_dualarm.trajectory.paths import circle as _circle
    from bt_dualarm.trajectory.paths import drawn as _drawn
    from bt_dualarm.trajectory.paths import line as _line
    from bt_dualarm.trajectory.paths import lissajous as _lissajous
    from bt_dualarm.trajectory.paths import turned_about as _turned_about
    from bt_dualarm.trajectory.set_points import SetPoint as SetPoint
    from bt_dualarm.trajectory.trajectory import Trajectory as Trajectory

    blended_path = _blended
    line_path = _line
    circle_path = _circle
    lissajous_path = _lissajous
    turned_path = _turned_about
    drawn_path = _drawn

__version__: str
"""Version of the installed package."""

_CONTENTS: Final = {
    # Running and checking trees
    "run": "runtime.api:run",
    "open": "runtime.api:open",
    "check": "runtime.api:check",
    "Run": "runtime.run:Run",
    "RunResult": "runtime.outcome:RunResult",
    "ArmResult": "runtime.outcome:ArmResult",
    "LeafResult": "runtime.outcome:LeafResult",
    "Outcome": "runtime.outcome:Outcome",
    "Ending": "runtime.outcome:Ending",
    "Series": "runtime.outcome:Series",
    "Problem": "spec.problems:Problem",
    "SpecError": "spec.problems:SpecError",
    # Learning
    "gym": "learning.api:gym",
    # Reading a record
    "load": "replay.data:load",
    "RunData": "replay.data:RunData",
    "ArmTrack": "replay.data:ArmTrack",
    "GripperTrack": "replay.data:GripperTrack",
    "ObjectTrack": "replay.data:ObjectTrack",
    "RecordedFrame": "replay.timeline:RecordedFrame",
    # Many runs
    "sweep": "sweeps.api:sweep",
    "compare": "sweeps.api:compare",
    "SweepResult": "sweeps.sweep:SweepResult",
    "StopRequest": "runtime.interruption:StopRequest",
    # Parts of a skill
    "Skill": "skill.skill:Skill",
    "SkillContext": "skill.skill:SkillContext",
    "Ticks": "skill.skill:Ticks",
    "PassengerCheck": "arm.passengers:PassengerCheck",
    "passengers_to": "arm.passengers:passengers_to",
    "PathSkill": "skill.path_following:PathSkill",
    "Condition": "skill.condition:Condition",
    "PortModel": "spec.node_types:PortModel",
    "port": "spec.node_types:port",
    "Failure": "core.errors:Failure",
    "DualArmError": "core.errors:DualArmError",
    "WorldError": "core.errors:WorldError",
    # Types of ports
    "Angle": "spec.values:Angle",
    "ArmName": "spec.values:ArmName",
    "CarriedPose": "spec.relative_pose:CarriedPose",
    "Color": "spec.values:Color",
    "Direction": "spec.values:Direction",
    "Duration": "spec.values:Duration",
    "FreeAxes": "spec.values:FreeAxes",
    "GripForce": "spec.values:GripForce",
    "GripSpeed": "spec.values:GripSpeed",
    "GripWidth": "spec.values:GripWidth",
    "JointAngles": "spec.values:JointAngles",
    "JointName": "spec.values:JointName",
    "JointOffsets": "spec.values:JointOffsets",
    "JointPosition": "spec.values:JointPosition",
    "Keep": "spec.path_keep:Keep",
    "OtherObjectName": "spec.values:OtherObjectName",
    "ObjectName": "spec.values:ObjectName",
    "PickedObjectName": "spec.values:PickedObjectName",
    "ObjectPose": "spec.relative_pose:ObjectPose",
    "Offset": "spec.values:Offset",
    "OtherArmName": "spec.values:OtherArmName",
    "PartName": "spec.values:PartName",
    "Plane": "spec.values:Plane",
    "PlaneOrFree": "spec.values:PlaneOrFree",
    "PathFile": "spec.path_file:PathFile",
    "Planner": "planning.path_search:Planner",
    "PointPose": "spec.relative_pose:PointPose",
    "PoseSpec": "spec.values:PoseSpec",
    "PostureName": "spec.values:PostureName",
    "Speed": "spec.values:Speed",
    "ToolPose": "spec.relative_pose:ToolPose",
    "Vector3": "spec.values:Vector3",
    # Objects that a skill uses
    "Arm": "arm.arm:Arm",
    "ArmGripper": "arm.gripper:ArmGripper",
    "Gripper": "robots.gripper:Gripper",
    "Frame": "sim.frame:Frame",
    "World": "sim.world:World",
    "Pose": "core.pose:Pose",
    "Vector": "core.pose:Vector",
    "Matrix": "core.pose:Matrix",
    "Trajectory": "trajectory.trajectory:Trajectory",
    "SetPoint": "trajectory.set_points:SetPoint",
    "circle_path": "trajectory.paths:circle",
    "line_path": "trajectory.paths:line",
    "nearest_allowed": "core.free_axes:nearest_allowed",
    "nearest_to_success": "core.errors:nearest_to_success",
    "lissajous_path": "trajectory.paths:lissajous",
    "blended_path": "trajectory.paths:blended",
    "drawn_path": "trajectory.paths:drawn",
    "turned_path": "trajectory.paths:turned_about",
    "beginning_at": "arm.branches:beginning_at",
    "first_possible": "arm.branches:first_possible",
    "follow_curve": "skill.path_following:follow_curve",
    "points_in": "spec.path_file:points_in",
    "check_arrival": "skill.path_following:check_arrival",
    "FollowingError": "skill.following_error:FollowingError",
    "PlaneTracking": "skill.tracking:PlaneTracking",
    "TrackingGains": "skill.tracking:TrackingGains",
    "EndConditions": "skill.tracking_end:EndConditions",
    "TrackingEnd": "skill.tracking_end:TrackingEnd",
    "refuse_lost": "skill.tracking_end:refuse_lost",
    "TrackingScore": "skill.scoring:TrackingScore",
    "HANDS_APART_M": "collision.distance:HANDS_APART_M",
    "into_held": "skill.joint:into_held",
    "shared_grasp": "skill.joint:shared_grasp",
    "CellWait": "skill.cell:CellWait",
    "ToolFollowing": "control.tool_following:ToolFollowing",
    "WantedGrasp": "skill.grasp_search:WantedGrasp",
    "grasps_on": "skill.grasp_search:grasps_on",
    "half_open": "skill.grasp_search:half_open",
    "UnsuitedGoalFailure": "skill.grasp_approach:UnsuitedGoalFailure",
    "goals_alike": "skill.symmetry:goals_alike",
    "poses_alike": "skill.symmetry:poses_alike",
    "true_error": "skill.symmetry:true_error",
    "RankedGrasp": "grasping.candidates:RankedGrasp",
    "Grip": "skill.grip:Grip",
    "held_through": "skill.grip:held_through",
    "make_room": "skill.grip:make_room",
    "KeptPath": "skill.keeping:KeptPath",
    "LeftStanding": "skill.left_standing:LeftStanding",
    "is_tied_to": "skill.left_standing:is_tied_to",
    "stands_without": "skill.left_standing:stands_without",
    "guarded_descent": "skill.guarded_move:guarded_descent",
    "HoleAxes": "skill.inserting:HoleAxes",
    "Inserting": "skill.inserting:Inserting",
    "InsertingPorts": "skill.inserting:InsertingPorts",
    "SettingDown": "skill.placing:SettingDown",
    "SettingDownPorts": "skill.placing:SettingDownPorts",
    "other_headings": "skill.placing:other_headings",
    "Taking": "skill.picking:Taking",
    "TakingPorts": "skill.grasp_search:TakingPorts",
    "MovedAwayFailure": "skill.picking:MovedAwayFailure",
    "MovedPart": "skill.articulated:MovedPart",
    "HandForce": "skill.articulated:HandForce",
    "JointPath": "skill.articulated:JointPath",
    "Carrying": "skill.carrying:Carrying",
    "CarryPorts": "skill.carry_planning:CarryPorts",
    "JointPart": "skill.joint:JointPart",
    "refuse_too_frail": "skill.picking:refuse_too_frail",
    "object_at": "skill.picking:object_at",
    "twin_at": "skill.picking:twin_at",
    "TouchSense": "skill.grip:TouchSense",
    "MarkView": "perception.scan:MarkView",
    "MarkViews": "skill.looking:MarkViews",
    "hand_eye": "perception.scan:hand_eye",
    # Joint actions of several arms
    "Counterpart": "spec.node_types:Counterpart",
    "GRAVITY": "skill.grasp_search:GRAVITY",
    "HandoverSearch": "skill.handover:HandoverSearch",
    "HandoverPlan": "skill.handover:HandoverPlan",
    "HandoverWish": "skill.handover:HandoverWish",
    "LoadSense": "skill.handover:LoadSense",
    "handover_label": "skill.handover:handover_label",
    "let_go_of": "skill.handover:let_go_of",
    "let_leave": "skill.handover:let_leave",
    "object_in_hand": "skill.handover:object_in_hand",
    "object_in_tool": "skill.handover:object_in_tool",
    "retreat_from": "skill.handover:retreat_from",
    "tool_pose_of": "skill.handover:tool_pose_of",
    # Steps of several skills
    "unit_vector": "skill.skill:unit_vector",
    "SIDES": "skill.looking:SIDES",
    "Coverage": "skill.looking:Coverage",
    "Viewpoints": "skill.viewpoints:Viewpoints",
    "go_to_camera": "skill.looking:go_to_camera",
    "least_hidden": "skill.looking:least_hidden",
    "look_at": "skill.looking:look_at",
    "arms_in_view": "skill.looking:arms_in_view",
    "hidden_point": "skill.looking:hidden_point",
    "camera_now": "skill.looking:camera_now",
    "gazes": "skill.looking:gazes",
    "hidden_by_arms": "skill.looking:hidden_by_arms",
    "SightPorts": "skill.looking:SightPorts",
    "standing_of": "skill.looking:standing_of",
    "own_camera": "skill.looking:own_camera",
    "still_picture": "skill.looking:still_picture",
    "KnownShape": "perception.known_shape:KnownShape",
    "SightedObject": "perception.scan:SightedObject",
    "SightedObjects": "perception.scan:SightedObjects",
    "Released": "arm.known_objects:Released",
}

__all__ = ["__version__", *_CONTENTS]


if not TYPE_CHECKING:  # type checkers must report unknown names

    def __getattr__(name):
        """Import a public name on its first use, so that ``import bt_dualarm`` is fast."""
        if name == "__version__":
            return importlib.import_module("importlib.metadata").version(__name__)
        if name not in _CONTENTS:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        module, _, attribute = _CONTENTS[name].partition(":")
        return getattr(importlib.import_module(f"{__name__}.{module}"), attribute)


def __dir__() -> list[str]:
    """All public names, imported or not."""
    return list(__all__)
