"""Robots, postures, camera mounts and scenes that a file names: whether they exist, and where."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from bt_dualarm.errors import CatalogueError
from bt_dualarm.preflight.gripping import gripper_problems
from bt_dualarm.spec.annotations import metadata_of
from bt_dualarm.spec.document import ArmSpec, TreeFile
from bt_dualarm.spec.goals import OfJoints, OfPosture
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.ports import is_unknown, reference_of
from bt_dualarm.spec.problems import Problem, suggestion
from bt_dualarm.spec.source import Data, Path, Source
from bt_dualarm.world.composition import names_in, scene_names, scene_spec
from bt_dualarm.world.grippers.gripper import Gripper
from bt_dualarm.world.grippers.mounting import with_gripper
from bt_dualarm.world.grippers.named import gripper_names, load_gripper
from bt_dualarm.world.robots.catalogue import load_robot, robot_names
from bt_dualarm.world.robots.page_path import is_page
from bt_dualarm.world.robots.robot import Robot
from bt_dualarm.world.urdf.xml_source import DescriptionError


@dataclass
class Names:
    """Looks up what a file names outside of itself.

    Args:
        file: File, or what is sound of one that has errors of its own.
        source: Source of the file.
        kinds: Kinds of all nodes, by name.
        left_out: Paths of fields that the file has and that could not be read.

    Attributes:
        robots: Those that could be read, by the arm's name.
        problems: Found by `look_up`.
    """

    file: TreeFile
    source: Source
    kinds: Mapping[str, Kind]
    left_out: frozenset[Path] = frozenset()
    robots: dict[str, Robot] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)

    def look_up(self) -> None:
        """Find every name that leads nowhere."""
        if not {("world",), ("world", "scene")} & self.left_out:
            self._scene()
        for name, arm in self.file.arms.items():
            robot = self._robot(("arms", name, "robot"), arm.robot)
            gripper = self._gripper(("arms", name, "gripper"), arm.gripper)
            if robot is not None:
                self.robots[name] = robot if gripper is None else with_gripper(robot, gripper)
                self._arm(("arms", name), arm, robot)
                self.problems += self._nodes(name, arm, robot)
            if ("arms", name, "gripper") not in self.left_out:
                self.problems += gripper_problems(name, arm, gripper, self.kinds)

    def _scene(self) -> None:
        world = self.file.world
        if world.scene not in scene_names():
            self._unknown(("world", "scene"), "scene", world.scene, scene_names())
            return
        try:
            taken = names_in(scene_spec(world, self.file.root))
        except CatalogueError as error:
            self._add(("world", "scene"), f"scene '{world.scene}' cannot be used", str(error))
            return
        for part, names in (("objects", self.file.objects), ("arms", self.file.arms)):
            for name in names:
                if name in taken:
                    message = f"'{name}' is the name of a part of the scene '{world.scene}' already"
                    self._add((part, name), message, "call it differently", key=True)

    def _robot(self, path: Path, name: str) -> Robot | None:
        if is_unknown(name):
            return None
        if not is_page(name) and name not in robot_names():
            self._unknown(path, "robot", name, robot_names())
            return None
        try:
            return load_robot(name, self.file.root)
        except DescriptionError as error:
            self._add(path, f"robot '{name}' cannot be used", "its description has errors")
            self.problems += error.problems
        except CatalogueError as error:
            self._add(path, f"robot '{name}' cannot be used", str(error))
        return None

    def _gripper(self, path: Path, name: str | None) -> Gripper | None:
        if name is None or is_unknown(name):
            return None
        if not is_page(name) and name not in gripper_names():
            self._unknown(path, "gripper", name, gripper_names())
            return None
        try:
            return load_gripper(name, self.file.root)
        except DescriptionError as error:
            self._add(path, f"gripper '{name}' cannot be used", "its page has errors")
            self.problems += error.problems
        except CatalogueError as error:
            self._add(path, f"gripper '{name}' cannot be used", str(error))
        return None

    def _arm(self, path: Path, arm: ArmSpec, robot: Robot) -> None:
        if arm.posture not in robot.postures:
            what = f"posture of {robot.name}"
            self._unknown((*path, "posture"), what, arm.posture, robot.postures)
        camera = arm.camera
        if camera and isinstance(camera.mount, str) and camera.mount not in robot.cameras:
            what = f"camera mount of {robot.name}"
            self._unknown((*path, "camera", "mount"), what, camera.mount, robot.cameras)

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
                if value is None or reference_of(value) is not None:
                    continue
                if metadata_of(declared, OfPosture) and isinstance(value, str):
                    if value not in robot.postures:
                        message = f"{node.kind}: there is no posture of {robot.name} '{value}'"
                        yield node.port_problem((port,), message, _known(value, robot.postures))
                elif metadata_of(declared, OfJoints) and isinstance(value, (dict, list)):
                    yield from _joints(node, port, value, robot)

    def _unknown(self, path: Path, what: str, given: str, known: Iterable[str]) -> None:
        self._add(path, f"there is no {what} '{given}'", _known(given, known))

    def _add(self, path: Path, message: str, hint: str = "", *, key: bool = False) -> None:
        self.problems.append(self.source.problem(path, message, hint, key=key))


def _joints(node: NodeSpec, port: str, value: Data, robot: Robot) -> Iterator[Problem]:
    """What is wrong with a value for each joint, or for some by name."""
    if isinstance(value, dict):
        for name in value:
            if name not in robot.joints:
                message = f"{node.kind}: there is no joint of {robot.name} '{name}'"
                yield node.port_problem((port, name), message, _known(name, robot.joints), key=True)
    elif len(value) != len(robot.joints):
        dof = len(robot.joints)
        message = f"{node.kind}: {port}: {len(value)} values for the {dof} joints of {robot.name}"
        yield node.port_problem((port,), message, f"base to tip: {', '.join(robot.joints)}")


def _known(given: str, known: Iterable[str]) -> str:
    return suggestion(given, known, "one")
