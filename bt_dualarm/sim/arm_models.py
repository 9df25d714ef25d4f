"""Nominal and sampled models of an arm.

A controller works with `NominalArm`, the arm of the description. The plant is a `SampledArm`: the
same arm with manufacturing errors, drawn from the run's seed within the bounds of `RealityErrors`.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector, camera_pose
from bt_dualarm.robots.mjspec import TOOL_SITE
from bt_dualarm.robots.robot import JointFriction, Robot
from bt_dualarm.sim.object_body import body_of, primitive_inertia
from bt_dualarm.spec.document import LinkErrors, ObjectSpec, PayloadErrors, RealityErrors

BORNE_GYRATION_M: Final = 0.05
"""Radius of gyration of the share of a load that an arm bears together with others, m."""


@dataclass(frozen=True, eq=False)
class NominalLoad:
    """An object at an arm's tool, as its controller models it.

    Attributes:
        object: Name of the object.
        mass: Mass in kg, None if unknown.
        inertia: Moments of inertia about the axes of ``pose``, of shape (3,), kg m²; None if the
            mass is unknown.
        pose: Pose of its center of mass in the tool link when it was attached.
        gyration: Moments of inertia of its shape for 1 kg, of shape (3,), m².
        mass_declared: Whether the mass is the declared one; otherwise the arm estimates it.
        mass_doubt: Standard deviation of an estimated mass, kg.
        center_doubt: Standard deviation of an estimated center of mass along an axis, m.
        share: Fraction of the mass that this arm bears, from 0 to 1.
        alone: Whether no other arm holds the object; otherwise the torques of this arm do not
            determine its mass.
    """

    object: str
    mass: float | None
    inertia: Vector | None
    pose: Pose
    gyration: Vector
    mass_declared: bool = True
    mass_doubt: float = 0.0
    center_doubt: float = 0.0
    share: float = 1.0
    alone: bool = True

    @property
    def borne(self) -> float | None:
        """Mass in kg that this arm bears, None if it is unknown."""
        return None if self.mass is None else self.share * self.mass

    @classmethod
    def of(
        cls,
        name: str,
        obj: ObjectSpec,
        pose: Pose,
        *,
        known: bool = True,
        upon: Sequence[tuple[ObjectSpec, Pose]] = (),
    ) -> NominalLoad:
        """Load of a declared object of uniform density, whose mass the arm may know or not.

        Args:
            name: Name of the object.
            obj: The object.
            pose: Its pose in the tool link.
            known: Whether the arm knows the masses.
            upon: Objects that ride on it, with their poses in its frame; they count if it does.
        """
        if not known:
            upon = ()
        gyration = inertia_per_mass(obj)
        if obj.moved or upon:
            principal, gyration = principal_with((obj, Pose.identity()), *upon)
            pose = pose @ principal
        elif not body_of(obj).is_simple:
            pose = pose @ body_of(obj).principal[0]
        if not known:
            return cls(name, None, None, pose, gyration, mass_declared=False)
        mass = mass_with(obj, upon)
        return cls(name, mass, mass * gyration, pose, gyration)

    @classmethod
    def borne_with_others(
        cls,
        name: str,
        obj: ObjectSpec,
        pose: Pose,
        *,
        known: bool = True,
        upon: Sequence[tuple[ObjectSpec, Pose]] = (),
    ) -> NominalLoad:
        """Load of an object that several arms bear: a compact body at the arm's grasp.

        With the inertia of a long object, the arm would answer an error with torques that turn
        the whole object, although the other arms hold its other end.
        """
        gyration = np.full(3, BORNE_GYRATION_M**2)
        if not known:
            return cls(name, None, None, pose, gyration, mass_declared=False)
        mass = mass_with(obj, upon)
        return cls(name, mass, mass * gyration, pose, gyration)


def mass_with(obj: ObjectSpec, upon: Sequence[tuple[ObjectSpec, Pose]]) -> float:
    """Mass of an object with what rides on it, kg."""
    return obj.total_mass + sum(one.total_mass for one, _ in upon)


def inertia_per_mass(obj: ObjectSpec) -> Vector:
    """Moments of inertia of a uniform body about its principal axes, for 1 kg, (3,), m²."""
    body = body_of(obj)
    if body.is_simple:
        return primitive_inertia(obj.shape, obj.size)
    return body.principal[1]


def principal_with(*placed: tuple[ObjectSpec, Pose]) -> tuple[Pose, Vector]:
    """Principal axes of objects, with what their joints move, as one body with joints at start.

    Args:
        placed: The objects, each with its pose in a common frame.

    Returns:
        Pose of the axes about the common center of mass in that frame, and the moments about them
        for 1 kg, of shape (3,), m².
    """
    places = list[Pose]()
    objects = list[ObjectSpec]()
    for obj, place in placed:
        places.append(place)
        objects.append(obj)
        for one in obj.moved:
            hung = one.joint
            start = Pose.identity() if hung is None else hung.spec.displacement(hung.spec.start)
            places.append(place @ start)
            objects.append(one)
    shares = np.array([one.mass for one in objects]) / sum(obj.total_mass for obj, _ in placed)
    centers = np.array(
        [place.apply(body_of(one).center) for place, one in zip(places, objects, strict=True)]
    )
    center = shares @ centers
    inertia = np.zeros((3, 3))
    for share, place, one, at in zip(shares, places, objects, centers, strict=True):
        turn = place.rotation_matrix
        away = at - center
        shifted = away @ away * np.eye(3) - np.outer(away, away)  # parallel-axis theorem
        inertia += share * (turn @ body_of(one).inertia @ turn.T + shifted)
    moments, axes = np.linalg.eigh(inertia)
    if np.linalg.det(axes) < 0.0:
        axes = axes * (1.0, 1.0, -1.0)
    return Pose.from_axes(center, axes.tolist()), np.asarray(moments, dtype=float)


Rotations: TypeAlias = npt.NDArray[np.float64]
"""Rotations, of shape (n, 3, 3)."""


class NominalArm:
    """Model of an arm as its controller knows it: masses of the URDF, rigid joints.

    Not thread-safe: all methods share one scratch `mujoco.MjData`.

    Args:
        name: Name of the arm in the tree file.
        robot: Robot of the arm.
        base: Pose of its base link in the world.
        model: Model of this arm alone, on its base, with its joints in the robot's order.
        friction: Friction of its joints, as far as it is known.
        estimates_payload: Whether the arm has to estimate the masses of the objects that it holds.

    Attributes:
        model: The model.
        loads: Loads that the arm holds; replaced by another tuple at every change.
        friction: Friction of its joints by the description, with its uncertainty.
        tool_site: Id of the tool frame's site in the model.
        tool_body: Id of the link that carries the tool.
    """

    def __init__(
        self,
        name: str,
        robot: Robot,
        base: Pose,
        model: mujoco.MjModel,
        friction: JointFriction,
        *,
        estimates_payload: bool = False,
    ) -> None:
        self.name = name
        self.robot = robot
        self.base = base
        self.model = model
        self.friction = friction
        self.estimates_payload = estimates_payload
        self.loads: tuple[NominalLoad, ...] = ()
        self.tool_site = int(model.site(f"{name}/{TOOL_SITE}").id)
        self.tool_body = int(model.body(f"{name}/{robot.tool_link}").id)
        self._data = mujoco.MjData(model)
        # Views: an attribute lookup on mjData costs more than reading the array.
        self._q = self._data.qpos
        self._tool_position = self._data.site_xpos[self.tool_site]

    def hold(self, loads: Iterable[NominalLoad]) -> None:
        """Set the loads that the arm holds; estimates of loads that it still holds are kept.

        Of an object that it now bears with others, at its grasp, only the estimated mass is kept.
        """
        estimated = {
            load.object: load
            for load in self.loads
            if not load.mass_declared and load.mass is not None
        }
        held = []
        for load in loads:
            known = estimated.get(load.object, load)
            if (known.share, known.alone) != (load.share, load.alone):
                known = replace(known, share=load.share, alone=load.alone)
            if known.mass is not None and (known.gyration != load.gyration).any():
                inertia = known.mass * load.gyration
                known = replace(known, pose=load.pose, gyration=load.gyration, inertia=inertia)
            held.append(known)
        self.loads = tuple(held)

    def update_load(self, load: NominalLoad) -> None:
        """Replace a held load by a new estimate of it."""
        self.loads = tuple(load if one.object == load.object else one for one in self.loads)

    def tool_pose_at(self, q: Vector) -> Pose:
        """Pose of the tool frame in the world at joint positions ``q`` of shape (dof,), rad."""
        return _pose_of_site(self._with_kinematics(q), self.tool_site)

    def tool_position_at(self, q: Vector) -> Vector:
        """Origin of the tool frame alone, of shape (3,), m: needed at every set-point of a path."""
        self._with_kinematics(q)
        position: Vector = self._tool_position.copy()
        return position

    def tool_link_pose_at(self, q: Vector) -> Pose:
        """Pose in the world of the link that carries the tool."""
        data = self._with_kinematics(q)
        return Pose(data.xpos[self.tool_body].copy(), data.xquat[self.tool_body].copy())

    def tool_link_frames_at(self, rows: Matrix) -> tuple[Matrix, Rotations]:
        """Poses in the world of the link that carries the tool, at many joint positions.

        Args:
            rows: Joint positions, of shape (n, dof), rad.

        Returns:
            Positions of shape (n, 3), m, and rotation matrices of shape (n, 3, 3).
        """
        positions = np.empty((len(rows), 3))
        rotations = np.empty((len(rows), 9))
        for i, q in enumerate(rows):
            data = self._with_kinematics(q)
            positions[i] = data.xpos[self.tool_body]
            rotations[i] = data.xmat[self.tool_body]
        return positions, rotations.reshape(-1, 3, 3)

    def camera_pose_at(self, q: Vector) -> Pose:
        """Nominal pose in the world of the arm's camera (x right, y down, z forward), likewise.

        Raises:
            Failure: ``NO_CAMERA``: none moves with the arm.
        """
        if not self.model.ncam:
            raise Failure("NO_CAMERA", f"{self.name} has no camera that moves with it")
        data = self._with_kinematics(q)
        mujoco.mj_camlight(self.model, data)
        return camera_pose(data, 0)

    def correct_camera(self, correction: Pose) -> None:
        """Correct the nominal mount of the camera on its link.

        Args:
            correction: Corrected pose in the previous camera frame (x right, y down, z forward).
        """
        model = self.model
        flip = Pose.from_rpy((0.0, 0.0, 0.0), (np.pi, 0.0, 0.0))
        previous = Pose(model.cam_pos[0].copy(), model.cam_quat[0].copy()) @ flip
        mount = previous @ correction @ flip.inverse
        model.cam_pos[0] = mount.position
        model.cam_quat[0] = mount.quaternion

    def tool_jacobian_at(self, q: Vector) -> Matrix:
        """Geometric Jacobian of the tool frame in the world, linear above angular, (6, dof).

        Args:
            q: Joint positions, of shape (dof,), rad.
        """
        data = self._with_kinematics(q)
        jacobian = np.zeros((6, self.model.nv))
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_jacSite(self.model, data, jacobian[:3], jacobian[3:], self.tool_site)
        return jacobian

    def _with_kinematics(self, q: Vector) -> mujoco.MjData:
        self._q[:] = q
        mujoco.mj_kinematics(self.model, self._data)
        return self._data


def _pose_of_site(data: mujoco.MjData, site: int) -> Pose:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, data.site_xmat[site])
    return Pose(data.site_xpos[site].copy(), quaternion)


# Sampled deviations of the plant


@dataclass(frozen=True, eq=False)
class LinkFactors:
    """Deviations of one link's inertia from its description.

    Attributes:
        mass: Factor of the mass.
        inertia: Factor of the moments of inertia, that of the mass included.
        shift: Offset of the center of mass in the link's frame, of shape (3,), m.
    """

    mass: float
    inertia: float
    shift: Vector


@dataclass(frozen=True, eq=False)
class SampledArm:
    """Deviations of the true arm from the nominal one.

    Attributes:
        links: Inertia factors of each link and finger, by name; empty if there are none.
        friction: True friction of the joints.
        rotor: Inertia of each joint's rotor, of shape (dof,), kg m².
        gain: Factor of each joint's torque, of shape (dof,).
        camera: True pose of the camera in its calibrated frame; None if they agree.
        focal: Factor of the focal length.
        stamp_s: Seconds by which the camera's clock is ahead.
        distortion: Radial distortion of the lens that the calibration lacks, OpenCV's k1 and k2.
    """

    links: Mapping[str, LinkFactors]
    friction: JointFriction
    rotor: Vector
    gain: Vector
    camera: Pose | None
    focal: float
    stamp_s: float
    distortion: tuple[float, float]


def random_stream(seed: int, owner: str) -> np.random.Generator:
    """Random stream of one owner; it depends on seed and name, not on the order of creation."""
    return np.random.default_rng([seed, zlib.crc32(owner.encode())])


def sample_arm(
    errors: RealityErrors, robot: Robot, seed: int, name: str, fingers: Sequence[str] = ()
) -> SampledArm:
    """Sample the deviations of one arm.

    Each kind of deviation has its own random stream: a new kind leaves the others as they are.

    Args:
        errors: Bounds of the deviations.
        robot: Robot of the arm.
        seed: Seed of the run.
        name: Name of the arm in the file: two arms of one robot deviate differently.
        fingers: Bodies that move in its gripper, which the robot's links do not contain.
    """
    links = _links(errors.links, list(robot.model.links), random_stream(seed, f"{name}:links"))
    links |= _links(errors.links, fingers, random_stream(seed, f"{name}:fingers"))
    camera, focal, stamp_s, distortion = _camera(errors, random_stream(seed, f"{name}:calibration"))
    return SampledArm(
        links=links,
        friction=_friction(errors, robot, random_stream(seed, f"{name}:friction")),
        rotor=_rotor(errors, robot, random_stream(seed, f"{name}:rotors")),
        gain=1.0 + errors.drive.gain.draw(random_stream(seed, f"{name}:drives"), robot.dof),
        camera=camera,
        focal=focal,
        stamp_s=stamp_s,
        distortion=distortion,
    )


def sample_object(errors: PayloadErrors, seed: int, name: str) -> LinkFactors:
    """Sample the mass and center of mass of an object."""
    rng = random_stream(seed, f"{name}:mass")
    mass = 1.0 + float(errors.mass.draw(rng, 1)[0])
    return LinkFactors(mass, mass, errors.center.draw(rng, 3))


def _links(
    bounds: LinkErrors, names: Sequence[str], rng: np.random.Generator
) -> dict[str, LinkFactors]:
    if not (bounds.mass.most or bounds.inertia.most or bounds.center.most):
        return {}
    mass = 1.0 + bounds.mass.draw(rng, len(names))
    inertia = mass * (1.0 + bounds.inertia.draw(rng, len(names)))
    shift = bounds.center.draw(rng, 3 * len(names)).reshape(-1, 3)
    factors = zip(mass.tolist(), inertia.tolist(), shift, strict=True)
    return {name: LinkFactors(*one) for name, one in zip(names, factors, strict=True)}


def _rotor(errors: RealityErrors, robot: Robot, rng: np.random.Generator) -> Vector:
    if not errors.links.rotor:
        return np.zeros(robot.dof)
    rotor: Vector = robot.rotor_inertia * (1.0 + errors.links.inertia.draw(rng, robot.dof))
    return rotor


def _friction(errors: RealityErrors, robot: Robot, rng: np.random.Generator) -> JointFriction:
    bounds = errors.friction
    if not bounds.present:
        return JointFriction.none(robot.dof)
    dry = 1.0 + bounds.coulomb.draw(rng, robot.dof)
    viscous = 1.0 + bounds.viscous.draw(rng, robot.dof)
    return robot.friction.scaled(dry, viscous, bounds.most * robot.limits.effort)


def _camera(
    errors: RealityErrors, rng: np.random.Generator
) -> tuple[Pose | None, float, float, tuple[float, float]]:
    """Pose of the camera, factor of its focal length, offset of its clock in s, distortion."""
    bounds = errors.camera
    # The order of the draws is part of the random stream: do not change it.
    turn = bounds.rotation.draw(rng, 3)
    shift = bounds.position.draw(rng, 3)
    focal = 1.0 + float(bounds.focal.draw(rng, 1)[0])
    stamp = float(bounds.stamp.draw(rng, 1)[0])
    k1, k2 = (float(one.draw(rng, 1)[0]) for one in (bounds.k1, bounds.k2))
    roll, pitch, yaw = np.radians(turn).tolist()
    is_exact = not (bounds.rotation.most or bounds.position.most or bounds.focal.most)
    pose = None if is_exact else Pose.from_rpy(shift.tolist(), (roll, pitch, yaw))
    return pose, focal, stamp, (k1, k2)
