"""Models of a tree file: world, objects, arms, cameras, and model mismatch (`reality`).

Fields have the units of the file, meters, seconds and degrees; properties are in SI. Reality is how
far the simulated arm, sensors and drives deviate from the nominal model. Each uncertainty is
sampled with the seed, once for each arm: a seed is one robot of the batch.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Final, Literal, Self, TypeAlias

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    InstanceOf,
    JsonValue,
    PrivateAttr,
    StringConstraints,
    Tag,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from bt_dualarm.spec.cell import CellSpec
from bt_dualarm.spec.colors import ObjectColor, rgba_of
from bt_dualarm.spec.faults import Faults, FaultSpec
from bt_dualarm.spec.goals import Conditions
from bt_dualarm.spec.joints import MOST_JOINTS, Articulation, PartJoint, moved_name, refuse_joints
from bt_dualarm.spec.many import MOST_OBJECTS, Group, ManySpec, members
from bt_dualarm.spec.node_types import NodeSpec, one_line, port
from bt_dualarm.spec.problems import BodyName, Name, Problem, written_as
from bt_dualarm.spec.shapes import (
    SIZE_IN_WORDS,
    WALL_IN_WORDS,
    Length,
    ObjectShape,
    PartSpec,
    has_round_top,
    refuse_size,
    room_on_top,
)
from bt_dualarm.spec.texture import TextureSpec
from bt_dualarm.spec.values import (
    Bend,
    Degrees,
    Duration,
    JointPosition,
    MarkerSpec,
    Meters,
    PoseSpec,
    RelativePath,
    Seconds,
    Share,
    Speed,
    Uncertainty,
    Value,
    below_tree,
)
from bt_dualarm.spec.yaml_reader import Data, DataPath, Source

RealityName: TypeAlias = Literal["ideal", "lab", "rough"]

REALITY_NAMES: Final[tuple[RealityName, ...]] = ("ideal", "lab", "rough")
"""Names of the sets, from the nominal model to a neglected robot."""

_EXACT: Final = Uncertainty()


class LinkErrors(Value):
    """Errors of the links against the robot's description."""

    mass: Share = port(_EXACT, "Relative error of a link's mass, sampled per link")
    inertia: Share = port(
        _EXACT, "Relative error of a link's moments of inertia, in addition to that of its mass"
    )
    center: Meters = port(_EXACT, "Offset of a link's center of mass along each axis", unit="m")
    rotor: bool = port(
        False,
        "Whether joints have the reflected inertia of their motors, which URDFs leave out; with "
        "the relative error of other inertia",
    )


class PayloadErrors(Value):
    """Errors of a held object against the file; the world's hold for the masses of objects."""

    known: bool = port(True, "Whether the controller knows mass and center of a held object")
    mass: Share = port(_EXACT, "Relative error of an object's mass")
    center: Meters = port(_EXACT, "Offset of an object's center of mass along each axis", unit="m")


class FrictionErrors(Value):
    """Friction of the joints as in the robot's description, and its errors."""

    present: bool = port(False, "Whether the joints have friction")
    coulomb: Share = port(_EXACT, "Relative error of the dry friction, sampled per joint")
    viscous: Share = port(_EXACT, "Relative error of the viscous friction, sampled per joint")
    most: float = port(
        1.0, "Largest dry friction, as a fraction of the joint's effort limit", ge=0.0, le=1.0
    )


class EncoderErrors(Value):
    """Errors of the joints' encoders, and the filter that derives velocities."""

    resolution: float = port(0.0, "Resolution of a reading; 0: exact", unit="deg", ge=0.0, le=1.0)
    noise: float = port(
        0.0, "Standard deviation of the noise of a reading", unit="deg", ge=0.0, le=1.0
    )
    window: Duration = port(
        0.0,
        "Time between the two readings whose difference gives a velocity; 0: exact velocity",
        le=0.1,
    )
    cutoff: float = port(
        0.0,
        "Corner frequency of the velocity's low-pass filter; 0: no filter",
        unit="Hz",
        ge=0.0,
        le=1e4,
    )


class DriveErrors(Value):
    """Dynamics and errors of the drives between a commanded torque and the joint."""

    delay: Duration = port(0.0, "Delay from commanding a torque to its effect", le=0.05)
    bandwidth: float = port(
        0.0, "Corner frequency of the drive's first-order lag; 0: no lag", unit="Hz", ge=0.0, le=1e5
    )
    quantum: float = port(
        0.0, "Resolution of a torque, as a fraction of the effort limit; 0: exact", ge=0.0, le=0.1
    )
    gain: Share = port(_EXACT, "Relative error of a joint's torque, sampled per joint")


