"""Composition of the world's MjSpec: scenes, objects, markers, textures, arms, cameras, welds.

Functions add elements to, or remove them from, the `mujoco.MjSpec` that `World` compiles. `ArmBody`
finds an arm again in the compiled model.
"""

from __future__ import annotations

import difflib
import math
import zlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, NoReturn, Self, TypeVar

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.errors import (
    AbsentError,
    CatalogError,
    SpringError,
    WorldError,
    rounded_down,
)
from bt_dualarm.core.later import Later
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.core.share import share_dir
from bt_dualarm.robots.gripper import Gripper
from bt_dualarm.robots.mjspec import (
    GEOM_TYPES,
    OBJECT_GROUP,
    SCENE_GROUP,
    TOOL_SITE,
    add_gripper,
    chain_spec,
    half_sizes,
    robot_spec,
)
from bt_dualarm.robots.robot import Robot
from bt_dualarm.sim.arm_models import LinkFactors, SampledArm, inertia_per_mass
from bt_dualarm.sim.object_body import BodyPart, ObjectBody, body_of, body_of_part
from bt_dualarm.sim.shared_body import SharedBody
from bt_dualarm.sim.skins import TEXTURE_PREFIX, add_image, user_data
from bt_dualarm.spec.document import ArmSpec, CameraSpec, ObjectSpec, TreeFile, WorldSpec
from bt_dualarm.spec.joints import Articulation
from bt_dualarm.spec.scene import is_scene_path
from bt_dualarm.spec.values import MarkerSpec

if TYPE_CHECKING:
    import cv2
else:
    cv2 = Later("cv2")

# Mounting surfaces

_MAX_MOUNTING_GAP = 0.02  # m: a base this close to a surface is mounted on it
_UPRIGHT_COSINE = np.cos(np.radians(5))  # bases that tilt more get no pedestal


@dataclass(frozen=True)
class MountingSurface:
    """The surface that an arm's base is mounted on.

    Attributes:
        body: Name of the MuJoCo body that the surface belongs to.
        gap: Distance from the base down to the surface along the base's z axis, m.
        pedestal: Whether a pedestal has to fill the gap.
    """

    body: str
    gap: float
    pedestal: bool


def surface_below(model: mujoco.MjModel, data: mujoco.MjData, base: Pose) -> MountingSurface | None:
    """Find the surface under a base by a ray; None if there is none."""
    up: Vector = base.rotation_matrix[:, 2]
    geom = np.array([-1], dtype=np.int32)
    start = base.position + _MAX_MOUNTING_GAP * up  # the base may be slightly inside the surface
    distance = mujoco.mj_ray(model, data, start, -up, None, 1, -1, geom)
    if distance < 0:
        return None
    gap = distance - _MAX_MOUNTING_GAP
    body = model.body(model.geom_bodyid[geom[0]]).name
    return MountingSurface(
        body, gap, pedestal=bool(gap > _MAX_MOUNTING_GAP and up[2] > _UPRIGHT_COSINE)
    )


# Names

Part = TypeVar("Part")


def must_be_among(name: str, known: Collection[str], kind: str, where: str) -> None:
    """Refuse an unknown name: "no arm 'amr1' declared; did you mean 'arm1'?".

    Raises:
        WorldError: The name is not among the known ones.
    """
    if name not in known:
        raise WorldError(f"no {kind} {name!r} {where}{nearest(name, known)}")


class Present(dict[str, Part]):
    """Arms or objects that are in the world now, by name.

    They may be removed at any time, also while a skill uses them: subscripting with an absent name
    raises an `AbsentError`.

    Args:
        kind: What they are, in messages.
        code: Failure code of a skill that asks for an absent one.
        parts: Those that are present.
    """

    def __init__(self, kind: str, code: str, parts: Mapping[str, Part] | None = None) -> None:
        super().__init__(parts or {})
        self._kind = kind
        self._code = code

    def __missing__(self, name: str) -> NoReturn:
        """Called for an absent name."""
        # A tree names what its file declares: it is not misspelled, but removed or not yet there.
        present = ", ".join(sorted(self)) or "none"
        raise AbsentError(
            self._code, f"no {self._kind} {name!r} in the world (there are: {present})"
        )

    @classmethod
    def arms(cls, parts: Mapping[str, Part] | None = None) -> Self:
        """Parts of the arms that are present."""
        return cls("arm", "PARTNER_GONE", parts)

    @classmethod
    def objects(cls, parts: Mapping[str, Part] | None = None) -> Self:
        """Objects that are present, or what belongs to each."""
        return cls("object", "NOT_THERE", parts)

    def require(self, name: str) -> None:
        """Check that one is present.

        Raises:
            AbsentError: It is not.
        """
        if name not in self:
            self.__missing__(name)


