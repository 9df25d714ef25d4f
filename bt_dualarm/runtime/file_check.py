"""The check of a tree file against its robots, grippers and scene, before anything moves."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Final, TypeVar

import numpy as np
from pydantic import ValidationError

from bt_dualarm.behaviors.language import LANGUAGE
from bt_dualarm.behaviors.load import load
from bt_dualarm.collision.distance import RESTING_MARGIN_M, ArmDistance
from bt_dualarm.core.errors import (
    CatalogError,
    Failure,
    LockedJointError,
    OverlapError,
    RoomError,
    SpringError,
    WorldError,
)
from bt_dualarm.core.free_axes import AXES, REMEDY, FreeAxes
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics, Workspace
from bt_dualarm.kinematics.solver import Chain
from bt_dualarm.perception.detection import ColorlessError, color_of
from bt_dualarm.robots.gripper import Gripper, Interval, gripper_names, load_gripper
from bt_dualarm.robots.meshes import MeshError, refuse_object_mesh
from bt_dualarm.robots.robot import Robot, degrees_within, is_description_path, problems_of
from bt_dualarm.robots.robot_description import (
    COMES_OFF,
    load_robot,
    robot_names,
    stock_joints,
    with_gripper,
)
from bt_dualarm.robots.urdf_xml import DescriptionError
from bt_dualarm.runtime.grasp_check import grasps, object_of_part, takes_over, unfit_grasps
from bt_dualarm.sim.composition import name_of_geom, names_in, scene_names, scene_spec
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.sim.penetration import MAX_DEPTH, SHALLOW_DEPTH
from bt_dualarm.sim.world import World
from bt_dualarm.skill.looking import SightPorts, geoms_ahead
from bt_dualarm.spec.document import ArmSpec, ObjectSpec, TreeFile
from bt_dualarm.spec.faults import FaultSpec, fault_problems, joint_problems, read_faults
from bt_dualarm.spec.goals import SECTIONS
from bt_dualarm.spec.joints import Articulation, moved_name
from bt_dualarm.spec.node_types import (
    LanguageNode,
    NodeSpec,
    NodeType,
    all_of,
    counted,
    is_dynamic,
    is_unknown,
    metadata_of,
    models_in,
    number_in,
    unit_of,
)
from bt_dualarm.spec.problems import Location, Problem, SpecError, errors, in_order, suggestion
from bt_dualarm.spec.relative_pose import RELATIONS, RelativePose, relative_pose
from bt_dualarm.spec.scene import is_scene_path
from bt_dualarm.spec.values import (
    JOINT_UNIT,
    Goal,
    MarkerSpec,
    OfGripper,
    OfJoints,
    OfPosture,
    PoseSpec,
    Refers,
    wrong_unit,
)
from bt_dualarm.spec.yaml_reader import Data, DataPath, Source, TreeInput, with_tuples

Described = TypeVar("Described", Robot, Gripper)

_UNITS = {"width": "m", "speed": "m/s", "force": "N"}


def gripper_problems(
    arm: str,
    spec: ArmSpec,
    gripper: Gripper | None,
    kinds: Mapping[str, NodeType],
    wrong: frozenset[Location] = frozenset(),
) -> Iterator[Problem]:
    """Yields problems of leaves that need a gripper that is missing, or exceed its limits.

    Args:
        arm: Name of the arm.
        spec: Specification of the arm in the file.
        gripper: Its gripper; None if it has none or its description could not be read.
        kinds: All node types, by name.
        wrong: Places of values that no gripper could have, and that are known to be wrong.
    """
    for node in spec.tree.walk():
        kind = kinds.get(node.kind)
        if kind is None:
            continue
        if kind.needs_gripper and spec.gripper is None:
            known = ", ".join(gripper_names())
            hint = f"give {arm} one: gripper: NAME ({known})"
            yield node.problem(f"{node.kind}: {arm} has no gripper", hint)
        elif gripper is not None:
            yield from (one for one in _beyond(node, kind, gripper) if one.place not in wrong)


def _beyond(node: NodeSpec, kind: NodeType, gripper: Gripper) -> Iterator[Problem]:
    """Yields problems of literal numbers beyond the limits in the gripper's description."""
    for port, declared in kind.ports.model_fields.items():
        quantity = metadata_of(declared, OfGripper)
        value = node.ports.get(port)
        if quantity is None or value is None or is_dynamic(value):
            continue
        span = _limits(gripper, quantity.what)
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if span is not None and is_number and not span.least <= value <= span.most:
            unit = _UNITS[quantity.what]
            message = f"{node.kind}: {port}: {gripper.name} cannot do {value:g} {unit}"
            hint = f"its {quantity.what} is {span.least:g} to {span.most:g} {unit}"
            yield node.port_problem((port,), message, hint)


def _limits(gripper: Gripper, what: str) -> Interval | None:
    """Limits of a quantity; None if the gripper does not have it, such as the width of a cup."""
    if what == "force":
        return gripper.force
    if not gripper.fingers:
        return None
    return gripper.speed if what == "speed" else Interval(0.0, gripper.stroke)