class CameraErrors(Value):
    """Errors of a camera against its calibration, and noise and blur of its images."""

    position: Meters = port(_EXACT, "Offset of the camera along each of its axes", unit="m")
    rotation: Degrees = port(_EXACT, "Rotation of the camera about each of its axes", unit="deg")
    focal: Share = port(_EXACT, "Relative error of the focal length")
    stamp: Seconds = port(_EXACT, "Offset of the clock of its time stamps", unit="s")
    noise: float = port(
        0.0, "Standard deviation of a pixel's noise, of 255 levels", ge=0.0, le=100.0
    )
    light: Share = port(_EXACT, "Relative change of the brightness, sampled per image")
    exposure: Duration = port(
        0.0,
        "Exposure time, centered on the time stamp; causes motion blur",
        le=0.1,
    )
    k1: Bend = port(
        _EXACT, "Radial distortion that the calibration does not know: OpenCV's coefficient k1"
    )
    k2: Bend = port(_EXACT, "The same, OpenCV's coefficient k2")


class RealityErrors(Value):
    """Resolved model mismatch of an arm, with a value for every field."""

    links: LinkErrors = LinkErrors()
    payload: PayloadErrors = PayloadErrors()
    friction: FrictionErrors = FrictionErrors()
    encoder: EncoderErrors = EncoderErrors()
    drive: DriveErrors = DriveErrors()
    camera: CameraErrors = CameraErrors()


class RealitySpec(Value):
    """Model mismatch: a set, and the fields that differ from it."""

    set: RealityName | None = port(
        None,
        "Set that provides the other fields; by default that of the world, or `ideal` there",
    )
    links: LinkErrors = port(LinkErrors(), "Masses and inertias of the links")
    payload: PayloadErrors = port(PayloadErrors(), "A held object")
    friction: FrictionErrors = port(FrictionErrors(), "Friction of the joints")
    encoder: EncoderErrors = port(EncoderErrors(), "Encoders of the joints")
    drive: DriveErrors = port(DriveErrors(), "Drives of the joints")
    camera: CameraErrors = port(CameraErrors(), "The camera")

    def over(self, base: RealityErrors) -> RealityErrors:
        """Returns ``base`` with the fields that were given here."""
        merged: dict[str, BaseModel] = {}
        for name in self.model_fields_set - {"set"}:
            given: BaseModel = getattr(self, name)
            part: BaseModel = getattr(base, name)
            changed = {field: getattr(given, field) for field in given.model_fields_set}
            merged[name] = part.model_copy(update=changed)
        return base.model_copy(update=merged)


Reality: TypeAlias = Annotated[
    Annotated[RealityName, Tag("name")] | Annotated[RealitySpec, Tag("value")],
    Discriminator(written_as),
]
"""Name of a set, or a set with the fields that differ from it."""


def resolved(
    world: Reality, arm: Reality | None, sets: Mapping[str, RealityErrors]
) -> RealityErrors:
    """Returns the model mismatch of an arm: the world's, with the arm's own over it.

    Args:
        world: Model mismatch of the world.
        arm: Model mismatch of the arm, None if it has none of its own.
        sets: Sets by name.
    """
    base = sets["ideal"]
    for given in (world, arm):
        if isinstance(given, str):
            base = sets[given]
        elif given is not None:
            base = given.over(base if given.set is None else sets[given.set])
    return base


# Sets by name; docs/reality.md has the source or the reason of each number.


_LAB: Final = RealityErrors(
    links=LinkErrors(
        mass=Uncertainty(uniform=0.05),
        inertia=Uncertainty(uniform=0.05),
        center=Uncertainty(uniform=0.002),
        rotor=True,
    ),
    payload=PayloadErrors(
        known=True, mass=Uncertainty(uniform=0.02), center=Uncertainty(uniform=0.002)
    ),
    friction=FrictionErrors(
        present=True, coulomb=Uncertainty(uniform=0.3), viscous=Uncertainty(uniform=0.3), most=0.07
    ),
    encoder=EncoderErrors(resolution=360 / 2**19, noise=3e-4, window=0.004, cutoff=80.0),
    drive=DriveErrors(
        delay=0.001, bandwidth=500.0, quantum=1 / 2**12, gain=Uncertainty(uniform=0.02)
    ),
    camera=CameraErrors(
        position=Uncertainty(uniform=0.001),
        rotation=Uncertainty(uniform=0.3),
        focal=Uncertainty(uniform=0.002),
        stamp=Uncertainty(uniform=0.0005),
        noise=2.0,
        light=Uncertainty(uniform=0.02),
        exposure=0.004,
        k1=Uncertainty(uniform=0.005),
        k2=Uncertainty(uniform=0.01),
    ),
)

