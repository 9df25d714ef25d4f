"""MJCF scenes: bodies of a MuJoCo file as fixtures and objects of a tree.

No library sees the file. It is read with positions, as URDFs are, and what it describes becomes the
same fixtures that a scene in YAML declares: shapes, joints, colors, cameras. What a scene cannot
have, such as an include, a plugin or an actuator, is an error at its line; options of the
simulation are those of the tree file, and are ignored here with a warning.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from pydantic import ValidationError

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.robots.urdf_xml import AttributeReader, DescriptionError, Element, Range, parse_xml
from bt_dualarm.spec.document import MOST_PARTS, FixtureSpec
from bt_dualarm.spec.joints import MOST_JOINTS
from bt_dualarm.spec.node_types import counted
from bt_dualarm.spec.problems import Problem, in_order, is_name, suggestion
from bt_dualarm.spec.scene import MOST_CAMERAS, MOST_FIXTURES, SceneContent, SceneFile
from bt_dualarm.spec.yaml_reader import Data, DataPath, Source, Span, with_tuples

_LENGTH: Final = Range(-100.0, 100.0, "m")
_SIZE: Final = Range(0.0, 10.0, "m")
_SHARE: Final = Range(0.0, 1.0)
_NUMBER: Final = Range(-1e6, 1e6)
_POSITIVE: Final = Range(0.0, 1e6)

_IGNORED: Final = frozenset(
    {"option", "size", "visual", "statistic", "keyframe", "custom"}
)  # sections of a file that are unrelated to its bodies
_SILENT: Final = frozenset({"light", "site", "texture"})  # not seen by arms, cameras or contacts
_REFUSED: Final[Mapping[str, str]] = {
    "include": "put everything into one file: no other file is read",
    "plugin": "plugins are code, which no scene may load",
    "extension": "plugins are code, which no scene may load",
    "actuator": "a scene has no motors: arms move its joints",
    "frame": "write the pose of each body or geom",
    "replicate": "use `many` in the tree file",
    "attach": "put everything into one file: no other file is read",
    "composite": "a scene consists of rigid bodies",
    "flexcomp": "a scene consists of rigid bodies",
}
"""Elements that are errors, with what to do instead; every unknown one is an error as well."""

_KNOWN: Final[Mapping[str, frozenset[str]]] = {
    "mujoco": frozenset({"compiler", "default", "asset", "worldbody", *_IGNORED}),
    "default": frozenset({"default", "geom", "joint", "material", "mesh", "site", "camera"}),
    "asset": frozenset({"texture", "material", "mesh"}),
    "worldbody": frozenset({"body", "geom", "camera", "light", "site"}),
    "body": frozenset(
        {"body", "geom", "joint", "freejoint", "inertial", "camera", "light", "site"}
    ),
}
"""Elements that an element may contain."""

_POSED: Final = frozenset({"pos", "quat", "euler", "axisangle", "xyaxes", "zaxis"})
_ATTRIBUTES: Final[Mapping[str, frozenset[str]]] = {
    "geom": frozenset(
        {"name", "class", "type", "size", "fromto", "rgba", "material", "mass", "density"}
        | {"friction", "mesh", "contype", "conaffinity", "group", "condim", "solref", "solimp"}
        | {"margin", "gap", "priority"}
        | _POSED
    ),
    "body": frozenset({"name", "childclass", "gravcomp", *_POSED}),
    "joint": frozenset(
        {"name", "class", "type", "pos", "axis", "range", "limited", "damping", "stiffness"}
        | {"springref", "frictionloss", "ref", "armature", "group", "margin"}
        | {"solreflimit", "solimplimit", "solreffriction", "solimpfriction"}
    ),
    "mesh": frozenset({"name", "class", "file", "scale", "inertia"}),
    "compiler": frozenset({"angle", "meshdir", "autolimits", "coordinate", "eulerseq"}),
}
"""Attributes of elements; those that only tune MuJoCo's solver are ignored."""

