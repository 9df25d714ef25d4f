"""Editing the MjSpec of a world: scenes, objects, arms, cameras, welds."""

from __future__ import annotations

import difflib
import math
from pathlib import Path

import mujoco
import numpy as np

from bt_dualarm.errors import CatalogueError
from bt_dualarm.pose import Pose, Vector
from bt_dualarm.share import share_dir
from bt_dualarm.spec.camera import CameraSpec
from bt_dualarm.spec.document import ArmSpec, WorldSpec
from bt_dualarm.world.grippers.gripper import Gripper
from bt_dualarm.world.grippers.mjspec import add_gripper
from bt_dualarm.world.hardware.drawn_arm import DrawnArm, LinkFactors
from bt_dualarm.world.mounting import MountingSurface
from bt_dualarm.world.robots.geom_groups import SCENE_GROUP
from bt_dualarm.world.robots.mjspec import chain_spec, robot_spec
from bt_dualarm.world.robots.robot import Robot

CAMERA = "camera"

_IMPRATIO, _NOSLIP = 10.0, 3
_STIFF = (0.004, 1.0)  # s, damping ratio: two steps of 2 ms
_PEDESTAL_HALF_WIDTH = 0.11  # m; the footprint of a Panda or UR10 base plate fits
_PEDESTAL_COLOR = (0.42, 0.45, 0.50, 1.0)
_OPENCV_TO_MUJOCO = Pose.from_rpy((0, 0, 0), (np.pi, 0, 0))  # MuJoCo's cameras look along -z, y up


def scene_names() -> tuple[str, ...]:
    """Names of the shipped scenes, sorted."""
    return tuple(sorted(path.stem for path in (share_dir("assets") / "scenes").glob("*.xml")))


def scene_spec(world: WorldSpec, root: Path) -> mujoco.MjSpec:
    """The scene as an MjSpec with the options of the world.

    Args:
        world: Names the scene and the time step.
        root: Folder against which a scene given as a path is resolved.

    Raises:
        CatalogueError: No such scene, or MuJoCo cannot read it.
    """
    spec = _read_scene(_scene_file(world.scene, root))
    spec.option.timestep = world.timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    for geom in spec.geoms:
        geom.group = SCENE_GROUP
    return spec