_ROUGH: Final = RealityErrors(
    links=LinkErrors(
        mass=Uncertainty(uniform=0.2),
        inertia=Uncertainty(uniform=0.2),
        center=Uncertainty(uniform=0.005),
        rotor=True,
    ),
    payload=PayloadErrors(
        known=False, mass=Uncertainty(uniform=0.1), center=Uncertainty(uniform=0.005)
    ),
    friction=FrictionErrors(
        present=True, coulomb=Uncertainty(uniform=0.6), viscous=Uncertainty(uniform=0.6), most=0.07
    ),
    encoder=EncoderErrors(resolution=360 / 2**17, noise=1e-3, window=0.004, cutoff=80.0),
    drive=DriveErrors(
        delay=0.003, bandwidth=200.0, quantum=1 / 2**10, gain=Uncertainty(uniform=0.05)
    ),
    camera=CameraErrors(
        position=Uncertainty(uniform=0.003),
        rotation=Uncertainty(uniform=1.0),
        focal=Uncertainty(uniform=0.01),
        stamp=Uncertainty(uniform=0.002),
        noise=5.0,
        light=Uncertainty(uniform=0.1),
        exposure=0.01,
        k1=Uncertainty(uniform=0.02),
        k2=Uncertainty(uniform=0.03),
    ),
)

REALITY_SETS: Final[Mapping[str, RealityErrors]] = {
    "ideal": RealityErrors(),
    "lab": _LAB,
    "rough": _ROUGH,
}
"""Sets by name: the nominal model, a well-kept robot, a neglected one."""


class CollisionSpec(Value):
    """Reaction of an arm to a collision, which is detected by the torques of its joints."""

    stop: bool = port(False, "Whether its motion ends with `COLLISION` and a short retreat")
    threshold: float = port(
        1.0, "Factor on the torques that count as a collision", ge=0.2, le=1000.0
    )


MOST_UNDER_WAY_MB: Final = 100.0
"""Largest size in MB of a camera's images that are taken and not delivered yet."""

_MB_A_PIXEL: Final = 3e-6
_Pixels: TypeAlias = Annotated[int, Field(ge=16, le=1920)]


class CameraSpec(Value):
    """An arm's camera."""

    mount: Annotated[
        Annotated[Name, Tag("name")] | Annotated[PoseSpec, Tag("value")],
        Discriminator(written_as),
    ] = port(
        "wrist",
        "A mount of the robot's description, or a pose fixed in the world (OpenCV's frame: "
        "x right, y down, z forward)",
    )
    resolution: tuple[_Pixels, _Pixels] = port((320, 240), "Width and height", unit="px")
    fov: float = port(50.0, "Vertical field of view", unit="deg", ge=5.0, le=150.0)
    fps: float = port(30.0, "Frames per simulated second", unit="Hz", ge=0.1, le=1000.0)
    latency: Duration = port(0.0, "Time from a frame's capture to its delivery", le=10.0)
    drop: float = port(0.0, "Fraction of lost frames", ge=0.0, le=0.9)
    noise: float = port(
        0.0,
        "Standard deviation along x and y of an unmeasured camera shake, which shifts each image "
        "as a whole",
        unit="px",
        ge=0.0,
        le=20.0,
    )

    @field_validator("latency")
    @classmethod
    def _pictures_under_way_are_bounded(cls, latency: float, info: ValidationInfo) -> float:
        # Fields that are declared before this one, and valid, are in `info.data`.
        if "resolution" in info.data and "fps" in info.data:
            (width, height) = info.data["resolution"]
            fps = info.data["fps"]
            picture_mb = _MB_A_PIXEL * width * height
            if latency * fps * picture_mb > MOST_UNDER_WAY_MB:
                allowed = math.floor(1e3 * MOST_UNDER_WAY_MB / picture_mb / fps)
                raise ValueError(
                    f"{latency:g} s at {fps:g} Hz keep {latency * fps:.0f} images of "
                    f"{width} x {height} px in transit, {latency * fps * picture_mb:.0f} MB; at "
                    f"most {MOST_UNDER_WAY_MB:g} MB: here {allowed} ms"
                )
        return latency

    @property
    def fov_rad(self) -> float:
        """Vertical field of view in radians."""
        return math.radians(self.fov)