def nearest(name: str, known: Collection[str]) -> str:
    """End of an error message: the closest known name, and all known names."""
    near = difflib.get_close_matches(name, known, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"{hint} (there are: {', '.join(sorted(known)) or 'none'})"


def name_of_geom(model: mujoco.MjModel, geom: int) -> str:
    """Name for messages of the object that a geom belongs to: a body, or a part of the scene."""
    body = model.body(model.geom_bodyid[geom])
    return str((body.name if body.id else model.geom(geom).name) or "the scene")


# Welds


_WELD_SOLREF = (0.004, 1.0)  # s, damping ratio: the stiffest that is stable at a 2 ms step
_WELD_SOLIMP = (0.9999, 0.9999, 0.001)
"""Impedance: share of a disturbing acceleration that the constraint cancels. With MuJoCo's default
of 0.9, a tenth of a wrist's torque turns the wrist without its load, whose inertia is a hundred
times the wrist's own, and shakes wide loads."""


def add_weld(
    spec: mujoco.MjSpec,
    name: str,
    body1: str,
    body2: str,
    relative: Pose,
    tips: Sequence[str] = (),
) -> None:
    """Weld two bodies and ignore contacts between them.

    Args:
        spec: MjSpec of the world.
        name: Name of the weld.
        body1: Name of the first body.
        body2: Name of the second body.
        relative: Pose of body2 in body1.
        tips: Further bodies whose contacts with body2 are ignored: the fingers that hold it.
    """
    weld = spec.add_equality(
        name=name,
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1=body1,
        name2=body2,
    )
    weld.solref = _WELD_SOLREF
    weld.solimp[:3] = _WELD_SOLIMP
    # eq_data of mjEQ_WELD: anchor in body2, relative pose, torque scale.
    weld.data[:11] = [0, 0, 0, *relative.position, *relative.quaternion, 1]
    spec.add_exclude(name=name, bodyname1=body1, bodyname2=body2)
    for tip in tips:
        spec.add_exclude(name=f"{name}+{tip}", bodyname1=tip, bodyname2=body2)


def remove_weld(spec: mujoco.MjSpec, name: str) -> None:
    """Undo :func:`add_weld`."""
    spec.delete(spec.equality(name))
    for exclude in list(spec.excludes):
        if exclude.name == name or exclude.name.startswith(f"{name}+"):
            spec.delete(exclude)


# Markers, as thin white and black boxes without contacts


BOARD_M: Final = 1e-4
"""Half the thickness of the white board; the black cells on top of it are as thick."""


def marker_dictionary(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary of markers for a name in tree files, such as ``aruco_4x4_50``."""
    dictionaries = {
        "aruco_4x4_50": cv2.aruco.DICT_4X4_50,
        "aruco_5x5_50": cv2.aruco.DICT_5X5_50,
        "aruco_6x6_50": cv2.aruco.DICT_6X6_50,
        "apriltag_16h5": cv2.aruco.DICT_APRILTAG_16h5,
        "apriltag_36h11": cv2.aruco.DICT_APRILTAG_36h11,
    }
    return cv2.aruco.getPredefinedDictionary(dictionaries[name])


def marker_height(obj: ObjectSpec) -> float:
    """Height of an object's marker above its center along its z axis, m."""
    return 0.5 * obj.size[-1] + 4 * BOARD_M


def add_marker(body: mujoco.MjsBody, obj: ObjectSpec) -> None:
    """Add the boxes of an object's marker to its body, if it has one."""
    marker = obj.marker
    if marker is None:
        return
    top = 0.5 * obj.size[-1]
    half = 0.5 * marker.outer_size
    _box(body, (0.0, 0.0, top + BOARD_M), (half, half, BOARD_M), 0.95)
    for x, y, wide, high in black_parts(marker):
        place = (x, y, top + 3 * BOARD_M)
        size = (wide / 2, high / 2, BOARD_M)
        _box(body, place, size, 0.02)


def black_parts(marker: MarkerSpec) -> Iterator[tuple[float, float, float, float]]:
    """Boxes that cover the black cells of a marker: center x and y, width and height, m.

    Black cells side by side in a row become one box, which keeps the number of geoms low. The
    marker's first corner is at -x, +y: seen from above it looks as printed.
    """
    count = marker.cells
    cell = marker.size / marker.cells
    dictionary = marker_dictionary(marker.dictionary)
    image = np.asarray(dictionary.generateImageMarker(marker.id, count))
    for row in range(count):
        column = 0
        while column < count:
            begin = column
            while column < count and image[row, column] == 0:
                column += 1
            if column > begin:
                x = (0.5 * (begin + column) - 0.5 * count) * cell
                yield x, (0.5 * count - row - 0.5) * cell, (column - begin) * cell, cell
            column += 1


def _box(
    body: mujoco.MjsBody,
    place: tuple[float, float, float],
    size: tuple[float, float, float],
    gray: float,
) -> None:
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=place,
        size=size,
        mass=0.0,
        contype=0,
        conaffinity=0,
        rgba=(gray, gray, gray, 1.0),
        group=OBJECT_GROUP,
    )


# Textures
#
# MuJoCo projects images along the z axis of a geom only. A texture is therefore described by user
# data of the geom, which the ray caster, the page and the OpenGL renderer read; see `sim/skins.py`.


def _add_texture(
    spec: mujoco.MjSpec, geom: mujoco.MjsGeom, obj: ObjectSpec, part: BodyPart
) -> None:
    """Give the geom of an object's convex part its texture, if it has one."""
    texture = obj.texture_of(part.name)
    if texture is None:
        return
    rgba = part.rgba or obj.rgba
    tile = texture.tile(rgba)
    name = f"{TEXTURE_PREFIX}{tile.name}"
    if spec.texture(name) is None:
        add_image(spec, name, tile.pixels)
    # The image has the colors already; MuJoCo multiplies it by that of the geom.
    geom.material = name
    geom.rgba = (1.0, 1.0, 1.0, rgba[3])
    frame = obj.parts[part.name].pose.pose if part.name in obj.parts else Pose.identity()
    body = body_of_part(obj.parts[part.name]) if part.name in obj.parts else body_of(obj)
    low, high = body.extents(np.eye(3))
    frame = frame @ Pose.from_rpy(tuple(0.5 * (low + high)))
    geom.userdata = user_data(tile.size, high - low, frame)


def _remove_unused_textures(spec: mujoco.MjSpec) -> None:
    used = {geom.material for geom in spec.geoms}
    for kind in (spec.materials, spec.textures):
        for element in [one for one in kind if one.name.startswith(TEXTURE_PREFIX)]:
            if element.name not in used:
                spec.delete(element)


# Objects


_CONDIM_ROLLING: Final = 6  # sliding, torsional and rolling friction
_TORSION: Final = 0.005  # m, MuJoCo's default
_ROLLING: Final = 0.1  # of the radius: a ball at 0.05 m/s rolls 15 mm, one at 0.3 m/s 140 mm
_NO_ROLLING: Final = 0.0001  # m, MuJoCo's default; has no effect on boxes
_UPRIGHT: Final = math.cos(math.radians(45))

_EXACTLY_UPRIGHT: Final = 1e-15
"""Difference of the cosine of a tilt from 1 that is due to rounding."""

_LEAN: Final = Pose.from_rpy((0.0, 0.0, 0.0), (1e-7, 0.0, 0.0))
"""Tilt of a cylinder that would stand exactly upright. MuJoCo 4.0.0 loses all contacts of a plane
and a cylinder that leans by about 1e-15 rad, where rounding errors decide in which direction: the
cylinder sinks into the floor and is thrown out of it. Rounding errors bring an upright one there
within a minute; this tilt, which is 10 nm on a can, it keeps."""


def add_object(
    spec: mujoco.MjSpec, name: str, obj: ObjectSpec, pose: Pose, sampled: LinkFactors
) -> None:
    """Add an object with its sampled mass; body, joint and first geom have its name.

    The pose of an object that moves on a joint is that of the object on which it hangs. What hangs
    on an object that is not fixed is a part of its tree, and moves with it.
    """
    if obj.shape == "cylinder" and abs(abs(pose.rotation_matrix[2, 2]) - 1.0) < _EXACTLY_UPRIGHT:
        pose = pose @ _LEAN
    hung = obj.joint
    parent = spec.worldbody
    place = pose
    if hung is not None:
        start = hung.spec.displacement(hung.spec.start)
        pose = pose @ start
        place = pose
        if spec.body(hung.owner).joints:
            parent = spec.body(hung.owner)
            place = start
    body = parent.add_body(name=name, pos=place.position, quat=place.quaternion)
    if hung is not None:
        _hang(spec, body, hung)
    elif not obj.fixed:
        body.add_freejoint(name=name)
    solid = body_of(obj)
    total = sum(part.weight for part in solid.parts)
    for index, part in enumerate(solid.parts):
        geom = body.add_geom(
            name=part_geom(name, index),
            mass=obj.mass * sampled.mass * (part.weight / total),
            rgba=part.rgba or obj.rgba,
            friction=(obj.friction, _TORSION, _rolling(part, solid, obj)),
            condim=_CONDIM_ROLLING if _can_roll(part, solid) else 3,
            group=OBJECT_GROUP,
        )
        if not obj.fixed and hung is None:
            _stiffen(geom, obj.mass * sampled.mass)
        _add_texture(spec, geom, obj, part)
        if not solid.is_simple:  # MuJoCo's compiler need not rotate what is at the origin
            geom.pos = part.pose.position
            geom.quat = part.pose.quaternion
        if part.kind == "hull":
            geom.type = mujoco.mjtGeom.mjGEOM_MESH
            geom.meshname = _object_mesh(spec, name, part)
        else:
            geom.type = GEOM_TYPES[part.kind]
            geom.size = half_sizes(part.kind, part.size)
    add_marker(body, obj)
    shift = _stable_center_offset(obj, solid, pose, sampled.shift)
    if shift.any():
        body.mass = obj.mass * sampled.mass
        body.ipos = shift
        body.inertia = body.mass * inertia_per_mass(obj)
        if not solid.is_simple:
            principal = solid.principal[0]
            body.ipos = principal.position + shift
            body.iquat = principal.quaternion
        body.explicitinertial = True


_STOP_SOLREF: Final = (0.008, 1.0)  # s, damping ratio: end stops give by less than a millimeter


_FRICTION_SOLIMP: Final = (0.99, 0.999)
"""Impedance of dry friction: with MuJoCo's 0.9, what friction holds creeps at centimeters a second
under a load of a tenth of it."""


def _hang(spec: mujoco.MjSpec, body: mujoco.MjsBody, hung: Articulation) -> None:
    """Add the joint by which a body, placed as at the start, hangs on another object.

    The two may touch: what is next to a hinge or on the rails of a slide would jam otherwise.
    """
    own = hung.spec
    is_hinge = own.type == "hinge"
    kind = mujoco.mjtJoint.mjJNT_HINGE if is_hinge else mujoco.mjtJoint.mjJNT_SLIDE
    unit = math.degrees if is_hinge and spec.compiler.degree else float
    joint = body.add_joint(name=body.name, type=kind)
    joint.axis = own.direction
    joint.pos = own.anchor if is_hinge else (0.0, 0.0, 0.0)
    joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
    joint.range = [unit(end) for end in own.limits]
    joint.ref = unit(own.start)
    joint.damping[0] = own.damping
    joint.frictionloss = own.friction
    joint.stiffness[0] = own.spring
    joint.springref = unit(own.si(own.rest))
    joint.solref_limit = _STOP_SOLREF
    joint.solref_friction = _STIFF_SOLREF
    joint.solimp_friction[:2] = _FRICTION_SOLIMP
    spec.add_exclude(name=body.name, bodyname1=hung.owner, bodyname2=body.name)


def refuse_stiff_springs(model: mujoco.MjModel, joints: Mapping[str, Articulation]) -> None:
    """Check that the springs of joints are no stiffer than the time step ``dt`` allows.

    The integrator takes a spring's force at the beginning of a step and diverges above a stiffness
    of ``4 I / dt²``, with the inertia ``I`` that the joint moves; a quarter of that is allowed, an
    oscillation of six steps.

    Args:
        model: Compiled world.
        joints: Joints by the names of the objects that they move, which are in the model.

    Raises:
        SpringError: A spring is stiffer.
    """
    step = model.opt.timestep
    for name, hung in joints.items():
        inertia = 1.0 / float(model.dof_invweight0[model.joint(name).dofadr[0]])
        stiffest = inertia / step**2
        if hung.spec.spring > stiffest:
            unit = "N m/rad" if hung.spec.type == "hinge" else "N/m"
            raise SpringError(
                name,
                f"a spring of {hung.spec.spring:g} {unit} is too stiff for what it moves, in time "
                f"steps of {1e3 * step:g} ms: at most {rounded_down(stiffest, 5):g} {unit}",
            )


def part_geom(name: str, index: int) -> str:
    """Name of the geom of an object's convex part; that of the first is the object's."""
    return name if index == 0 else f"{name}{_PART_MARK}{index}"


def remove_object(spec: mujoco.MjSpec, name: str) -> None:
    """Delete an object's body and meshes."""
    spec.delete(spec.body(name))
    for exclude in [one for one in spec.excludes if one.name == name]:
        spec.delete(exclude)
    for mesh in [one for one in spec.meshes if one.name.startswith(f"{name}{_PART_MARK}")]:
        spec.delete(mesh)
    _remove_unused_textures(spec)


def _object_mesh(spec: mujoco.MjSpec, name: str, part: BodyPart) -> str:
    """Name of the mesh of an object's part; equal parts share one."""
    mesh_name = f"{name}{_PART_MARK}{zlib.crc32(part.mesh.encode()):08x}"
    if spec.mesh(mesh_name) is None:
        mesh = spec.add_mesh(name=mesh_name)
        mesh.uservert = part.corners.ravel()
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    return mesh_name


_PART_MARK: Final = "#"
"""Separates an object's name, which cannot contain it, from the number of a part."""


def _can_roll(part: BodyPart, solid: ObjectBody) -> bool:
    """Whether contacts of a part need rolling friction: it is round, or one of a round wall."""
    return solid.is_axisymmetric or part.kind not in ("box", "hull")


def _rolling(part: BodyPart, solid: ObjectBody, obj: ObjectSpec) -> float:
    """Coefficient of rolling friction in m, such that balls and cylinders come to rest."""
    if not _can_roll(part, solid):
        return _NO_ROLLING
    radius = obj.size[0] if obj.size else part.size[0]
    return _ROLLING * (0.5 * min(part.size) if part.kind == "ellipsoid" else radius)


def _stable_center_offset(obj: ObjectSpec, solid: ObjectBody, pose: Pose, shift: Vector) -> Vector:
    """Restrict a sampled offset of the center of mass, of shape (3,), m, so that nothing rolls off.

    An eccentric ball, or an eccentric cylinder or capsule that lies, would roll away from its
    declared pose as soon as the simulation starts. Their offset is restricted to zero, or to the
    axis.
    """
    if obj.shape in ("sphere", "ellipsoid"):
        return np.zeros(3)
    is_lying = abs(float(pose.rotation_matrix[2, 2])) < _UPRIGHT
    return shift * (0, 0, 1) if solid.is_axisymmetric and is_lying else shift


def noisy_pose(name: str, obj: ObjectSpec, seed: int) -> Pose:
    """The declared pose with the object's noise, sampled independently of all other objects."""
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    shift = rng.uniform(-1, 1, 3) * np.asarray(obj.noise.xyz)
    turn = rng.uniform(-1, 1) * math.radians(obj.noise.yaw)
    declared = obj.pose.pose
    moved = Pose.from_rpy(declared.position + shift, (0, 0, turn))
    return Pose(moved.position, (moved @ Pose(np.zeros(3), declared.quaternion)).quaternion)


# Checks of a tree file


def check_declarations(
    file: TreeFile, robots: Mapping[str, Robot], names_in_scene: Collection[str]
) -> None:
    """Check all declared arms and objects at the start, even those that are spawned later.

    Args:
        file: Declares the arms and objects.
        robots: Robot of each arm, by the arm's name.
        names_in_scene: Names that the scene uses already.

    Raises:
        WorldError: A robot has no such posture or camera mount, or a name is taken.
    """
    for name, arm in file.arms.items():
        robot = robots[name]
        owner = f"of robot {robot.name!r} for arm {name!r}"
        must_be_among(arm.posture, robot.postures, "posture", owner)
        if arm.camera is not None and isinstance(arm.camera.mount, str):
            must_be_among(arm.camera.mount, robot.cameras, "camera mount", owner)
    for name in (*file.objects, *file.arms):
        if name in names_in_scene:
            scene = file.world.scene
            raise WorldError(f"{name!r} is the name of a part of the scene {scene!r} already")


# Scene and arms

CAMERA = "camera"
"""Name of an arm's camera, below the arm's prefix."""

_IMPRATIO = 10.0
_NOSLIP_ITERATIONS = 3
_LIGHT_KG = 0.01  # below it, contacts are made as stiff as with this mass
_LEAST_KG = 1e-4  # impedances above 0.9995 are no stiffer than the time step allows
_LIGHT_SOLMIX = 1e3  # less than that of pads
_STIFF_SOLREF = (0.004, 1.0)  # s, damping ratio: two steps of 2 ms
_PEDESTAL_HALF_WIDTH = 0.11  # m; covers the base plates of a Panda and a UR10
_PEDESTAL_COLOR = (0.42, 0.45, 0.50, 1.0)
_OPENCV_TO_MUJOCO = Pose.from_rpy((0, 0, 0), (np.pi, 0, 0))  # MuJoCo: looking along -z, y up


def scene_names() -> tuple[str, ...]:
    """Names of the shipped scenes, sorted."""
    return tuple(sorted(path.stem for path in (share_dir("assets") / "scenes").glob("*.xml")))


_CCD_TOLERANCE = 1e-8
"""Tolerance of the collision of convex shapes, m. With MuJoCo's 1e-6 a cylinder that touches a box
by less than that, and stands out over its edge, may be found 9 mm deep beside it: the pot that two
arms set on a stove was thrown aside with 500 N."""


def scene_spec(world: WorldSpec) -> mujoco.MjSpec:
    """The scene as an MjSpec with the options of the world.

    Fixtures of a scene file are not part of it: they are objects.

    Args:
        world: Names the scene and the time step.

    Raises:
        CatalogError: No such scene, or MuJoCo cannot read it.
    """
    spec = _read_scene(_scene_file(world.scene))
    spec.option.timestep = world.timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    spec.option.ccd_tolerance = _CCD_TOLERANCE
    for geom in spec.geoms:
        geom.group = SCENE_GROUP
    return spec


def _scene_file(name: str) -> Path:
    if is_scene_path(name):  # its fixtures are objects of the file
        name = "empty"
    if name in scene_names():
        return share_dir("assets") / "scenes" / f"{name}.xml"
    near = difflib.get_close_matches(name, scene_names(), n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise CatalogError(f"no scene {name!r}{hint} (there are: {', '.join(scene_names())})")


def _read_scene(path: Path) -> mujoco.MjSpec:
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise CatalogError(f"scene {path}: {error}") from error


def _stiffen(geom: mujoco.MjsGeom, mass: float) -> None:
    """Make the contacts of a light object as stiff as those of one of `_LIGHT_KG`.

    MuJoCo's contacts are springs of a given frequency: their stiffness is proportional to the mass
    and to d / (1 - d), where d is the constraint impedance (MuJoCo documentation, Computation,
    Parameters). A cube of 1.6 g sank 5 mm into the floor of a bowl under the 40 N with which an arm
    pressed on it, so that no contact was felt; other geoms have their own parameters, of less
    weight.

    Args:
        geom: Geom of a free object.
        mass: Mass of the object, kg.
    """
    if mass >= _LIGHT_KG:
        return
    for i in (0, 1):
        odds = geom.solimp[i] / (1.0 - geom.solimp[i]) * _LIGHT_KG / max(mass, _LEAST_KG)
        geom.solimp[i] = odds / (1.0 + odds)
    geom.solmix = _LIGHT_SOLMIX


def set_grasp_contact_options(spec: mujoco.MjSpec) -> None:
    """Set the contact options of a world in which grippers hold objects by friction.

    A cube of 0.2 kg that is shaken at 8 m/s² for 10 s slips 15.6 mm between pads with MuJoCo's
    defaults, and less than 0.005 mm with these (``docs/grippers.md``). Contacts are stiff, because
    with the defaults light objects sink in by millimeters where fingers press on them: a tower of
    five cubes becomes 15 mm lower, and fingers slide along the object.
    """
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = _IMPRATIO
    spec.option.noslip_iterations = _NOSLIP_ITERATIONS
    for geom in (*spec.geoms, spec.default.geom):  # present and future geoms
        geom.solref = _STIFF_SOLREF


def names_in(spec: mujoco.MjSpec) -> frozenset[str]:
    """Names of bodies, joints and geoms, which objects and arms must not use."""
    return frozenset(element.name for element in (*spec.bodies, *spec.joints, *spec.geoms))


def add_arm(
    spec: mujoco.MjSpec,
    name: str,
    arm: ArmSpec,
    robot: Robot,
    sampled: SampledArm,
    gripper: Gripper | None = None,
    *,
    surface: MountingSurface | None,
    shared: SharedBody | None = None,
    visuals: bool,
) -> None:
    """Attach an arm; all its names begin with ``name/``.

    Args:
        spec: MjSpec of the world.
        name: Name of the arm in the tree file.
        arm: Part of the tree file about the arm.
        robot: Robot of the catalog.
        sampled: Deviations of this arm from its description.
        gripper: Gripper that is mounted on the arm, if any.
        surface: Surface under the base, if any.
        shared: Body that the arm shares with other arms of the same robot, if any, which has been
            added before.
        visuals: Also load the full visual meshes.
    """
    child = robot_spec(robot, visuals=visuals)
    if gripper is not None:
        add_gripper(child, robot, gripper, visuals=visuals)
    for link, factors in sampled.links.items():
        body = child.body(link)
        if body.mass > 0:
            body.mass *= factors.mass
            body.inertia = body.inertia * factors.inertia
            body.fullinertia = body.fullinertia * factors.inertia
            body.ipos = body.ipos + factors.shift
    _set_rotors(child, robot, sampled.rotor)
    neighbors = [] if shared is None else [*shared.remove_from(child, name)]
    _attach(spec, name, arm, robot, child, sampled)
    if shared is not None:
        for link, own in neighbors:
            spec.add_exclude(bodyname1=f"{shared.name}/{link}", bodyname2=f"{name}/{own}")
    elif surface is not None:
        _mount_on_surface(spec, name, robot, arm.base.pose, surface)


def add_shared_body(
    spec: mujoco.MjSpec, body: SharedBody, surface: MountingSurface | None, *, visuals: bool
) -> None:
    """Add the body that several arms share, on a pedestal if needed.

    Args:
        spec: MjSpec of the world.
        body: The body.
        surface: Surface under the base, if any.
        visuals: Also load the full visual meshes.
    """
    base = body.base
    frame = spec.worldbody.add_frame(pos=base.position, quat=base.quaternion)
    spec.attach(body.spec(visuals=visuals), prefix=f"{body.name}/", frame=frame)
    if surface is not None and surface.pedestal:
        _add_pedestal(spec, f"{body.name}/pedestal", base, surface.gap)


def nominal_model(
    name: str, arm: ArmSpec, robot: Robot, option: mujoco.MjOption, *, rotors: bool
) -> mujoco.MjModel:
    """Compile an arm alone on its base, without sampled deviations; names as in `add_arm`.

    Args:
        name: Name of the arm in the tree file.
        arm: Part of the tree file about the arm.
        robot: Robot of the catalog.
        option: Options of the world, from which gravity and time step are copied.
        rotors: Whether the model includes rotor inertias.
    """
    spec = mujoco.MjSpec()
    spec.option.gravity = option.gravity
    spec.option.timestep = option.timestep
    child = chain_spec(robot)
    if rotors:
        _set_rotors(child, robot, robot.rotor_inertia)
    _attach(spec, name, arm, robot, child)
    return spec.compile()


def _set_rotors(child: mujoco.MjSpec, robot: Robot, inertia: Vector) -> None:
    for joint, rotor in zip(robot.joints, inertia.tolist(), strict=True):
        child.joint(joint).armature = rotor


def _attach(
    spec: mujoco.MjSpec,
    name: str,
    arm: ArmSpec,
    robot: Robot,
    child: mujoco.MjSpec,
    sampled: SampledArm | None = None,
) -> None:
    """Attach an arm and its camera, the camera with its sampled deviation if there is one."""
    base = arm.base.pose
    frame = spec.worldbody.add_frame(name=f"{name}/mount", pos=base.position, quat=base.quaternion)
    if arm.camera is not None and isinstance(arm.camera.mount, str):
        mount = robot.cameras[arm.camera.mount]
        _add_camera(child.body(mount.link), CAMERA, arm.camera, mount.pose, sampled)
    spec.attach(child, prefix=f"{name}/", frame=frame)
    if arm.camera is not None and not isinstance(arm.camera.mount, str):
        _add_camera(spec.worldbody, f"{name}/{CAMERA}", arm.camera, arm.camera.mount.pose, sampled)


def _mount_on_surface(
    spec: mujoco.MjSpec, name: str, robot: Robot, base: Pose, surface: MountingSurface
) -> None:
    """Add a pedestal if needed, and ignore contacts of the first link with the mounting surface.

    Collision shapes of first links are often rough: a capsule may reach below the base.
    """
    first = spec.joint(f"{name}/{robot.joints[0]}").parent.name
    if spec.body(surface.body) is not None:  # it may be an object that was removed
        spec.add_exclude(bodyname1=surface.body, bodyname2=first)
    if surface.pedestal:
        pedestal = _add_pedestal(spec, f"{name}/pedestal", base, surface.gap)
        spec.add_exclude(bodyname1=pedestal.name, bodyname2=first)


def _add_camera(
    body: mujoco.MjsBody, name: str, camera: CameraSpec, pose: Pose, sampled: SampledArm | None
) -> None:
    """Add a camera at ``pose`` (x right, y down, z forward) with its sampled focal length."""
    fovy = camera.fov
    if sampled is not None and sampled.camera is not None:
        pose = pose @ sampled.camera
        fovy = math.degrees(2 * math.atan(math.tan(math.radians(fovy) / 2) / sampled.focal))
    turned = pose @ _OPENCV_TO_MUJOCO
    width, height = camera.resolution
    body.add_camera(
        name=name,
        pos=turned.position,
        quat=turned.quaternion,
        fovy=fovy,
        resolution=(width, height),
    )


def _add_pedestal(spec: mujoco.MjSpec, name: str, base: Pose, height: float) -> mujoco.MjsBody:
    middle = base @ Pose.from_rpy((0.0, 0.0, -height / 2))
    # An arm may have a link of this name; no link's name ends with a slash.
    unique = name if spec.body(name) is None else f"{name}/"
    body = spec.worldbody.add_body(name=unique, pos=middle.position, quat=middle.quaternion)
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=(_PEDESTAL_HALF_WIDTH, _PEDESTAL_HALF_WIDTH, height / 2),
        rgba=_PEDESTAL_COLOR,
        group=SCENE_GROUP,
    )
    return body


def remove_arm(spec: mujoco.MjSpec, name: str, robot: Robot) -> None:
    """Delete an arm's bodies, pedestal, camera, mount, meshes and tendons."""
    prefix = f"{name}/"
    spec.delete(spec.body(prefix + robot.base_link))
    leftovers = [*spec.bodies, *spec.cameras, *spec.frames, *spec.meshes, *spec.tendons]
    for element in [e for e in leftovers if e.name.startswith(prefix)]:
        spec.delete(element)


# Arms in the compiled model


@dataclass(frozen=True, eq=False)
class ArmBody:
    """An arm in one compiled model and data; find it again after a recompilation.

    Attributes:
        base: Pose of the robot's base link in the world.
        qpos_ids: Addresses of the joints' positions, base to tip, of shape (dof,); likewise
            ``dof_ids`` for velocities and ``actuator_ids`` for torques.
        geom_ids: Ids of all geoms that can be in contact.
        tool_geom_ids: Those of them beyond the last joint.
        camera_id: Id of the arm's camera, -1 if it has none.
    """

    name: str
    robot: Robot
    base: Pose
    model: mujoco.MjModel
    data: mujoco.MjData
    qpos_ids: npt.NDArray[np.int64]
    dof_ids: npt.NDArray[np.int64]
    actuator_ids: npt.NDArray[np.int64]
    tool_site: int
    tool_body: int
    geom_ids: frozenset[int]
    tool_geom_ids: frozenset[int]
    camera_id: int

    @classmethod
    def find(
        cls, name: str, robot: Robot, base: Pose, model: mujoco.MjModel, data: mujoco.MjData
    ) -> ArmBody:
        """Look the arm ``name`` up in a compiled model."""
        joints = [model.joint(f"{name}/{joint}") for joint in robot.joints]
        last = int(joints[-1].bodyid[0])
        geoms = {
            g: int(model.geom_bodyid[g])
            for g in range(model.ngeom)
            if model.body(model.geom_bodyid[g]).name.startswith(f"{name}/")
            and not model.geom(g).name.endswith("/pedestal")
            and model.geom_contype[g]
        }
        return cls(
            name=name,
            robot=robot,
            base=base,
            model=model,
            data=data,
            qpos_ids=np.array([int(j.qposadr[0]) for j in joints]),
            dof_ids=np.array([int(j.dofadr[0]) for j in joints]),
            actuator_ids=np.array([model.actuator(f"{name}/{j}").id for j in robot.joints]),
            tool_site=model.site(f"{name}/{TOOL_SITE}").id,
            tool_body=model.body(f"{name}/{robot.tool_link}").id,
            geom_ids=frozenset(geoms),
            tool_geom_ids=frozenset(
                g for g, body in geoms.items() if _is_descendant(model, body, last)
            ),
            camera_id=mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, f"{name}/{CAMERA}"),
        )

    @property
    def q(self) -> Vector:
        """True joint positions in rad, of shape (dof,)."""
        positions: Vector = self.data.qpos[self.qpos_ids]
        return positions

    @property
    def v(self) -> Vector:
        """True joint velocities in rad/s, of shape (dof,)."""
        velocities: Vector = self.data.qvel[self.dof_ids]
        return velocities

    @property
    def tool_pose(self) -> Pose:
        """Pose of the tool frame in the world, as of the last forward kinematics."""
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, self.data.site_xmat[self.tool_site])
        return Pose(self.data.site_xpos[self.tool_site].copy(), quaternion)

    @property
    def tool_link_pose(self) -> Pose:
        """Pose in the world of the link that carries the tool."""
        return Pose(self.data.xpos[self.tool_body].copy(), self.data.xquat[self.tool_body].copy())


def _is_descendant(model: mujoco.MjModel, body: int, link: int) -> bool:
    """Whether a body is ``link`` or one of its descendants."""
    while body not in (0, link):
        body = int(model.body_parentid[body])
    return body == link