_SHAPES: Final = ("sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "plane")
_DENSITY: Final = 1000.0  # kg/m³, MuJoCo's default
_FLOOR_M: Final = 1e-6
_FREE: Final = ("free", "ball", "slide", "hinge")


def read_mjcf(text: str, shown: str) -> tuple[SceneFile | None, list[Problem]]:
    """Returns the scene of an MJCF file with its problems; None if it is not one.

    Args:
        text: Text of the file.
        shown: Its path, for messages.
    """
    try:
        top = parse_xml(text, shown)
    except DescriptionError as error:
        return None, list(error.problems)
    reader = _Reader()
    reader.read(top)
    lines = top.document.lines
    source = Source(shown, lines, {"fixtures": reader.fixtures}, reader.spans, reader.spans)
    if reader.problems:
        return SceneFile(source, None), list(in_order([*reader.problems, *reader.warnings]))
    content: dict[str, FixtureSpec] = {}
    problems: list[Problem] = list(reader.warnings)
    for name, data in reader.fixtures.items():
        try:
            content[name] = FixtureSpec.model_validate(with_tuples(data))
        except ValidationError as error:
            at = reader.elements[name]
            problems += [
                at.problem(f"{name}: {one['msg'].removeprefix('Value error, ')}")
                for one in error.errors()
            ]
    cameras = with_tuples(reader.cameras)
    if any(problem.severity == "error" for problem in problems):
        return SceneFile(source, None), problems
    made = SceneContent.model_validate({"description": "", "cameras": cameras})
    return SceneFile(source, made.model_copy(update={"fixtures": content})), problems


@dataclass
class _Bodies:
    """Parts and joints of one top-level body.

    Attributes:
        parts: Data of the parts by name.
        joints: Data of the joints by name.
        geoms: Geoms of the parts, with their poses in the body.
        is_free: Whether it is not fixed.
        mass: Mass of everything, kg.
        moved: Joint that moves each part, empty for none.
    """

    parts: dict[str, Any] = field(default_factory=dict)
    joints: dict[str, Any] = field(default_factory=dict)
    geoms: dict[str, tuple[Element, Pose]] = field(default_factory=dict)
    masses: dict[str, float] = field(default_factory=dict)
    is_free: bool = False


class _Reader(AttributeReader):
    """Reads one file; collects problems.

    Attributes:
        fixtures: Data of the fixtures by name, as in a scene file.
        cameras: Data of the cameras by name.
        elements: Element of each fixture.
        spans: Where the fixtures and their fields are in the text.
        warnings: What is ignored.
    """

    def __init__(self) -> None:
        super().__init__()
        self.fixtures: dict[str, Any] = {}
        self.cameras: dict[str, Any] = {}
        self.elements: dict[str, Element] = {}
        self.spans: dict[DataPath, Span] = {}
        self.warnings: list[Problem] = []
        self._degrees = True
        self._folder = ""
        self._classes: dict[str, dict[str, dict[str, str]]] = {}
        self._materials: dict[str, Element] = {}
        self._meshes: dict[str, Element] = {}

    def read(self, top: Element) -> None:
        """Read the whole file."""
        if top.tag != "mujoco":
            self.add(top, f"expected <mujoco>, not <{top.tag}>", "an MJCF file begins with it")
            return
        self._compiler(top)
        self._check_children(top)
        for default in top.all("default"):
            self._default(default, {}, "main")
        for assets in top.all("asset"):
            self._check_children(assets)
            self._materials |= {
                one.attributes.get("name", ""): one for one in assets.all("material")
            }
            for mesh in assets.all("mesh"):
                self._check_attributes(mesh)
                self._meshes[self._mesh_name(mesh)] = mesh
        world = top.find("worldbody")
        if world is None:
            self.add(top, "the file has no <worldbody>")
            return
        for again in list(top.all("worldbody"))[1:]:
            self.add(again, "a second <worldbody>", "put all bodies into one")
        self._check_children(world)
        for number, geom in enumerate(world.all("geom"), 1):
            self._of_the_world(geom, number)
        for number, body in enumerate(world.all("body"), 1):
            self._top_body(body, number)
        for number, camera in enumerate(world.all("camera"), 1):
            self._camera(camera, Pose.identity(), number)
        if len(self.fixtures) > MOST_FIXTURES:
            self.add(world, f"{len(self.fixtures)} bodies; at most {MOST_FIXTURES} are allowed")

    # Elements and attributes

    def _check_children(self, element: Element) -> None:
        """Refuse what an element cannot contain."""
        known = _KNOWN[element.tag]
        for child in element.children:
            if child.tag in known:
                if child.tag in _IGNORED:
                    message = f"<{child.tag}> is ignored: the tree file has the world's options"
                    found = child.problem(message)
                    self.warnings.append(replace(found, severity="warning"))
                continue
            hint = _REFUSED.get(child.tag) or suggestion(child.tag, known, "element")
            self.add(child, f"<{child.tag}> in <{element.tag}> is not allowed in a scene", hint)

    def _check_attributes(self, element: Element) -> None:
        known = _ATTRIBUTES[element.tag]
        for name in element.attributes:
            if name not in known:
                hint = suggestion(name, known, "attribute")
                self.add(element, f"<{element.tag}> cannot have '{name}' in a scene", hint, name)

    def _compiler(self, top: Element) -> None:
        for element in top.all("compiler"):
            self._check_attributes(element)
            given = element.attributes
            angle = given.get("angle", "degree")
            if angle not in ("degree", "radian"):
                self.add(element, f"angle is degree or radian, not '{angle}'", "", "angle")
            self._degrees = angle != "radian"
            self._folder = given.get("meshdir", self._folder)
            for name, only in (("coordinate", "local"), ("eulerseq", "xyz")):
                if given.get(name, only) != only:
                    self.add(element, f"{name} can only be '{only}'", "", name)

    def _default(
        self, element: Element, inherited: Mapping[str, dict[str, str]], name: str
    ) -> None:
        """Attributes that a class gives to elements, by their tag."""
        self._check_children(element)
        own = {tag: dict(values) for tag, values in inherited.items()}
        for child in element.children:
            if child.tag != "default":
                own[child.tag] = {**own.get(child.tag, {}), **child.attributes}
        self._classes[name] = own
        for child in element.all("default"):
            self._default(child, own, self.name(child, "class"))

    def _with_class(self, element: Element, childclass: str) -> Element:
        """The element with the attributes of its class."""
        name = element.attributes.get("class", childclass)
        if name not in self._classes and name != "main":
            hint = suggestion(name, self._classes, "class")
            self.add(element, f"there is no class '{name}'", hint, "class")
        given = self._classes.get(name, {}).get(element.tag, {})
        own = {**given, **element.attributes}
        # A pose is given in one notation: that of the element overrides that of its class.
        turned = (_POSED - {"pos"}) & element.attributes.keys()
        if turned:
            own = {key: one for key, one in own.items() if key not in _POSED - {"pos"} - turned}
        return Element(
            element.tag, own, element.document, element.line, element.column, element.children
        )

    def _numbers_of(
        self, element: Element, attribute: str, counts: tuple[int, ...], within: Range = _NUMBER
    ) -> tuple[float, ...]:
        """So many numbers; an empty tuple if there are none, or after a problem."""
        text = element.attributes.get(attribute)
        if text is None:
            return ()
        count = len(text.split())
        if count not in counts:
            expected = " or ".join(str(one) for one in counts)
            noun = "number" if counts == (1,) else "numbers"
            message = f"<{element.tag}> {attribute}: expected {expected} {noun}, not {count}"
            self.add(element, message, "", attribute)
            return ()
        return self._numbers(element, attribute, text, count, within)

    def _angle(self, value: float) -> float:
        return math.radians(value) if self._degrees else value

    def _pose(self, element: Element) -> Pose:
        """Pose of a body, geom or camera in its parent."""
        given = [name for name in sorted(_POSED - {"pos"}) if name in element.attributes]
        if len(given) > 1:
            self.add(element, f"gives the orientation twice: {' and '.join(given)}")
        position = self.vector(element, "pos", _LENGTH, (0.0, 0.0, 0.0))
        turn = np.eye(3)
        quat = self._numbers_of(element, "quat", (4,))
        euler = self._numbers_of(element, "euler", (3,))
        about = self._numbers_of(element, "axisangle", (4,))
        axes = self._numbers_of(element, "xyaxes", (6,))
        zaxis = self._numbers_of(element, "zaxis", (3,))
        try:
            if quat:
                turn = Pose(np.zeros(3), _unit(quat)).rotation_matrix
            elif euler:
                # Intrinsic rotations about x, y, z in that order.
                for value, axis in zip(euler, np.eye(3), strict=True):
                    turn = turn @ _about(axis, self._angle(value))
            elif about:
                turn = _about(_unit(about[:3]), self._angle(about[3]))
            elif axes:
                x = _unit(axes[:3])
                y = np.array(axes[3:]) - (x @ np.array(axes[3:])) * x
                y = _unit(y)
                turn = np.column_stack((x, y, np.cross(x, y)))
            elif zaxis:
                turn = _onto(_unit(zaxis))
        except ValueError as error:
            self.add(element, f"<{element.tag}>: {error}", "", given[0] if given else None)
        return Pose.from_axes(np.array(position), turn.tolist())

    # Bodies

    def _named(self, element: Element, number: int) -> str:
        """Name of a body or geom as that of an object; by its kind and number if it has none."""
        name = element.attributes.get("name", f"{element.tag}{number}")
        if not is_name(name):
            hint = "use letters, digits, _ and -, at most 48, beginning with a letter"
            self.add(element, f"'{name}' cannot be the name of an object", hint, "name")
        if name in self.fixtures:
            self.add(element, f"there are two objects '{name}'", "rename one", "name")
        return name

    def _of_the_world(self, geom: Element, number: int) -> None:
        """A geom of the world is a fixture of its own; the floor is that of all scenes."""
        filled = self._with_class(geom, "main")
        if filled.attributes.get("type", "sphere") == "plane":
            pose = self._pose(filled)
            is_level = abs(float(pose.rotation_matrix[2, 2]) - 1.0) < _FLOOR_M
            if not is_level or abs(float(pose.position[2])) > _FLOOR_M:
                self.add(geom, "a plane is the floor, at a height of 0", "use a box")
            return
        bodies = _Bodies()
        self._geom(geom, "main", Pose.identity(), bodies, "", 1)
        self._finish(geom, self._named(geom, number), Pose.identity(), bodies)

    def _top_body(self, body: Element, number: int) -> None:
        bodies = _Bodies()
        name = self._named(body, number)
        self._body(body, "main", Pose.identity(), bodies, "", is_top=True)
        if not bodies.geoms:
            self.add(body, f"body '{name}' has no geom that can be touched")
            return
        self._finish(body, name, self._pose(body), bodies)

    def _body(
        self,
        body: Element,
        childclass: str,
        frame: Pose,
        bodies: _Bodies,
        moved_by: str,
        *,
        is_top: bool = False,
    ) -> None:
        """Add the geoms, joints and bodies of a body, whose pose in the top-level body is known."""
        self._check_children(body)
        self._check_attributes(body)
        childclass = body.attributes.get("childclass", childclass)
        joints = [*body.all("joint"), *body.all("freejoint")]
        if joints:
            moved_by = self._joint(joints, childclass, frame, bodies, moved_by, is_top=is_top)
        for number, geom in enumerate(body.all("geom"), len(bodies.geoms) + 1):
            self._geom(geom, childclass, frame, bodies, moved_by, number)
        for number, camera in enumerate(body.all("camera"), len(self.cameras) + 1):
            if moved_by or bodies.is_free:
                self.add(camera, "a camera of a scene does not move", "put it into <worldbody>")
            else:
                self._camera(camera, self._outer(body, frame, is_top=is_top), number)
        for inner in body.all("body"):
            self._body(inner, childclass, frame @ self._pose(inner), bodies, moved_by)

    def _outer(self, body: Element, frame: Pose, *, is_top: bool) -> Pose:
        return self._pose(body) if is_top else frame

    def _joint(
        self,
        joints: list[Element],
        childclass: str,
        frame: Pose,
        bodies: _Bodies,
        moved_by: str,
        *,
        is_top: bool,
    ) -> str:
        """Add the joint of a body; returns its name, empty for a free one."""
        if len(joints) > 1:
            self.add(joints[1], "a body can have only one joint", "use a body for each")
        joint = joints[0]
        if joint.tag == "joint":
            self._check_attributes(joint)
            joint = self._with_class(joint, childclass)
        kind = "free" if joint.tag == "freejoint" else joint.attributes.get("type", "hinge")
        if kind not in _FREE:
            self.add(joint, f"type is one of {', '.join(_FREE)}, not '{kind}'", "", "type")
            return moved_by
        if kind == "free" and is_top:
            bodies.is_free = True
            return ""
        if kind in ("free", "ball"):
            self.add(joint, f"a {kind} joint is not possible here", "use hinge or slide", "type")
            return moved_by
        if is_top:
            message = "a body with a joint must be inside another body, which stays fixed"
            self.add(joint, message, "put this body into another one with a geom, such as a frame")
            return moved_by
        if moved_by:
            self.add(
                joint, f"a joint on what '{moved_by}' moves already", "one joint for each part"
            )
            return moved_by
        name = joint.attributes.get("name", f"joint{len(bodies.joints) + 1}")
        if not is_name(name) or name in bodies.joints:
            self.add(joint, f"'{name}' cannot be the name of a joint here", "", "name")
        bodies.joints[name] = self._joint_data(joint, kind, frame)
        return name

    def _joint_data(
        self, joint: Element, kind: str, frame: Pose
    ) -> dict[str, Any]:  # Any: fields of a spec
        ends = self._numbers_of(joint, "range", (2,))
        if not ends:
            self.add(joint, "a joint of a scene needs a range", 'range="0 90"')
            ends = (0.0, 1.0)
        unit = math.degrees if kind == "hinge" and not self._degrees else float
        ref = self.number(joint, "ref", _NUMBER, 0.0)
        if ref:
            self.add(joint, "ref can only be 0", "draw the body at position 0", "ref")
        axis = self.vector(joint, "axis", _NUMBER, (0.0, 0.0, 1.0))
        anchor = frame.apply(np.array(self.vector(joint, "pos", _LENGTH, (0.0, 0.0, 0.0))))
        data: dict[str, Any] = {
            "type": kind,
            "parts": [],
            "axis": _rounded(frame.turn(np.array(axis))),
            "range": [unit(end) for end in ends],
            "damping": self.number(joint, "damping", _POSITIVE, 0.0),
            "friction": self.number(joint, "frictionloss", _POSITIVE, 0.0),
            "spring": self.number(joint, "stiffness", _POSITIVE, 0.0),
            "rest": unit(self.number(joint, "springref", _NUMBER, 0.0)),
        }
        if kind == "hinge":
            data["anchor"] = _rounded(anchor)
        return data

    def _geom(
        self,
        geom: Element,
        childclass: str,
        frame: Pose,
        bodies: _Bodies,
        moved_by: str,
        number: int,
    ) -> None:
        """Add a geom as a part, unless it is only for the eyes."""
        self._check_attributes(geom)
        filled = self._with_class(geom, childclass)
        given = filled.attributes
        if given.get("contype") == "0" and given.get("conaffinity") == "0":
            return
        found = self._shape(filled)
        if found is None:
            return
        data, pose = found
        name = given.get("name", f"part{number}")
        if not is_name(name) or name in bodies.parts or name in bodies.joints:
            message = f"'{name}' cannot be the name of a part here: it is invalid or already used"
            self.add(geom, message, "use letters, digits, _ and -", "name")
        placed = frame @ pose
        data["pose"] = _pose_data(placed)
        rgba = self._rgba(filled)
        if rgba:
            data["color"] = list(rgba)
        volume = _volume(data)
        mass = self.number(filled, "mass", _POSITIVE, 0.0)
        mass = mass or volume * self.number(filled, "density", _POSITIVE, _DENSITY)
        if volume > 0.0 and mass > 0.0:
            data["density"] = min(max(mass / volume / _DENSITY, 1e-3), 1e3)
        bodies.parts[name] = data
        bodies.geoms[name] = geom, placed
        bodies.masses[name] = mass
        if moved_by:
            bodies.joints[moved_by]["parts"].append(name)

    def _rgba(self, geom: Element) -> tuple[float, ...]:
        material = geom.attributes.get("material")
        if material is not None and material not in self._materials:
            hint = suggestion(material, self._materials, "material")
            self.add(geom, f"there is no material '{material}'", hint, "material")
        elif material is not None and "rgba" not in geom.attributes:
            return self._numbers_of(self._materials[material], "rgba", (3, 4), _SHARE)
        return self._numbers_of(geom, "rgba", (3, 4), _SHARE)

    def _shape(self, geom: Element) -> tuple[dict[str, Any], Pose] | None:  # Any: fields of a spec
        """Shape with its size, and its pose in the body; None after a problem."""
        kind = geom.attributes.get("type", "mesh" if "mesh" in geom.attributes else "sphere")
        if kind not in _SHAPES or kind == "plane":
            hint = f"allowed: {', '.join(one for one in _SHAPES if one != 'plane')}"
            self.add(geom, f"a geom of a body cannot be a '{kind}'", hint, "type")
            return None
        if kind == "mesh":
            return self._mesh(geom)
        pose = self._pose(geom)
        half = self._numbers_of(geom, "size", (1, 2, 3), _SIZE)
        ends = self._numbers_of(geom, "fromto", (6,), _LENGTH)
        if ends:
            start, end = np.array(ends[:3]), np.array(ends[3:])
            length = float(np.linalg.norm(end - start))
            if kind not in ("capsule", "cylinder") or length < 1e-6 or not half:
                message = "fromto is for capsules and cylinders with a size, of some length"
                self.add(geom, message, "", "fromto")
                return None
            pose = Pose.from_axes(0.5 * (start + end), _onto((end - start) / length).tolist())
            half = (half[0], 0.5 * length)
        if not half and "size" in geom.attributes:
            return None  # reported already
        wanted = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}[kind]
        if len(half) < wanted or min(half[:wanted], default=0.0) <= 0.0:
            self.add(geom, f"a {kind} needs a size of {wanted} positive numbers", "", "size")
            return None
        if kind in ("box", "ellipsoid"):
            size = [2.0 * one for one in half[:3]]
        else:
            size = [half[0]] if kind == "sphere" else [half[0], 2.0 * half[1]]
        return {"shape": kind, "size": size}, pose

    def _mesh_name(self, mesh: Element) -> str:
        file = mesh.attributes.get("file", "")
        return mesh.attributes.get("name", file.rpartition("/")[2].rpartition(".")[0])

    def _mesh(self, geom: Element) -> tuple[dict[str, Any], Pose] | None:  # Any: fields of a spec
        name = geom.attributes.get("mesh", "")
        mesh = self._meshes.get(name)
        if mesh is None:
            hint = suggestion(name, self._meshes, "mesh")
            self.add(geom, f"there is no mesh '{name}'", hint, "mesh")
            return None
        scale = self._numbers_of(mesh, "scale", (3,), Range(0.0, 1e3, above=True)) or (1.0,)
        if max(scale) - min(scale) > 1e-9:
            self.add(mesh, "a mesh has one scale for all directions", "", "scale")
        file = mesh.attributes.get("file")
        if file is None:
            self.add(mesh, "<mesh> lacks the attribute 'file'")
            return None
        path = f"{self._folder.rstrip('/')}/{file}" if self._folder else file
        return {"shape": "mesh", "file": path, "scale": scale[0]}, self._pose(geom)

    # Fixtures

    def _finish(self, element: Element, name: str, pose: Pose, bodies: _Bodies) -> None:
        """Add a fixture: one shape about its center as such, everything else as a compound."""
        data: dict[str, Any] = {"fixed": not bodies.is_free}
        moved = {part for joint in bodies.joints.values() for part in joint["parts"]}
        if len(bodies.parts) > MOST_PARTS or len(bodies.joints) > MOST_JOINTS:
            message = (
                f"{counted(len(bodies.parts), 'geom')} and {counted(len(bodies.joints), 'joint')}"
            )
            self.add(element, f"{message}; at most {MOST_PARTS} and {MOST_JOINTS} in one body")
        for key, joint in list(bodies.joints.items()):
            joint["mass"] = min(max(sum(bodies.masses[one] for one in joint["parts"]), 1e-3), 1e3)
            if not joint["parts"]:
                self.add(element, f"joint '{key}' moves no geom that can be touched")
        first = next(iter(bodies.parts.values()), None)
        meshes = [one for one in bodies.parts.values() if one["shape"] == "mesh"]
        if meshes and len(bodies.parts) > 1:
            self.add(element, f"'{name}' has a mesh and other geoms", "use a body for each")
            return
        total = sum(mass for part, mass in bodies.masses.items() if part not in moved)
        inertial = element.find("inertial")
        if inertial is not None:
            total = self.number(inertial, "mass", _POSITIVE)
        data["mass"] = min(max(total, 1e-4), 1e3)
        friction = [
            self._numbers_of(self._with_class(geom, "main"), "friction", (1, 2, 3), _POSITIVE)
            for geom, _ in bodies.geoms.values()
        ]
        data["friction"] = next((one[0] for one in friction if one), 1.0)
        if first is not None and len(bodies.parts) == 1 and not bodies.joints:
            shape = {key: one for key, one in first.items() if key not in ("pose", "density")}
            _, placed = next(iter(bodies.geoms.values()))
            data |= shape | {"pose": _pose_data(pose @ placed)}
        else:
            data |= {"shape": "compound", "parts": bodies.parts, "pose": _pose_data(pose)}
            if bodies.joints:
                data["joints"] = bodies.joints
        self.fixtures[name] = data
        self.elements[name] = element
        self.spans[("fixtures", name)] = self._span(element)
        for part, (geom, _) in bodies.geoms.items():
            self.spans[("fixtures", name, "parts", part)] = self._span(geom)

    @staticmethod
    def _span(element: Element) -> Span:
        place = element.place()
        line = (place.line or 1) - 1
        column = (place.column or 1) - 1
        return Span(line, column, line, column + place.width)

    def _camera(self, camera: Element, frame: Pose, number: int) -> None:
        """A camera looks along -z with y up; mounts of cameras along z, with y down."""
        name = camera.attributes.get("name", f"camera{number}")
        if not is_name(name) or name in self.cameras:
            self.add(camera, f"'{name}' cannot be the name of a camera", "", "name")
        if len(self.cameras) >= MOST_CAMERAS:
            self.add(camera, f"more than {MOST_CAMERAS} cameras")
        flip = Pose.from_rpy((0, 0, 0), (math.pi, 0, 0))
        self.cameras[name] = _pose_data(frame @ self._pose(camera) @ flip)