_NONE: Final = "none"
_FORM: Final = 'as in gripper: {value: "{grasp}", cases: {fingers: robotiq_2f85, attach: none}}'
_GRIPPER: Final = {"type": "string", "minLength": 1, "maxLength": 200}


def _chosen_case(given: Data) -> Data:
    """Returns the gripper of the case that equals the value; other data as they are."""
    if isinstance(given, dict):
        if given.keys() != {"value", "cases"} or not isinstance(given["cases"], dict):
            raise ValueError(f"expected a gripper, or a value and cases, {_FORM}")
        value = given["value"]
        cases = given["cases"]
        if not isinstance(value, str) or value not in cases:
            raise ValueError(f"no case for {value!r}; cases: {', '.join(cases)}")
        given = cases[value]
        if not isinstance(given, str):
            raise ValueError(f"case {value!r}: expected the name of a gripper or none, {_FORM}")
    return None if given == _NONE else given


Mounted: TypeAlias = Annotated[
    Annotated[str, StringConstraints(min_length=1, max_length=200)] | None,
    BeforeValidator(_chosen_case),
    WithJsonSchema(
        {
            "anyOf": [
                _GRIPPER,
                {
                    "type": "object",
                    "properties": {
                        "value": {"type": "string"},
                        "cases": {"type": "object", "additionalProperties": _GRIPPER},
                    },
                    "required": ["value", "cases"],
                    "additionalProperties": False,
                },
                {"type": "null"},
            ]
        }
    ),
]
"""Name or path of a gripper description, None for no gripper; a parameter may choose it."""


LONGEST_NAME: Final = 100
"""Largest number of characters in the name of a task."""

_HalfWidth: TypeAlias = Annotated[float, Field(ge=0.0, le=10.0)]


SceneName: TypeAlias = Annotated[
    str,
    StringConstraints(
        max_length=200, pattern=r"^([A-Za-z][A-Za-z0-9_-]{0,47}|.{1,190}\.(ya?ml|xml))$"
    ),
]
"""Name of a shipped scene, or path of a scene file."""


class WorldSpec(Value):
    """The world and its clock."""

    scene: SceneName = port(
        "table",
        "Scene that is shipped, by name, or path of a scene file (`scenes/cell.yaml`) or of a file "
        "in MJCF (`scenes/cell.xml`), relative to the tree file",
    )
    seed: int = port(0, "Random seed", ge=0, lt=2**32)
    timestep: float = port(0.002, "Physics time step", unit="s", ge=1e-4, le=0.004)
    renderer: Literal["auto", "gl", "ray"] = port(
        "ray",
        "Camera renderer; `ray` gives the same images on every machine, `auto` uses OpenGL if "
        "available",
    )
    time_limit: Duration = port(
        600.0, "Simulated time after which the run ends as failed", ge=0.001, le=86400.0
    )
    reality: Reality = port(
        "ideal", "Model mismatch: how far the simulated arms deviate from their nominal models"
    )


class NoiseSpec(Value):
    """Bounds of the random offset of an object's initial pose, sampled with the seed."""

    xyz: tuple[_HalfWidth, _HalfWidth, _HalfWidth] = port(
        (0.0, 0.0, 0.0), "Half-widths of uniform offsets along the world's axes", unit="m"
    )
    yaw: float = port(
        0.0, "Half-width of a uniform rotation about the vertical", unit="deg", ge=0.0, le=180.0
    )


MeshFile: TypeAlias = Annotated[
    RelativePath, AfterValidator(below_tree("an STL or OBJ file", ".stl", ".obj"))
]
"""Path of a mesh relative to the tree file."""

MOST_PARTS: Final = 32
"""Largest number of parts of a compound object."""


_FIXED_KG: Final = 1.0
"""Mass of a fixed object that has none in the file; it has no effect."""