@dataclass
class Names:
    """Lookup of the robots, grippers, postures, camera mounts and scene that a file refers to.

    Args:
        file: File, or the valid part of a file with errors.
        source: Source of the file.
        kinds: All node types, by name.
        left_out: Paths of fields of the file that could not be read.
        wrong: Places of the errors that are known.

    Attributes:
        robots: Robots that could be read, by the arm's name.
        problems: Problems found by `look_up`.
        warnings: Warnings found by `look_up`.
    """

    file: TreeFile
    source: Source
    kinds: Mapping[str, NodeType]
    left_out: frozenset[DataPath] = frozenset()
    wrong: frozenset[Location] = frozenset()
    robots: dict[str, Robot] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    warnings: list[Problem] = field(default_factory=list)

    def look_up(self) -> None:
        """Find every name that does not exist, and every gripper too heavy for its arm."""
        if self._knows_scene:
            self._scene()
        self._meshes()
        self._goals()
        for name, arm in self.file.arms.items():
            robot = self._described(
                ("arms", name, "robot"), "robot", arm.robot, robot_names(), load_robot
            )
            gripper = self._described(
                ("arms", name, "gripper"), "gripper", arm.gripper, gripper_names(), load_gripper
            )
            if robot is not None:
                robot = self._locked(("arms", name, "locked"), arm, robot, gripper)
                self.robots[name] = robot if gripper is None else with_gripper(robot, gripper)
                if gripper is not None and robot.payload is not None:
                    self._weigh(("arms", name, "gripper"), gripper, robot.name, robot.payload)
                self._arm(("arms", name), arm, robot)
                self.problems += self._nodes(name, arm, robot)
            if ("arms", name, "gripper") not in self.left_out:
                self.problems += gripper_problems(name, arm, gripper, self.kinds, self.wrong)
        joints = {name: robot.joints for name, robot in self.robots.items()}
        self.problems += joint_problems(self.file.faults, self.source, joints)

    @property
    def _knows_scene(self) -> bool:
        """Whether the scene could be read; otherwise it may have names that the file refers to."""
        return not {("world",), ("world", "scene")} & self.left_out

    def _scene(self) -> None:
        world = self.file.world
        if not is_scene_path(world.scene) and world.scene not in scene_names():
            self._unknown(("world", "scene"), "scene", world.scene, scene_names())
            return
        try:
            taken = names_in(scene_spec(world))
        except CatalogError as error:
            self._add(("world", "scene"), f"scene '{world.scene}' cannot be used", str(error))
            return
        for part, names in (("objects", self.file.objects), ("arms", self.file.arms)):
            for name in names:
                if name in taken:
                    message = f"'{name}' is already the name of a part of the scene '{world.scene}'"
                    self._add((part, name), message, "choose another name", key=True)

    def _meshes(self) -> None:
        for name, obj in self.file.objects.items():
            if obj.shape == "mesh":
                try:
                    refuse_object_mesh(obj.mesh_path, self.file.root, obj.scale)
                except MeshError as error:
                    message = f"mesh {obj.file} {error.message}"
                    problem = self.file.object_problem(self.source, name, "file", message)
                    self.problems.append(replace(problem, hint=error.hint))

    def _locked(self, path: DataPath, arm: ArmSpec, robot: Robot, gripper: Gripper | None) -> Robot:
        """The robot with its locked joints at the file's positions, if these are valid."""
        if not arm.locked or path in self.left_out:
            return robot
        wrong = [
            (joint, False, complaint, "")
            for joint in arm.locked
            if joint in robot.locked
            and (
                complaint := wrong_unit(
                    self.source.get((*path, joint)), turns=robot.locked[joint].turns
                )
            )
        ]
        wrong = wrong or [*problems_of(robot.name, robot.joints, robot.locked, arm.locked)]
        for joint, is_name, message, hint in wrong:
            self._add((*path, joint), message, hint, key=is_name)
        if wrong:
            return robot
        for joint in sorted(stock_joints(robot) & arm.locked.keys() if gripper else ()):
            message = COMES_OFF.format(joint=joint, gripper=gripper.name if gripper else "")
            hint = "use `open_gripper` to open a gripper"
            self._add((*path, joint), message, hint, key=True)
        return load_robot(arm.robot, self.file.root, arm.locked)

    def _described(
        self,
        path: DataPath,
        what: str,
        name: str | None,
        known: Iterable[str],
        read: Callable[[str, Path | None], Described],
    ) -> Described | None:
        """The robot or gripper of a name, None if there is none or its description has errors."""
        if name is None or is_unknown(name):
            return None
        if not is_description_path(name) and name not in known:
            self._unknown(path, what, name, known)
            return None
        try:
            return read(name, self.file.root)
        except DescriptionError as error:
            self._add(path, f"{what} '{name}' cannot be used", "its description has errors")
            self.problems += error.problems
        except CatalogError as error:
            self._add(path, f"{what} '{name}' cannot be used", str(error))
        return None

    def _weigh(self, path: DataPath, gripper: Gripper, robot: str, payload: float) -> None:
        """Warn of a gripper that leaves nothing of a robot's payload, in kg."""
        if gripper.mass >= payload:
            message = f"gripper '{gripper.name}' weighs {gripper.mass:.3g} kg"
            hint = f"the payload of {robot}, the gripper included, is {payload:g} kg"
            problem = self.source.problem(path, message, hint)
            self.warnings.append(replace(problem, severity="warning"))

    def _arm(self, path: DataPath, arm: ArmSpec, robot: Robot) -> None:
        if arm.posture not in robot.postures:
            what = f"posture of {robot.name}"
            self._unknown((*path, "posture"), what, arm.posture, robot.postures)
        camera = arm.camera
        if not camera or not isinstance(camera.mount, str) or not self._knows_scene:
            return
        if camera.mount not in robot.cameras:
            message = f"there is no camera mount of {robot.name} '{camera.mount}'"
            hint = "its description declares none: add `cameras` there"
            hint = _known(camera.mount, robot.cameras) if robot.cameras else hint
            self._add((*path, "camera", "mount"), message, hint)

    def _nodes(self, name: str, arm: ArmSpec, robot: Robot) -> Iterator[Problem]:
        for node in arm.tree.walk():
            kind = self.kinds.get(node.kind)
            if kind is None:
                continue
            camera = ("arms", name, "camera")
            if kind.needs_camera and not arm.carries_camera and camera not in self.left_out:
                message = f"{node.kind}: {name} has no camera that moves with it"
                mount = next(iter(robot.cameras), "wrist")
                yield node.problem(message, f"give {name} one: camera: {{mount: {mount}}}")
            for port, declared in kind.ports.model_fields.items():
                value = node.ports.get(port)
                if value is None or is_dynamic(value):
                    continue
                of_posture = metadata_of(declared, OfPosture)
                if of_posture and isinstance(value, str) and value not in robot.postures:
                    message = f"{node.kind}: there is no posture of {robot.name} '{value}'"
                    yield node.port_problem((port,), message, _known(value, robot.postures))
                of_joints = metadata_of(declared, OfJoints)
                if of_joints is not None and isinstance(value, (dict, list)):
                    wrong = list(_joints(node, port, value, robot))
                    yield from wrong
                    if not (wrong or of_joints.are_offsets):
                        self.warnings += _beyond_limits(node, port, value, robot)
                joint = self._joint_of(node) if unit_of(declared) == JOINT_UNIT else None
                if joint is not None:
                    yield from _wrong_position(node, kind, port, joint)

    def _joint_of(self, node: NodeSpec) -> Articulation | None:
        """Joint that a node names, or on which the part that it names moves; None if unknown."""
        owner, joint, part = (node.ports.get(name) for name in ("object", "joint", "part"))
        if not isinstance(part, str):  # another check reports what is not a name
            part = None
        for name, obj in self.file.objects.items():
            hung = obj.joint
            if hung is not None and (
                name == owner or (hung.owner == owner and (hung.name == joint or part in obj.parts))
            ):
                return hung
        return None

    def _goals(self) -> None:
        """Refuse goals and invariants of joints whose positions have the wrong unit."""
        for section in SECTIONS:
            for name, condition in getattr(self.file, section).items():
                moved = moved_name(condition.object or "", condition.joint or "")
                hung = self.file.objects[moved].joint if moved in self.file.objects else None
                path = (section, name, "between")
                if hung is not None:
                    given = self.source.get(path)
                    complaint = wrong_unit(given, turns=hung.spec.type == "hinge")
                    if complaint:
                        self._add(path, complaint)

    def _unknown(self, path: DataPath, what: str, given: str, known: Iterable[str]) -> None:
        hint = _known(given, known)
        if what == "robot" and given.lower().endswith((".urdf", ".xacro")):
            hint = f"a robot is a description of it: bt-robot {given} --out NAME.yaml writes one"
        self._add(path, f"there is no {what} '{given}'", hint)

    def _add(self, path: DataPath, message: str, hint: str = "", *, key: bool = False) -> None:
        self.problems.append(self.source.problem(path, message, hint, key=key))