def _unit(values: npt.ArrayLike) -> Vector:
    vector: Vector = np.array(values, float)
    length = float(np.linalg.norm(vector))
    if length < 1e-9:
        raise ValueError("a direction or quaternion has the length 0")
    unit: Vector = vector / length
    return unit


def _about(axis: npt.ArrayLike, angle: float) -> Matrix:
    """Rotation matrix about a unit vector by an angle in rad."""
    half = 0.5 * angle
    turn = np.array((math.cos(half), *(math.sin(half) * np.asarray(axis))))
    return Pose(np.zeros(3), turn).rotation_matrix


def _onto(direction: Vector) -> Matrix:
    """Rotation matrix of the smallest rotation that brings z onto a unit vector."""
    axis = np.cross((0.0, 0.0, 1.0), direction)
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        return np.eye(3) if direction[2] > 0 else np.diag((1.0, -1.0, -1.0))
    return _about(axis / length, math.atan2(length, float(direction[2])))


def _rounded(values: Iterable[float]) -> list[float]:
    return [round(float(one), 12) + 0.0 for one in values]


def _pose_data(pose: Pose) -> dict[str, Data]:
    x, y, z = _rounded(pose.position)
    return {"xyz": [x, y, z], "quat": [float(one) for one in pose.quaternion]}


def _volume(data: Mapping[str, Any]) -> float:  # Any: fields of a spec
    """Volume of a part, m³; 0 for a mesh."""
    size: list[float] = data.get("size", [])
    shape = data["shape"]
    if shape in ("box", "ellipsoid"):
        return (1.0 if shape == "box" else math.pi / 6.0) * math.prod(size)
    if shape == "sphere":
        return float(4.0 / 3.0 * math.pi * size[0] ** 3)
    if shape == "mesh":
        return 0.0
    ends = 4.0 / 3.0 * size[0] if shape == "capsule" else 0.0
    return math.pi * size[0] ** 2 * (size[1] + ends)