def _with_mass_if_it_moves(schema: dict[str, JsonValue]) -> None:
    """The rule on `mass`, for editors."""
    required = schema["required"]
    assert isinstance(required, list)  # noqa: S101 - of a model with required fields
    if "mass" in required:  # not of a fixture, which has a default
        required.remove("mass")
        is_fixed: JsonValue = {"properties": {"fixed": {"const": True}}, "required": ["fixed"]}
        schema["anyOf"] = [{"required": ["mass"]}, is_fixed]


class ObjectSpec(Value):
    """An object in the world."""

    shape: ObjectShape = port(..., "Shape, which determines the meaning of `size`")
    size: tuple[Length, ...] = port((), SIZE_IN_WORDS, unit="m", max_length=3)
    wall: float | None = port(None, WALL_IN_WORDS, unit="m", ge=5e-4, le=0.2)
    sides: int | None = port(None, "Number of sides of a prism; by default 6", ge=3, le=32)
    boards: int | None = port(None, "Number of boards of a shelf; by default 3", ge=2, le=12)
    parts: Annotated[dict[Name, PartSpec], Field(max_length=MOST_PARTS)] = port(
        {}, "Parts of a compound by name, in its frame"
    )
    joints: Annotated[dict[Name, PartJoint], Field(max_length=MOST_JOINTS)] = port(
        {}, "Joints between the parts of a compound, by name"
    )
    file: MeshFile | None = port(
        None, "STL or OBJ file of a mesh, below the folder of the tree file"
    )
    scale: float = port(1.0, "Length in meters of a unit of the mesh", unit="m", ge=1e-6, le=1e3)
    mass: float = port(
        ...,
        "Mass, evenly distributed; may be left out if it is fixed",
        unit="kg",
        ge=1e-4,
        le=1000.0,
    )
    friction: float = port(0.8, "Coefficient of sliding friction", ge=0.0, le=10.0)
    color: ObjectColor = port(
        "gray", "Color by name, or as red, green, blue (, opacity) from 0 to 1"
    )
    texture: TextureSpec | None = port(
        None, "Pattern or image on its surface; of a compound, on all parts that have none"
    )
    pose: PoseSpec = port(
        PoseSpec(xyz=(0.0, 0.0, 0.0)),
        "Pose of its center in the world; of a compound or mesh, pose of its frame",
    )
    noise: NoiseSpec = port(NoiseSpec(), "Bounds within which the seed may move it")
    many: ManySpec | None = port(
        None, "Numbers, places, sizes and colors, if the entry stands for several objects"
    )
    marker: MarkerSpec | None = port(None, "Marker on its top face, if it has one")
    spawned: bool = port(True, "Whether it is in the world from the start")
    fixed: bool = port(False, "Whether it is fixed in the world")

    model_config = ConfigDict(json_schema_extra=_with_mass_if_it_moves)

    _folder: Path = PrivateAttr(default=Path())
    _joint: Articulation | None = PrivateAttr(default=None)
    _moved: tuple[ObjectSpec, ...] = PrivateAttr(default=())

    @model_validator(mode="before")
    @classmethod
    def _fixed_without_mass(cls, given: object) -> object:
        """What is fixed needs no mass: nothing moves it."""
        if isinstance(given, Mapping) and given.get("fixed") is True and "mass" not in given:
            return {**given, "mass": _FIXED_KG}
        return given

    def hang(self, joint: Articulation) -> None:
        """Sets the joint by which it hangs on the other parts of its compound."""
        self._joint = joint

    @property
    def joint(self) -> Articulation | None:
        """Joint by which it hangs on the other parts of its compound; None for other objects."""
        return self._joint

    def carry(self, moved: tuple[ObjectSpec, ...]) -> None:
        """Sets what its joints move, each an object of its own."""
        self._moved = moved

    @property
    def moved(self) -> tuple[ObjectSpec, ...]:
        """What its joints move, each an object of its own; an arm that holds it carries them."""
        return self._moved

    @property
    def total_mass(self) -> float:
        """Mass of the object and of what its joints move, kg."""
        return self.mass + sum(obj.mass for obj in self._moved)

    @property
    def is_free(self) -> bool:
        """Whether it can be anywhere: it is neither fixed nor moves on a joint."""
        return not self.fixed and self._joint is None

    def look_in(self, folder: Path) -> None:
        """Sets the folder from which the paths of a mesh and of images start."""
        self._folder = folder
        for _, texture in self.textures:
            texture.look_in(folder)

    def anchor(self) -> None:
        """Makes that folder absolute, so that a change of the working directory has no effect."""
        self.look_in(self._folder.absolute())

    @property
    def textures(self) -> tuple[tuple[DataPath, TextureSpec], ...]:
        """Its textures and those of its parts, with their paths in the object's entry."""
        own = [] if self.texture is None else [(("texture",), self.texture)]
        of_parts = [
            (("parts", name, "texture"), part.texture)
            for name, part in self.parts.items()
            if part.texture is not None
        ]
        return (*own, *of_parts)

    def texture_of(self, part: str) -> TextureSpec | None:
        """Returns the texture of a part of a compound, or of an object; None if it has none.

        Args:
            part: Name of the part; empty for an object without parts.
        """
        own = self.parts[part].texture if part in self.parts else None
        return own or self.texture

    @property
    def mesh_path(self) -> Path:
        """Path of the file of a mesh."""
        return self._folder / (self.file or "")

    @model_validator(mode="after")
    def _size_fits_shape(self) -> ObjectSpec:
        if self.parts and self.shape != "compound":
            raise ValueError(f"only a compound has parts; the shape is '{self.shape}'")
        if (self.file or self.scale != 1.0) and self.shape != "mesh":
            raise ValueError(f"only a mesh has a file and a scale; the shape is '{self.shape}'")
        if self.shape != "compound" and self.shape != "mesh":
            refuse_size(self.shape, self)
            return self
        of_another = {"compound": "its parts have", "mesh": "its file determines it"}[self.shape]
        for field in ("size", "wall", "sides", "boards"):
            if getattr(self, field):
                raise ValueError(f"a {self.shape} has no {field}: {of_another}")
        if self.shape == "compound" and not self.parts:
            raise ValueError("a compound needs parts: {NAME: {shape: …, size: …, pose: …}, …}")
        if self.shape == "mesh" and not self.file:
            raise ValueError("a mesh needs file: the path of an STL or OBJ file")
        return self

    @model_validator(mode="after")
    def _joints_fit(self) -> ObjectSpec:
        if not self.joints:
            return self
        if self.shape != "compound":
            raise ValueError(f"only a compound has joints; the shape is '{self.shape}'")
        if not self.fixed:
            blind = [name for name, joint in self.joints.items() if not joint.sensor]
            if blind:
                raise ValueError(
                    f"joint '{blind[0]}' needs its sensor, or 'fixed: true': of an object that is "
                    "not fixed, an arm cannot tell a lid that opens from a box that slides"
                )
        if self.many is not None:
            raise ValueError("an object with joints cannot be 'many': write an entry for each")
        refuse_joints(self.joints, self.parts)
        return self

    @model_validator(mode="after")
    def _sizes_fit_shape(self) -> ObjectSpec:
        if self.many is not None and self.many.sizes is not None:
            if self.shape == "compound" or self.shape == "mesh":
                raise ValueError(f"many: a {self.shape} has no sizes")
            for size in self.many.sizes:
                refuse_size(
                    self.shape, SimpleNamespace(size=size, wall=self.wall, sides=None, boards=None)
                )
        return self

    @model_validator(mode="after")
    def _marker_fits(self) -> ObjectSpec:
        if self.marker is not None:
            if has_round_top(self.shape):
                raise ValueError(f"a {self.shape} has no face for a marker")
            room = room_on_top(self.shape, self)
            if self.marker.outer_size > room + 1e-9:
                raise ValueError(
                    f"its marker takes {1e3 * self.marker.outer_size:.1f} mm with the white around "
                    f"it; its top has {1e3 * room:.1f} mm"
                )
        return self

    @property
    def rgba(self) -> tuple[float, float, float, float]:
        """Red, green, blue, opacity from 0 to 1."""
        return rgba_of(self.color)