def _joints(node: NodeSpec, port: str, value: Data, robot: Robot) -> Iterator[Problem]:
    """Yields problems of a list with a value per joint, or of a mapping of some joints by name."""
    if isinstance(value, dict):
        for name in value:
            if name not in robot.joints:
                message = f"{node.kind}: there is no joint of {robot.name} '{name}'"
                yield node.port_problem((port, name), message, _known(name, robot.joints), key=True)
    elif len(value) != len(robot.joints):
        dof = len(robot.joints)
        values = counted(len(value), "value")
        message = f"{node.kind}: {port}: {values} for the {dof} joints of {robot.name}"
        yield node.port_problem((port,), message, f"base to tip: {', '.join(robot.joints)}")


def _beyond_limits(
    node: NodeSpec, port: str, value: Mapping[str, Data] | Sequence[Data], robot: Robot
) -> Iterator[Problem]:
    """Yields a warning for each literal angle, in degrees, beyond the limits of its joint."""
    angles = value if isinstance(value, Mapping) else dict(enumerate(value))
    for key, angle in angles.items():
        joint = robot.joints.index(key) if isinstance(key, str) else key
        if not isinstance(angle, (int, float)):
            continue
        low, high = np.degrees((robot.limits.lower[joint], robot.limits.upper[joint])).tolist()
        if not low - 1e-6 <= angle <= high + 1e-6:
            message = f"{node.kind}: {port}: {robot.joints[joint]} cannot be at {angle:g}°"
            low, high = degrees_within(robot.limits.lower[joint], robot.limits.upper[joint])
            hint = f"its limits are {low:g}° and {high:g}°"
            problem = node.port_problem((port, key), message, hint)
            yield replace(problem, severity="warning")


def _known(given: str, known: Iterable[str]) -> str:
    return suggestion(given, known, "one")


def overloads(
    file: TreeFile, robots: Mapping[str, Robot], kinds: Mapping[str, NodeType]
) -> Iterator[Problem]:
    """Yields a warning for every object that an arm is to pick up or carry, but is too heavy.

    It is heavier than the arm's payload, or it is fixed. The first leaf counts.

    Args:
        file: File without errors.
        robots: Robots by the arm's name.
        kinds: All node types, by name.
    """
    for name, arm in file.arms.items():
        payload = robots[name].payload
        bears = math.inf if arm.gripper is None else load_gripper(arm.gripper, file.root).payload
        reported = set[str]()
        for node in arm.tree.walk():
            picked = dict(_picked(node, kinds))
            for port, name_of_object in {**picked, **dict(_carried(node, kinds))}.items():
                part = node.ports.get("part")
                spec = None
                if not is_dynamic(part):
                    spec = object_of_part(file.objects, name_of_object, part)
                if spec is None or name_of_object in reported:
                    continue
                mass = spec.total_mass
                message = hint = ""
                if port in picked and spec.fixed:
                    if arm.gripper is None or not grasps(node, kinds[node.kind]):  # unfit_grasps
                        message = "is fixed: no arm can carry it"
                        hint = "leave out `fixed`, or name another object"
                elif port in picked and (spec.joint is not None or mass > bears):
                    continue  # the joint bears it, or unfit_grasps warns of it
                elif payload is not None and mass > payload:
                    message = f"weighs {mass:g} kg"
                    hint = f"the payload of {name}, a {robots[name].full_name}, is {payload:g} kg"
                if message:
                    reported.add(name_of_object)
                    message = f"{node.kind}: {port}: {name_of_object} {message}"
                    yield replace(node.port_problem((port,), message, hint), severity="warning")


