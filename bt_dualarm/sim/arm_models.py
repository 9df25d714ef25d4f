"""The nominal model of an arm, and the deviating plant that is sampled with the seed."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Pose, Vector, camera_pose
from bt_dualarm.robots.mjspec import TOOL_SITE
from bt_dualarm.robots.robot import JointFriction, Robot
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.reality import LinkErrors, PayloadErrors, RealityErrors


@dataclass(frozen=True, eq=False)
class NominalLoad:
    """An object at an arm's tool.

    Attributes:
        object: Name of the object.
        mass: Mass in kg, None where nobody knows it.
        inertia: Moments of inertia about the axes of ``pose``, of shape (3,), kg m²; None likewise.
        pose: Pose of its center of mass in the tool's link, as it was when it was attached.
        gyration: Moments of inertia of its shape for 1 kg, of shape (3,), m².
        mass_declared: Whether the file says the mass; else the arm has to weigh it.
        mass_doubt: Standard deviation of a mass that was weighed, kg.
        center_doubt: Standard deviation of a center that was, along an axis, m.
    """

    object: str
    mass: float | None
    inertia: Vector | None
    pose: Pose
    gyration: Vector
    mass_declared: bool = True
    mass_doubt: float = 0.0
    center_doubt: float = 0.0

    @classmethod
    def of(cls, name: str, thing: ObjectSpec, pose: Pose, *, known: bool = True) -> NominalLoad:
        """The load that a declared object is: its mass is spread evenly, and known or not."""
        gyration = inertia_per_mass(thing)
        if not known:
            return cls(name, None, None, pose, gyration, mass_declared=False)
        return cls(name, thing.mass, thing.mass * gyration, pose, gyration)


def inertia_per_mass(thing: ObjectSpec) -> Vector:
    """Moments of inertia of an even body about its axes, for 1 kg, of shape (3,), m²."""
    if thing.shape == "box":
        x, y, z = np.square(thing.size)
        return np.array([y + z, z + x, x + y]) / 12
    if thing.shape == "cylinder":
        radius, length = np.square(thing.size)
        return np.array([3 * radius + length, 3 * radius + length, 6 * radius]) / 12
    if thing.shape == "capsule":
        radius, length = thing.size
        straight = length / (length + 4.0 / 3.0 * radius)  # its share of the mass
        ball = 1.0 - straight
        along = (0.5 * straight + 0.4 * ball) * radius**2
        across = straight * (length**2 / 12 + radius**2 / 4)
        across += ball * (0.4 * radius**2 + length**2 / 4 + 0.375 * length * radius)
        return np.array([across, across, along])
    return np.full(3, 0.4 * thing.size[0] ** 2)


Turns: TypeAlias = npt.NDArray[np.float64]
"""Rotations, of shape (n, 3, 3)."""


class NominalArm:
    """The arm that its controller believes in: masses of the URDF, rigid joints.

    Args:
        name: Name of the arm in the tree file.
        robot: Robot that it is.
        base: Pose of its base link in the world.
        model: Model of this arm alone, on its base: joints in the robot's order, nothing else.
        friction: Friction of its joints, as far as that is known.
        weighs: Whether nobody says what it holds, so that it has to find out.

    Attributes:
        model: The model.
        loads: What the arm holds; another tuple after every change.
        friction: Friction of its joints as the description has it, and how well that is known.
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
        # Views: looking a field up costs more than reading it.
        self._q = self._data.qpos
        self._tool_place = self._data.site_xpos[self.tool_site]

    def hold(self, loads: Iterable[NominalLoad]) -> None:
        """Believe that the arm holds these; what it has weighed and still holds, it knows."""
        weighed = {load.object: load for load in self.loads if not load.mass_declared}
        self.loads = tuple(weighed.get(load.object, load) for load in loads)

    def update_load(self, load: NominalLoad) -> None:
        """Believe this of a load that the arm holds and was told no mass of."""
        self.loads = tuple(load if one.object == load.object else one for one in self.loads)

    def tool_pose_at(self, q: Vector) -> Pose:
        """The tool frame in the world at positions of shape (dof,), rad."""
        return _pose_of_site(self._placed(q), self.tool_site)

    def tool_position_at(self, q: Vector) -> Vector:
        """Its origin alone, of shape (3,), m: asked for at every set-point of a path."""
        self._placed(q)
        position: Vector = self._tool_place.copy()
        return position

    def tool_link_pose_at(self, q: Vector) -> Pose:
        """The link that carries the tool, likewise."""
        data = self._placed(q)
        return Pose(data.xpos[self.tool_body].copy(), data.xquat[self.tool_body].copy())

    def tool_link_frames_at(self, rows: Matrix) -> tuple[Matrix, Turns]:
        """At many positions, of shape (n, dof): places, (n, 3), m, and turns, (n, 3, 3)."""
        places = np.empty((len(rows), 3))
        turns = np.empty((len(rows), 9))
        for i, q in enumerate(rows):
            data = self._placed(q)
            places[i], turns[i] = data.xpos[self.tool_body], data.xmat[self.tool_body]
        return places, turns.reshape(-1, 3, 3)

    def camera_pose_at(self, q: Vector) -> Pose:
        """The arm's camera (x right, y down, z forward) by its calibration, likewise."""
        data = self._placed(q)
        mujoco.mj_camlight(self.model, data)
        return camera_pose(data, 0)

    def correct_camera(self, correction: Pose) -> None:
        """Believe the camera to be elsewhere on its link.

        Args:
            correction: Pose in the frame where it was assumed to be (x right, y down, z forward).
        """
        model = self.model
        flip = Pose.from_rpy((0.0, 0.0, 0.0), (np.pi, 0.0, 0.0))
        believed = Pose(model.cam_pos[0].copy(), model.cam_quat[0].copy()) @ flip
        mount = believed @ correction @ flip.inverse
        model.cam_pos[0] = mount.position
        model.cam_quat[0] = mount.quaternion

    def tool_jacobian_at(self, q: Vector) -> Matrix:
        """Of the tool in the world: velocity, then angular velocity, by those of the joints.

        Args:
            q: Positions of the joints, of shape (dof,), rad.

        Returns:
            Jacobian of shape (6, dof).
        """
        data = self._placed(q)
        jacobian = np.zeros((6, self.model.nv))
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_jacSite(self.model, data, jacobian[:3], jacobian[3:], self.tool_site)
        return jacobian

    def _placed(self, q: Vector) -> mujoco.MjData:
        self._q[:] = q
        mujoco.mj_kinematics(self.model, self._data)
        return self._data