def expanded(
    objects: Mapping[str, ObjectSpec],
) -> tuple[dict[str, ObjectSpec], tuple[Group, ...], list[tuple[str, str]]]:
    """Returns the objects of a file with every member of a group and joint, and the groups.

    The third value is the entries with errors: name and message.
    """
    found: dict[str, ObjectSpec] = {}
    groups: list[Group] = []
    wrong: list[tuple[str, str]] = []
    for entry, obj in objects.items():
        if obj.many is None:
            found |= _split(entry, obj)
            continue
        group = Group(entry, members(entry, obj.many.count), obj.many)
        groups.append(group)
        for name in group.names:
            if name in objects or name in found:
                message = f"'{name}' is already the name of an object: rename one of the entries"
                wrong.append((entry, message))
            found[name] = obj.model_copy(update={"many": None})
    if groups and len(found) > MOST_OBJECTS:
        message = f"with it, the file has {len(found)} objects; at most {MOST_OBJECTS} are allowed"
        wrong.append((groups[-1].entry, message))
    return found, tuple(groups), wrong


def _split(name: str, obj: ObjectSpec) -> dict[str, ObjectSpec]:
    """Returns an object and what its joints move, each an object of its own, by name."""
    if not obj.joints:
        return {name: obj}
    moved = {part for joint in obj.joints.values() for part in joint.parts}
    stays = {part: spec for part, spec in obj.parts.items() if part not in moved}
    found = {name: obj.model_copy(update={"parts": stays, "joints": {}})}
    for key, joint in obj.joints.items():
        parts = {part: obj.parts[part] for part in joint.parts}
        update = {"parts": parts, "joints": {}, "mass": joint.mass, "fixed": False}
        piece = obj.model_copy(update=update)
        piece.hang(Articulation(name, key, joint))
        found[moved_name(name, key)] = piece
    found[name].carry(tuple(piece for piece in found.values() if piece.joint is not None))
    return found