def joint_actions(
    file: TreeFile, robots: Mapping[str, Robot], kinds: Mapping[str, NodeType]
) -> Iterator[Problem]:
    """Yields a warning for every joint action that its arms cannot do.

    They stand too far apart to hold one object, or it is heavier than all of their payloads.

    Args:
        file: File without errors.
        robots: Robots by the arm's name.
        kinds: All node types, by name.
    """
    balls: dict[str, tuple[Vector, float]] = {}
    reported = set[tuple[frozenset[str], str]]()
    for name, arm in file.arms.items():
        for node in arm.tree.walk():
            action = kinds[node.kind].counterpart if node.kind in kinds else None
            partners = () if action is None else action.partners(node.ports)
            obj = str(node.ports.get("object"))
            spec = file.objects.get(obj)
            members = [name, *partners]
            key = frozenset(members), obj
            if action is None or spec is None or not robots.keys() >= set(members):
                continue
            if key in reported or len(members) < 2:
                continue
            for one in set(members) - balls.keys():
                balls[one] = Chain(robots[one], file.arms[one].base.pose).bounding_ball
            first, second, gap = _farthest_apart({one: balls[one] for one in members})
            if gap > _diagonal(spec):
                reported.add(key)
                message = f"{node.kind}: {first} and {second} cannot hold {obj} at once"
                hint = f"their workspaces are at least {gap:.2f} m apart: move a `base`"
                problem = node.port_problem((action.partner,), message, hint)
                yield replace(problem, severity="warning")
            # In an action of the same kind, all carry it; in others, it goes from hand to hand.
            payloads = [robots[one].payload for one in members]
            most = sum(0.0 if one is None else one for one in payloads)
            if action.kind == node.kind and None not in payloads and spec.total_mass > most:
                reported.add(key)
                message = f"{node.kind}: object: {obj} weighs {spec.total_mass:g} kg"
                together = f"{', '.join(members[:-1])} and {members[-1]} together"
                hint = f"the payload of {together} is {most:g} kg"
                yield replace(node.port_problem(("object",), message, hint), severity="warning")


def _farthest_apart(balls: Mapping[str, tuple[Vector, float]]) -> tuple[str, str, float]:
    """The two arms with the largest distance between their workspaces in m, and that distance."""
    pairs = [
        (first, second, float(np.linalg.norm(balls[first][0] - balls[second][0])))
        for first, second in combinations(balls, 2)
    ]
    gaps = [(away - balls[a][1] - balls[b][1], a, b) for a, b, away in pairs]
    gap, first, second = max(gaps)
    return first, second, gap


def _carried(node: NodeSpec, kinds: Mapping[str, NodeType]) -> Iterator[tuple[str, str]]:
    """Yields ports with the names of the objects that a node carries."""
    fields = kinds[node.kind].ports.model_fields if node.kind in kinds else {}
    goals = (metadata_of(declared, Goal) for declared in fields.values())
    if not any(goal.carried for goal in goals if goal):
        return
    for port, declared in fields.items():
        refers = metadata_of(declared, Refers)
        value = node.ports.get(port)
        if refers is not None and refers.to == ("object",) and isinstance(value, str):
            yield port, value


def _picked(node: NodeSpec, kinds: Mapping[str, NodeType]) -> Iterator[tuple[str, str]]:
    """Yields ports with the names of the objects that a node picks up, or takes from an arm."""
    kind = kinds.get(node.kind)
    if kind is None:
        return
    takes = takes_over(node, kind)
    for port, declared in kind.ports.model_fields.items():
        refers = metadata_of(declared, Refers)
        value = node.ports.get(port)
        if refers is None or not isinstance(value, str):
            continue
        if refers.where_it_is or (takes and refers.to == ("object",)):
            yield port, value


def _wrong_position(
    node: NodeSpec, kind: NodeType, port: str, joint: Articulation
) -> Iterator[Problem]:
    """Yields an error if a literal position is of the wrong unit, or beyond the joint's range.

    A condition may ask for any position.
    """
    spec = joint.spec
    value = node.ports[port]
    complaint = wrong_unit(value, turns=spec.type == "hinge")
    if complaint:
        yield node.port_problem((port,), f"{node.kind}: {port}: {complaint}")
    elif isinstance(value, int | float | str) and not isinstance(kind, LanguageNode):
        unit = "deg" if spec.type == "hinge" else "m"
        position = number_in(value, unit) if isinstance(value, str) else value
        low, high = spec.range
        if position is not None and not low <= position <= high:
            what = f"{joint.owner}.{joint.name}"
            message = f"{node.kind}: {port}: {position:g} {spec.unit} is not in the range of {what}"
            yield node.port_problem((port,), message, f"{low:g} to {high:g} {spec.unit}")


def missing_markers(file: TreeFile, kinds: Mapping[str, NodeType]) -> Iterator[Problem]:
    """Yields a warning for every marker that a leaf looks for and no declared object has.

    Args:
        file: File without errors.
        kinds: All node types, by name.
    """
    borne = {name: spec.marker for name, spec in file.objects.items() if spec.marker}
    for arm in file.arms.values():
        for node in arm.tree.walk():
            for port, wanted in _looked_for(node, kinds):
                if wanted not in borne.values():
                    message, hint = _nearest_marker(wanted, borne)
                    problem = node.port_problem((port,), f"{node.kind}: {port}: {message}", hint)
                    yield replace(problem, severity="warning")