def _scene_file(name: str, root: Path) -> Path:
    if name.endswith(".xml"):
        return root / name
    if name in scene_names():
        return share_dir("assets") / "scenes" / f"{name}.xml"
    near = difflib.get_close_matches(name, scene_names(), n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise CatalogueError(f"no scene {name!r}{hint} (there are: {', '.join(scene_names())})")


def _read_scene(path: Path) -> mujoco.MjSpec:
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise CatalogueError(f"scene {path}: {error}") from error


def take_hold_options(spec: mujoco.MjSpec) -> None:
    """Options of a world in which fingers hold things: without them friction creeps.

    A cube of 0.2 kg that is shaken at 8 m/s² for 10 s slips 15.6 mm between pads with MuJoCo's
    defaults, and less than 0.005 mm with these (``docs/grippers.md``). Things lie stiffly on one
    another: with MuJoCo's defaults light ones sink in by millimetres where fingers press them down,
    so that a tower of five cubes becomes 15 mm lower, and fingers slide along what they hold.
    """
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = _IMPRATIO
    spec.option.noslip_iterations = _NOSLIP
    for geom in (*spec.geoms, spec.default.geom):  # what stands in the scene, and what comes
        geom.solref = _STIFF


def names_in(spec: mujoco.MjSpec) -> frozenset[str]:
    """Names of bodies, joints and shapes, which objects and arms must not take."""
    return frozenset(element.name for element in (*spec.bodies, *spec.joints, *spec.geoms))


def add_arm(
    spec: mujoco.MjSpec,
    name: str,
    arm: ArmSpec,
    robot: Robot,
    drawn: DrawnArm,
    gripper: Gripper | None = None,
    *,
    surface: MountingSurface | None,
    visuals: bool,
) -> None:
    """Attach an arm with its names below ``name/``.

    Args:
        spec: MjSpec of the world.
        name: Name of the arm in the tree file.
        arm: Part of the tree file about it.
        robot: Robot of the catalogue that it is.
        drawn: What the seed has made of it.
        gripper: Gripper that is mounted on it, if one is.
        surface: Surface under the base, if there is one.
        visuals: Load the full visual meshes as well.
    """
    child = robot_spec(robot, visuals=visuals)
    if gripper is not None:
        add_gripper(child, robot, gripper, visuals=visuals)
    for link, factors in drawn.links.items():
        _make_heavier(child.body(link), factors)
    _add_rotors(child, robot, drawn.rotor)
    _attach(spec, name, arm, robot, child, drawn)
    if surface is not None:
        _mount(spec, name, robot, arm.base.pose, surface)


def nominal_model(
    name: str, arm: ArmSpec, robot: Robot, option: mujoco.MjOption, *, rotors: bool
) -> mujoco.MjModel:
    """An arm alone on its base, as its controller believes it to be; names as in `add_arm`.

    Args:
        name: Name of the arm in the tree file.
        arm: Part of the tree file about it.
        robot: Robot of the catalogue that it is.
        option: Options of the world, of which gravity and time step are taken.
        rotors: Whether its joints have rotors that weigh something.
    """
    spec = mujoco.MjSpec()
    spec.option.gravity = option.gravity
    spec.option.timestep = option.timestep
    child = chain_spec(robot)
    if rotors:
        _add_rotors(child, robot, robot.rotor_inertia)
    _attach(spec, name, arm, robot, child)
    return spec.compile()


def _add_rotors(child: mujoco.MjSpec, robot: Robot, inertia: Vector) -> None:
    for joint, rotor in zip(robot.joints, inertia.tolist(), strict=True):
        child.joint(joint).armature = rotor


def _make_heavier(body: mujoco.MjsBody, factors: LinkFactors) -> None:
    if body.mass > 0:
        body.mass *= factors.mass
        body.inertia = body.inertia * factors.inertia
        body.fullinertia = body.fullinertia * factors.inertia
        body.ipos = body.ipos + factors.shift


def _attach(
    spec: mujoco.MjSpec,
    name: str,
    arm: ArmSpec,
    robot: Robot,
    child: mujoco.MjSpec,
    drawn: DrawnArm | None = None,
) -> None:
    """Attach an arm and its camera, where it truly is if that was drawn."""
    base = arm.base.pose
    frame = spec.worldbody.add_frame(name=f"{name}/mount", pos=base.position, quat=base.quaternion)
    if arm.camera is not None and isinstance(arm.camera.mount, str):
        mount = robot.cameras[arm.camera.mount]
        _add_camera(child.body(mount.link), CAMERA, arm.camera, mount.pose, drawn)
    spec.attach(child, prefix=f"{name}/", frame=frame)
    if arm.camera is not None and not isinstance(arm.camera.mount, str):
        _add_camera(spec.worldbody, f"{name}/{CAMERA}", arm.camera, arm.camera.mount.pose, drawn)


def _mount(
    spec: mujoco.MjSpec, name: str, robot: Robot, base: Pose, surface: MountingSurface
) -> None:
    """Put a pedestal in the gap; what the arm is mounted on cannot be hit by its first link.

    A URDF's shapes of first links may be rough: a capsule reaches below the base that it turns on.
    """
    first = spec.joint(f"{name}/{robot.joints[0]}").parent.name
    if spec.body(surface.body) is not None:  # it may have been an object that was taken away
        spec.add_exclude(bodyname1=surface.body, bodyname2=first)
    if surface.pedestal:
        pedestal = _add_pedestal(spec, f"{name}/pedestal", base, surface.gap)
        spec.add_exclude(bodyname1=pedestal.name, bodyname2=first)


def _add_camera(
    body: mujoco.MjsBody, name: str, camera: CameraSpec, pose: Pose, drawn: DrawnArm | None
) -> None:
    """``pose`` has x right, y down, z forward."""
    fovy = camera.fov
    if drawn is not None and drawn.camera is not None:
        pose = pose @ drawn.camera
        fovy = math.degrees(2 * math.atan(math.tan(math.radians(fovy) / 2) / drawn.focal))
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
    # An arm may have a link of that name, but none that ends with a slash.
    free = name if spec.body(name) is None else f"{name}/"
    body = spec.worldbody.add_body(name=free, pos=middle.position, quat=middle.quaternion)
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=(_PEDESTAL_HALF_WIDTH, _PEDESTAL_HALF_WIDTH, height / 2),
        rgba=_PEDESTAL_COLOR,
        group=SCENE_GROUP,
    )
    return body


def remove_arm(spec: mujoco.MjSpec, name: str, robot: Robot) -> None:
    """Delete an arm's bodies, its pedestal, camera, mount and meshes."""
    prefix = f"{name}/"
    spec.delete(spec.body(prefix + robot.base_link))
    leftovers = [*spec.bodies, *spec.cameras, *spec.frames, *spec.meshes, *spec.tendons]
    for element in [e for e in leftovers if e.name.startswith(prefix)]:
        spec.delete(element)