class FixtureSpec(ObjectSpec):
    """A fixture of a scene file: an object that is fixed by default."""

    mass: float = port(
        1.0, "Mass of one that is not fixed, evenly distributed", unit="kg", ge=1e-4, le=1000.0
    )
    fixed: bool = port(True, "Whether it is fixed in the world")


class LimitShares(Value):
    """Fractions of the robot's limits that an arm may use."""

    velocity: Speed = port(1.0, "Fraction of the joint velocity limits")
    acceleration: Speed = port(1.0, "Fraction of the joint acceleration limits")
    jerk: Speed = port(
        1.0,
        "Fraction of the joint jerk limits: less is smoother, and easier for a camera to track",
    )


class ArmSpec(Value):
    """An arm with its tree."""

    robot: str = port(
        ...,
        "Name in the catalog, or path of a robot description relative to the tree file",
        min_length=1,
        max_length=200,
    )
    gripper: Mounted = port(
        None,
        "Gripper in place of the robot's stock tool: name in the catalog, path of a gripper "
        "description relative to the tree file, or `none`; or by a parameter: "
        '`{value: "{grasp}", cases: {fingers: robotiq_2f85, attach: none}}`',
    )
    locked: Annotated[dict[str, JointPosition], Field(max_length=200)] = port(
        {},
        "Positions of the description's locked joints by name, in meters (prismatic) or degrees "
        "(revolute); by default as in the description. "
        "`{panda_finger_joint1: 0.04}` opens a Panda's stock fingers; the other finger follows",
    )
    base: PoseSpec = port(PoseSpec(xyz=(0.0, 0.0, 0.0)), "Pose of its base in the world")
    posture: Name = port("home", "Posture of the robot's description in which it starts")
    limits: LimitShares = port(
        LimitShares(), "Fractions of the robot's limits, for all motions of the arm"
    )
    reality: Reality | None = port(None, "Model mismatch of this arm; by default the world's")
    force_limit: float = port(
        280.0,
        "Largest sensed contact force; a motion that exceeds it fails",
        unit="N",
        ge=10.0,
        le=5000.0,
    )
    collision: CollisionSpec = port(CollisionSpec(), "Reaction to a collision")
    tick_hz: float = port(
        50.0, "Ticks of its tree per simulated second", unit="Hz", ge=0.1, le=1000.0
    )
    camera: CameraSpec | None = port(None, "Its camera, if it has one")
    spawned: bool = port(True, "Whether it is in the world from the start")
    removable: bool = port(
        False, "Whether a run may succeed if the arm was removed before its tree had ended"
    )
    last_life_counts: bool = port(
        False, "Whether a run may succeed if the arm had failed before it was spawned again"
    )
    tree: Annotated[InstanceOf[NodeSpec], WithJsonSchema({})] = port(..., "Root node of the tree")

    @property
    def carries_camera(self) -> bool:
        """Whether it has a camera that moves with it."""
        return self.camera is not None and isinstance(self.camera.mount, str)