def _looked_for(node: NodeSpec, kinds: Mapping[str, NodeType]) -> Iterator[tuple[str, MarkerSpec]]:
    """Yields the ports of a node with a marker that is given literally."""
    fields = kinds[node.kind].ports.model_fields if node.kind in kinds else {}
    for port, declared in fields.items():
        if MarkerSpec in models_in(declared.annotation) and isinstance(node.ports.get(port), dict):
            try:
                yield port, MarkerSpec.model_validate(node.ports[port])
            except ValidationError:  # a part of it is a blackboard key, known only at run time
                continue


def _nearest_marker(wanted: MarkerSpec, borne: Mapping[str, MarkerSpec]) -> tuple[str, str]:
    """Message and hint with the most similar marker of an object."""
    which = f"marker {wanted.id} of {wanted.dictionary}"
    for name, marker in borne.items():
        if (marker.dictionary, marker.id) == (wanted.dictionary, wanted.id):
            sizes = f"{1e3 * marker.size:g} mm, not {1e3 * wanted.size:g} mm"
            return f"that of {name} measures {sizes}", f"did you mean size: {marker.size:g}?"
    for name, marker in borne.items():
        if marker.id == wanted.id:
            message = f"no object has {which}; {name} has {marker.id} of {marker.dictionary}"
            return message, f"did you mean dictionary: {marker.dictionary}?"
    known = ", ".join(f"{marker.id} of {marker.dictionary}" for marker in borne.values())
    return f"no object has {which}", f"there are {known}" if known else "no object has a marker"


def undetectable(file: TreeFile, kinds: Mapping[str, NodeType]) -> Iterator[Problem]:
    """Yields a warning for every object that a leaf looks for and that no camera can detect.

    Args:
        file: File without errors.
        kinds: All node types, by name.
    """
    for arm in file.arms.values():
        for node in arm.tree.walk():
            kind = kinds.get(node.kind)
            obj = file.objects.get(str(node.ports.get("object")))
            if obj is None or kind is None or not issubclass(kind.ports, SightPorts):
                continue
            message = ""
            if node.ports.get("by", "color") == "marker":
                message = "" if obj.marker else "it has no marker"
                hint = "`marker` of the object; or leave out `by`"
            elif node.ports.get("color") is None:
                try:
                    color_of(obj)
                except ColorlessError as error:
                    message = str(error)
                    hint = "`color` of the object, or of the leaf; or a marker"
            if message:
                name = node.ports["object"]
                message = f"{node.kind}: object: {name} cannot be detected: {message}"
                yield replace(node.port_problem(("object",), message, hint), severity="warning")


_SURE_M: Final = 0.005
"""Noise of an object's position up to which its declared pose is as good as any, m."""


def unknown_places(file: TreeFile, kinds: Mapping[str, NodeType]) -> Iterator[Problem]:
    """Yields a warning for poses relative to objects that are not where the file declares them.

    An arm assumes the declared pose, without its noise, of an object that none of its leaves names:
    it has neither seen nor held it.

    Args:
        file: File without errors.
        kinds: All node types, by name.
    """
    moved = {}
    for name, spec in file.objects.items():
        noise = spec.noise.xyz if spec.fixed else spec.noise.xyz[:2]  # others fall
        if max(noise) > _SURE_M:
            moved[name] = math.hypot(*noise)
    for arm_name, arm in file.arms.items():
        nodes = [*arm.tree.walk()]
        named = {
            value
            for node in nodes
            for port, value in node.ports.items()
            if isinstance(value, str) and _refers_to_object(node, port, kinds)
        }
        if any("{" in name for name in named):
            continue  # it may be any object
        for node in nodes:
            for port, path, value in _poses_in(node):
                relations = (value.get(word) for word in RELATIONS)
                given = next((one for one in relations if isinstance(one, str)), "")
                obj = given.partition(".")[0]
                if obj in moved and obj not in named:
                    message = (
                        f"{node.kind}: {port}: the noise of {obj} moves it by up to "
                        f"{1e3 * moved[obj]:.0f} mm, and {arm_name} does not look for it"
                    )
                    hint = (
                        f"it assumes the pose in the file: `locate: {{object: {obj}}}` with a "
                        "camera before"
                    )
                    problem = node.port_problem(path, message, hint)
                    yield replace(problem, severity="warning")


def _poses_in(node: NodeSpec) -> Iterator[tuple[str, DataPath, Mapping[str, Data]]]:
    """Yields mappings that may be poses: ports, their elements, and the direction of `keep`.

    Each with its port and with its path in the ports.
    """
    for port, value in node.ports.items():
        if isinstance(value, dict):
            yield port, (port,), value
            facing = value.get("facing")
            toward = facing.get("toward") if isinstance(facing, dict) else None
            if isinstance(toward, dict):
                yield port, (port, "facing", "toward"), toward
        elif isinstance(value, list | tuple):
            for index, one in enumerate(value):
                if isinstance(one, dict):
                    yield port, (port, index), one


def _refers_to_object(node: NodeSpec, port: str, kinds: Mapping[str, NodeType]) -> bool:
    """Whether a port of a node has the name of an object."""
    declared = kinds[node.kind].ports.model_fields.get(port) if node.kind in kinds else None
    refers = None if declared is None else metadata_of(declared, Refers)
    return refers is not None and "object" in refers.to


MOST_POSES: Final = 100
"""Largest number of different poses checked per arm, to keep the check quick."""

MOST_WARNINGS: Final = 10
"""Largest number of warnings per arm; poses out of reach take longest to check."""