def _pose_of_site(data: mujoco.MjData, site: int) -> Pose:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, data.site_xmat[site])
    return Pose(data.site_xpos[site].copy(), quaternion)


# Sampled model of an arm: the nominal one with manufacturing errors


@dataclass(frozen=True, eq=False)
class LinkFactors:
    """What one link is times what its description says.

    Attributes:
        mass: Factor of its mass.
        inertia: Factor of its moments of inertia, that of the mass included.
        shift: Offset of its center of mass in its own frame, of shape (3,), m.
    """

    mass: float
    inertia: float
    shift: Vector


@dataclass(frozen=True, eq=False)
class SampledArm:
    """The true arm beside the one that is believed in.

    Attributes:
        links: Factors of each link and finger, by name; empty where all are as on the description.
        friction: Friction of the joints.
        rotor: Inertia of each joint's rotor, of shape (dof,), kg m².
        gain: Factor of each joint's torque, of shape (dof,).
        camera: Pose of the camera where its calibration has it; None for exactly there.
        focal: Factor of its focal length.
        stamp_s: Seconds by which its clock is ahead.
        distortion: Radial distortion of its lens that the calibration lacks, OpenCV's k1 and k2.
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
    """Randomness of one owner: it hangs on the seed and the name, not on who comes first."""
    return np.random.default_rng([seed, zlib.crc32(owner.encode())])


def sample_arm(
    errors: RealityErrors, robot: Robot, seed: int, name: str, fingers: Sequence[str] = ()
) -> SampledArm:
    """Draw one robot of the batch.

    Args:
        errors: How far it may be from its description.
        robot: The description.
        seed: Seed of the run.
        name: Name of the arm in the file: two arms are two robots.
        fingers: Bodies that move in its gripper, which the description's links do not have.
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
    """Draw an object that an arm may come to hold."""
    rng = random_stream(seed, f"{name}:mass")
    mass = 1.0 + float(errors.mass.draw(rng, 1)[0])
    return LinkFactors(mass, mass, errors.center.draw(rng, 3))


def _links(
    spread: LinkErrors, names: Sequence[str], rng: np.random.Generator
) -> dict[str, LinkFactors]:
    if not (spread.mass.most or spread.inertia.most or spread.center.most):
        return {}
    mass = 1.0 + spread.mass.draw(rng, len(names))
    inertia = mass * (1.0 + spread.inertia.draw(rng, len(names)))
    shift = spread.center.draw(rng, 3 * len(names)).reshape(-1, 3)
    factors = zip(mass.tolist(), inertia.tolist(), shift, strict=True)
    return {name: LinkFactors(*one) for name, one in zip(names, factors, strict=True)}


def _rotor(errors: RealityErrors, robot: Robot, rng: np.random.Generator) -> Vector:
    if not errors.links.rotor:
        return np.zeros(robot.dof)
    rotor: Vector = robot.rotor_inertia * (1.0 + errors.links.inertia.draw(rng, robot.dof))
    return rotor


def _friction(errors: RealityErrors, robot: Robot, rng: np.random.Generator) -> JointFriction:
    spread = errors.friction
    if not spread.present:
        return JointFriction.none(robot.dof)
    dry = 1.0 + spread.coulomb.draw(rng, robot.dof)
    viscous = 1.0 + spread.viscous.draw(rng, robot.dof)
    return robot.friction.scaled(dry, viscous, spread.most * robot.limits.effort)


def _camera(
    errors: RealityErrors, rng: np.random.Generator
) -> tuple[Pose | None, float, float, tuple[float, float]]:
    """Where the camera is, its focal length's factor, how late its stamps are, its lens."""
    spread = errors.camera
    turn = spread.rotation.draw(rng, 3)
    shift = spread.position.draw(rng, 3)
    focal = 1.0 + float(spread.focal.draw(rng, 1)[0])
    stamp = float(spread.stamp.draw(rng, 1)[0])
    k1, k2 = (float(one.draw(rng, 1)[0]) for one in (spread.k1, spread.k2))
    roll, pitch, yaw = np.radians(turn).tolist()
    is_exact = not (spread.rotation.most or spread.position.most or spread.focal.most)
    pose = None if is_exact else Pose.from_rpy(shift.tolist(), (roll, pitch, yaw))
    return pose, focal, stamp, (k1, k2)