class TreeContent(Value):
    """Content of a tree file.

    Attributes:
        name: Name of the task; by default that of the file.
        description: One-line description.
        world: World and its clock.
        objects: Objects in the world by name.
        cell: What the trees share.
        arms: Arms with their trees by name.
        goal: Conditions on the true world at the end, by name.
        always: Conditions that hold at all times; the first violation ends the run.
        never: Conditions that hold at no time.
        faults: Faults that are injected, by name.
    """

    name: Annotated[str, Field(min_length=1, max_length=LONGEST_NAME), AfterValidator(one_line)]
    description: Annotated[str, Field(max_length=500)] = ""
    world: WorldSpec = WorldSpec()
    objects: Annotated[dict[Name, ObjectSpec], Field(default_factory=dict, max_length=MOST_OBJECTS)]
    cell: CellSpec = CellSpec()
    arms: Annotated[dict[Name, ArmSpec], Field(min_length=1, max_length=16)]
    goal: Conditions = Field(default_factory=dict)
    always: Conditions = Field(default_factory=dict)
    never: Conditions = Field(default_factory=dict)
    faults: Faults = Field(default_factory=dict)


class TreeFile(TreeContent):
    """A tree file.

    Attributes:
        path: Path of the file; relative paths in it start from its folder.
        groups: Objects that stand for one entry, whose places the seed of a run determines.
        scene_source: Source of its scene file, if it has one.
        fixtures: Names of the objects that are declared there.
        texts: Texts of the file and of the files that it includes by path; Python data as JSON.
        given: Values of its parameters by name.
    """

    # What a joint moves is an object of its own.
    objects: Annotated[dict[BodyName, ObjectSpec], Field(default_factory=dict)]
    path: InstanceOf[Path] = Path()
    groups: InstanceOf[tuple[Group, ...]] = ()
    scene_source: InstanceOf[Source] | None = Field(default=None, repr=False)
    fixtures: frozenset[str] = frozenset()
    texts: Mapping[str, str] = Field(default_factory=dict, repr=False)
    given: Mapping[str, object] = Field(default_factory=dict, repr=False)

    _root: Path | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _objects_know_their_folder(self) -> Self:
        for obj in self.objects.values():
            obj.look_in(self.root)
        return self

    def anchor(self) -> None:
        """Makes `root` and the folders of objects absolute: see `ObjectSpec.anchor`."""
        self._root = self.root.absolute()
        for obj in self.objects.values():  # fixtures start from the folder of their scene
            obj.anchor()

    def in_reality(self, reality: Reality) -> TreeFile:
        """Returns the file with this model mismatch for all arms."""
        arms = {name: arm.model_copy(update={"reality": None}) for name, arm in self.arms.items()}
        world = self.world.model_copy(update={"reality": reality})
        return self.model_copy(update={"world": world, "arms": arms})

    def object_problem(
        self, source: Source, obj: str, field: str | DataPath, message: str
    ) -> Problem:
        """Returns the problem of an object, or of one of its fields if the file has it.

        Args:
            source: Source of the tree file.
            obj: Name of the object.
            field: Name of the field, or its path in the entry.
            message: The problem.
        """
        field = (field,) if isinstance(field, str) else field
        joint = self.objects[obj].joint if obj in self.objects else None
        entries = (group.entry for group in self.groups if obj in group.names)
        entry = next(entries, obj if joint is None else joint.owner)
        where: DataPath = ("objects", entry)
        if entry in self.fixtures and self.scene_source is not None:
            source = self.scene_source
            where = ("fixtures", entry)
        has_field = source.get((*where, *field)) is not None
        return source.problem((*where, *field) if has_field else where, message, key=not has_field)

    def with_faults(self, faults: Mapping[str, FaultSpec]) -> TreeFile:
        """Returns the file with these faults in addition to its own."""
        return self.model_copy(update={"faults": {**self.faults, **faults}})

    @property
    def texts_by_name(self) -> dict[str, str]:
        """Texts of the files below the file's folder, by their path relative to it."""
        return {
            Path(path).relative_to(self.path.parent).as_posix(): text
            for path, text in self.texts.items()
            if Path(path).is_relative_to(self.path.parent)
        }

    @property
    def root(self) -> Path:
        """Folder from which relative paths in the file start."""
        return self._root or self.path.parent