def out_of_reach(
    file: TreeFile, robots: Mapping[str, Robot], kinds: Mapping[str, NodeType]
) -> Iterator[Problem]:
    """Yields a warning for every literal goal pose for which the arm has no configuration.

    And for every object that it is to pick up and that is farther away.

    Args:
        file: File without errors.
        robots: Robots by the arm's name.
        kinds: All node types, by name.
    """
    # A carried object may be grasped at any point, up to its diagonal away from the pose.
    longest = max(map(_diagonal, file.objects.values()), default=0.0)
    unmoved = _unmoved(file, kinds)
    for name, arm in file.arms.items():
        bases = {"base": arm.base, **{other: one.base for other, one in file.arms.items()}}
        reach = _ReachCheck(name, robots[name], arm.base, longest, bases)
        found = 0
        for node in arm.tree.walk():
            fields = kinds[node.kind].ports.model_fields if node.kind in kinds else {}
            for port, declared in fields.items():
                goal = metadata_of(declared, Goal)
                value = node.ports.get(port)
                complaints: list[tuple[DataPath, tuple[str, str] | None]] = []
                if goal:
                    poses: dict[DataPath, Data] = {(port,): value}
                    if isinstance(value, list | tuple):
                        poses = {(port, index): one for index, one in enumerate(value)}
                    free = _free_axes(node)
                    complaints = [
                        (path, reach.complaint(one, goal, free)) for path, one in poses.items()
                    ]
                refers = metadata_of(declared, Refers)
                if refers is not None and refers.where_it_is and value in unmoved[name]:
                    complaints = [((port,), reach.of_object(node, file.objects[value]))]
                for path, complaint in complaints:
                    if complaint and found < MOST_WARNINGS:
                        found += 1
                        message = f"{node.kind}: {port}: {complaint[0]}"
                        problem = node.port_problem(path, message, complaint[1])
                        yield replace(problem, severity="warning")


def _unmoved(file: TreeFile, kinds: Mapping[str, NodeType]) -> Mapping[str, frozenset[str]]:
    """Names of the objects that stay within their noise until an arm picks them up, by the arm.

    Not those that a leaf of another arm names, that are spawned, and that may ride on what is
    picked up.
    """
    named: dict[str, set[str]] = {name: set() for name in file.arms}
    spawned = {name for name, spec in file.objects.items() if not spec.spawned}
    for name, arm in file.arms.items():
        for node in arm.tree.walk():
            for port, value in node.ports.items():
                if isinstance(value, str) and _refers_to_object(node, port, kinds):
                    named[name].add(value)
                    if kinds[node.kind].takes_out:
                        spawned.add(value)
    taken = set[str]().union(*named.values())
    if file.faults or any(is_dynamic(name) for name in taken):
        return {name: frozenset() for name in file.arms}
    carriers = {name: file.objects[name] for name in taken & file.objects.keys()}
    riding = {
        name
        for name, spec in file.objects.items()
        for carrier, other in carriers.items()
        if name != carrier and not other.fixed and _may_touch(spec, other)
    }
    return {
        name: frozenset(file.objects.keys() - spawned - riding).difference(
            *(others for other, others in named.items() if other != name)
        )
        for name in file.arms
    }


def _may_touch(one: ObjectSpec, other: ObjectSpec) -> bool:
    apart = np.linalg.norm(one.pose.pose.position - other.pose.pose.position)
    return float(apart) <= _radius(one) + _radius(other)


def _radius(obj: ObjectSpec) -> float:
    """Largest distance of a point of an object from where the file declares its frame, m."""
    return body_of(obj).radius + float(np.linalg.norm(obj.noise.xyz))


def _free_axes(node: NodeSpec) -> FreeAxes | None:
    """Rotations that the poses of a node leave free; None if they are known only at run time."""
    given = node.ports.get("free") or []
    if not isinstance(given, list | tuple):
        return None
    free = tuple(axis for axis in AXES if axis in given)
    return free if len(free) == len(given) else None


def _diagonal(obj: ObjectSpec) -> float:
    """Upper bound of the distance between two points of an object, m."""
    if obj.shape in ("compound", "mesh"):
        return float(np.linalg.norm(np.ptp(body_of(obj).corners, axis=0)))
    return math.hypot(*obj.size)


@dataclass
class _ReachCheck:
    """Checks goal poses of one arm; each different pose is checked once."""

    arm: str
    robot: Robot
    base: PoseSpec
    longest: float
    bases: Mapping[str, PoseSpec]
    _known: dict[tuple[PoseSpec, Goal, FreeAxes], tuple[str, str] | None] = field(
        default_factory=dict
    )

    def __post_init__(self) -> None:
        self._workspace: Workspace | None = None
        self._kinematics: Kinematics | None = None

    def complaint(self, value: Data, goal: Goal, free: FreeAxes | None) -> tuple[str, str] | None:
        """Message and hint for a pose in YAML notation; None if it can be reached."""
        if value is None or is_dynamic(value) or free is None:
            return None
        relative = relative_pose(value)
        if relative is not None:
            base = self.bases.get(relative.in_frame or "")
            if base is None:
                return None  # its position depends on the run
            pose = _in_world(relative, base.pose)
        else:
            try:
                pose = PoseSpec.model_validate(with_tuples(value))
            except ValidationError:
                return None  # a part of it is a blackboard key
        key = (pose, goal, free)
        if key not in self._known:
            if len(self._known) >= MOST_POSES:
                return None
            self._known[key] = self._checked(pose, goal, free)
        return self._known[key]

    def of_object(self, node: NodeSpec, obj: ObjectSpec) -> tuple[str, str] | None:
        """Message and hint for an object that a node is to pick up; None if it may be reached."""
        pose = obj.pose
        given = node.ports.get("at")
        if given is not None:
            if is_dynamic(given) or relative_pose(given) is not None:
                return None
            try:
                pose = PoseSpec.model_validate(with_tuples(given))
            except ValidationError:
                return None
        point = np.array(pose.xyz)
        heights = (point[2],) if obj.fixed else np.linspace(point[2], min(point[2], 0.0), 5)
        radius = _radius(obj)
        gap = math.inf
        for height in heights:  # it may fall
            gap = min(gap, self._position_gap(np.array((*point[:2], height))) - radius)
            if gap <= 0.0:
                return None
        distance = float(np.linalg.norm(point - self.base.pose.position))
        message = f"out of reach of {self.arm}: its tool cannot get closer to it than {gap:.2f} m"
        return message, f"it is {distance:.2f} m from the arm's base"

    def _checked(self, pose: PoseSpec, goal: Goal, free: FreeAxes) -> tuple[str, str] | None:
        point = np.array(pose.xyz)
        distance = float(np.linalg.norm(point - self.base.pose.position))
        hint = f"it is {distance:.2f} m from the arm's base"
        gap = self._position_gap(point)
        if gap > (self.longest if goal.carried else 0.0):
            nearest = f"{gap:.2f} m" if gap >= 0.01 else f"{1000 * gap:.1f} mm"
            message = f"out of reach of {self.arm}: its tool cannot get closer than {nearest}"
            return message, hint
        turned = pose.rpy or pose.quat or pose.look_at
        if goal.carried or turned is None or self._has_configuration(pose, free):
            return None
        if self.robot.dof < 6 - len(free):
            hint = (
                f"the {self.robot.dof} joints of {self.robot.name} cannot take every orientation: "
                f"{REMEDY}"
            )
        return f"{self.arm} reaches this point, but not in this orientation", hint

    def _position_gap(self, point: Vector) -> float:
        if self._workspace is None:
            self._workspace = Workspace(self.robot, self.base.pose)
        return self._workspace.gap(point)

    def _has_configuration(self, pose: PoseSpec, free: FreeAxes) -> bool:
        if self._kinematics is None:
            self._kinematics = Kinematics(self.robot, self.base.pose)
        if not free and self._kinematics.is_beyond(pose.pose):
            return False  # a search takes 30 ms
        try:
            self._kinematics.solve(pose.pose, self.robot.postures["home"], free=free)
        except Failure:
            return False
        return True


def _in_world(relative: RelativePose, base: Pose) -> PoseSpec:
    """Pose in the world of one in the frame of an arm's base."""
    pose = base @ relative.local
    x, y, z = pose.position.tolist()
    if not relative.is_oriented:
        return PoseSpec(xyz=(x, y, z))
    a, b, c, d = pose.quaternion.tolist()
    return PoseSpec(xyz=(x, y, z), quat=(a, b, c, d))


@dataclass(frozen=True)
class Checked:
    """A checked file and its problems.

    Attributes:
        file: The file; None if it has errors, or subtrees only.
        problems: Every error in the file's order; without errors, every warning.
    """

    file: TreeFile | None
    problems: tuple[Problem, ...]

    def runnable(self) -> TreeFile:
        """The file.

        Raises:
            SpecError: The file has errors, or nothing to run.
        """
        if self.file is None:
            raise SpecError(errors(self.problems))
        return self.file


def check(
    tree: TreeInput,
    skills: Mapping[str, NodeType],
    params: Mapping[str, object] | None = None,
    *,
    folder: Path | None = None,
    build: bool = True,
) -> Checked:
    """Check a tree, including the robots, postures, mounts, scene and poses that it refers to.

    Args:
        tree: Path of a file, YAML text, Python data, or one already read.
        skills: Installed skills, by name.
        params: Values of the tree's parameters by name: as text, as given on the command line, or
            as Python data.
        folder: Folder from which relative paths in text or data start, by default the current one.
        build: Whether to compile the world as well, as a run would.
    """
    loaded = load(tree, skills, params, folder)
    kinds = all_of(LANGUAGE, skills)
    file = loaded.file or loaded.sound
    source = loaded.source
    if file is None or source is None:
        return Checked(None, loaded.wrong)
    known = frozenset(one.place for one in errors(loaded.problems))
    names = Names(file, source, kinds, loaded.left_out, known)
    names.look_up()
    of_world: list[Problem] = []
    # An unknown value stands for that of a parameter, which has been reported.
    names_of_parts = [name for arm in file.arms.values() for name in (arm.robot, arm.gripper)]
    is_named = not any(map(is_unknown, names_of_parts))
    if build and is_named and not names.problems and not loaded.left_out:
        of_world = _problems_of_the_world(file, source, loaded.name)
    wrong = [*errors(loaded.problems), *names.problems, *errors(of_world)]
    if wrong or loaded.file is None:
        return Checked(None, in_order(wrong))
    robots = names.robots
    warnings = (
        *of_world,
        *names.warnings,
        *out_of_reach(file, robots, kinds),
        *overloads(file, robots, kinds),
        *unfit_grasps(file, kinds),
        *joint_actions(file, robots, kinds),
        *missing_markers(file, kinds),
        *undetectable(file, kinds),
        *unknown_places(file, kinds),
    )
    return Checked(file, in_order((*loaded.problems, *warnings)))


def checked_faults(file: TreeFile, given: TreeInput) -> dict[str, FaultSpec]:
    """Faults to inject into the run of a file, in addition to its own.

    Args:
        file: File without errors.
        given: Path of a file with a section ``faults``, YAML text, or data of the same form.

    Raises:
        SpecError: They have errors, do not fit the file, or have names of its own faults.
    """
    faults, source = read_faults(given)
    trees = {name: arm.tree for name, arm in file.arms.items()}
    cameras = frozenset(name for name, arm in file.arms.items() if arm.camera)
    joints = {
        name: load_robot(arm.robot, file.root, arm.locked).joints for name, arm in file.arms.items()
    }
    problems = [
        *fault_problems(faults, source, trees, file.objects, cameras),
        *joint_problems(faults, source, joints),
    ]
    for name in faults.keys() & file.faults.keys():
        message = f"the tree file has a fault '{name}' of its own"
        problems.append(source.problem(("faults", name), message, "choose another name", key=True))
    if problems:
        raise SpecError(problems)
    return faults


def _problems_of_the_world(file: TreeFile, source: Source, name: str) -> list[Problem]:
    """Problems of composing the world, and of what is in contact or near each other in it."""
    try:
        world = World(file, file.world.seed)
    except RoomError as error:
        hint = "a larger area, a smaller gap, or fewer objects"
        problem = file.object_problem(source, f"{error.entry}1", "many", error.message)
        return [replace(problem, hint=hint)]
    except SpringError as error:
        problem = file.object_problem(source, error.obj, "joints", str(error))
        return [replace(problem, hint="a softer spring, or a larger mass")]
    except LockedJointError as error:
        return [source.problem(("arms", error.arm, "locked", error.joint), error.message)]
    except (CatalogError, WorldError) as error:
        return [Problem(Location(name), str(error))]
    # A tool slightly inside an object is about to grasp it: only objects are pushed away, and only
    # what is fixed stays in the way of all plans.
    overlaps = [
        error
        for error in world.overlaps(SHALLOW_DEPTH)
        if error.depth > MAX_DEPTH or error.obj in file.objects or not _gives_way(file, error.other)
    ]
    overlapping = [{error.obj, error.other} for error in overlaps]
    return [
        *(_overlap(file, source, error) for error in overlaps),
        *_near_arms(world, source, overlapping),
        *_blind_cameras(file, source, world),
    ]


def _gives_way(file: TreeFile, other: str) -> bool:
    """Whether what an arm is in may move: an object that is not fixed, or an arm."""
    obj = file.objects.get(other)
    return other in file.arms or (obj is not None and not obj.fixed)


def _near_arms(world: World, source: Source, overlapping: Sequence[set[str]]) -> Iterator[Problem]:
    """Yields a warning for each pair of arms that begin nearer to each other than plans allow.

    Args:
        world: The world at its start.
        source: The file.
        overlapping: Pairs of names that are reported already.
    """
    names = list(world.arms)
    for i, name in enumerate(names):
        horizons = dict.fromkeys(names[:i], RESTING_MARGIN_M)
        for other, gap in ArmDistance(world, name).gaps({}, horizons).items() if horizons else ():
            if gap.meters < RESTING_MARGIN_M and {name, other} not in overlapping:
                where = f"{1e3 * gap.meters:.0f} mm from" if gap.meters > 0.0 else "in contact with"
                message = f"{gap.first} begins {where} {gap.second}"
                hint = (
                    f"plans keep {1e3 * RESTING_MARGIN_M:.0f} mm from other arms: once {name} or "
                    f"{other} has left this posture, it cannot return while the other one is there"
                    if gap.meters > 0.0
                    else f"no motion may begin there: another base, or another posture of {name}"
                )
                yield replace(_at_base(source, name, message, hint), severity="warning")


_RAYS: Final = 24
"""Rays along each axis of an image by which the hidden share of it is estimated."""


def _blind_cameras(file: TreeFile, source: Source, world: World) -> Iterator[Problem]:
    """Yields a warning for each wrist camera before whose image center the arm's own hand is.

    Skills turn the camera so that what they look for is there.
    """
    for name, arm in file.arms.items():
        if arm.camera is None or not arm.carries_camera or name not in world.arms:
            continue
        body = world.arms[name]
        half = math.tan(0.5 * math.radians(arm.camera.fov))
        width, height = arm.camera.resolution
        y, x = np.meshgrid(*2 * [np.linspace(-half, half, _RAYS)], indexing="ij")
        rays = np.column_stack((x.ravel() * width / height, y.ravel(), np.ones(x.size)))
        rays = np.vstack(((0.0, 0.0, 1.0), rays))
        geoms = geoms_ahead(world, name, rays)
        if int(geoms[0]) in body.tool_geom_ids:
            link = name_of_geom(world.model, int(geoms[0]))
            share = f"{100 * np.isin(geoms[1:], list(body.tool_geom_ids)).mean():.0f} %"
            message = f"{link} hides the center of the camera's image, and {share} of it"
            hint = "what skills look for is there: another `mount`, or a narrower gripper"
            path = ("arms", name, "camera")
            yield replace(source.problem(path, message, hint, key=True), severity="warning")


def _at_base(source: Source, arm: str, message: str, hint: str = "") -> Problem:
    """Problem at the base of an arm, or at its name if the file gives no base."""
    base = ("arms", arm, "base")
    if source.get(base) is None:
        return source.problem(base[:2], message, hint, key=True)
    return source.problem(base, message, hint)


def _overlap(file: TreeFile, source: Source, error: OverlapError) -> Problem:
    """Problem at the pose of the overlapping object, or at its declaration if it has no pose."""
    if error.obj not in file.arms:
        problem = file.object_problem(source, error.obj, "pose", str(error))
    elif error.other == error.obj:
        posture = ("arms", error.obj, "posture")
        key = posture if source.get(posture) is not None else ("arms", error.obj, "robot")
        hint = "another posture; or 'exclude' of its description, for links that always overlap"
        problem = source.problem(key, str(error), hint)
    else:
        problem = _at_base(source, error.obj, str(error))
    if error.depth > MAX_DEPTH:
        return problem
    if error.obj in file.arms:
        hint = f"no motion may begin there: another base, or another posture of {error.obj}"
    else:
        hint = f"contacts will push it out, by {1000 * error.depth:.0f} mm or farther"
    return replace(problem, severity="warning", hint=hint)
