"""One robot of the batch: what the seed has made of an arm that its page describes."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bt_dualarm.pose import Pose, Vector
from bt_dualarm.spec.reality import LinkErrors, PayloadErrors, RealityErrors
from bt_dualarm.world.robots.friction import JointFriction
from bt_dualarm.world.robots.robot import Robot


@dataclass(frozen=True, eq=False)
class LinkFactors:
    """What one link is times what its page says.

    Attributes:
        mass: Factor of its mass.
        inertia: Factor of its moments of inertia, that of the mass included.
        shift: Offset of its centre of mass in its own frame, of shape (3,), m.
    """

    mass: float
    inertia: float
    shift: Vector


@dataclass(frozen=True, eq=False)
class DrawnArm:
    """The true arm beside the one that is believed in.

    Attributes:
        links: Factors of each link and finger, by name; empty where all are as on the page.
        friction: Friction of the joints.
        rotor: Inertia of each joint's rotor, of shape (dof,), kg m².
        gain: Factor of each joint's torque, of shape (dof,).
        camera: Pose of the camera where its calibration has it; None for exactly there.
        focal: Factor of its focal length.
        stamp_s: Seconds by which its clock is ahead.
        bend: Radial distortion of its lens that its calibration does not know, OpenCV's k1 and k2.
    """

    links: Mapping[str, LinkFactors]
    friction: JointFriction
    rotor: Vector
    gain: Vector
    camera: Pose | None
    focal: float
    stamp_s: float
    bend: tuple[float, float]


def stream(seed: int, owner: str) -> np.random.Generator:
    """Randomness of one owner: it hangs on the seed and the name, not on who comes first."""
    return np.random.default_rng([seed, zlib.crc32(owner.encode())])


def draw_arm(
    errors: RealityErrors, robot: Robot, seed: int, name: str, fingers: Sequence[str] = ()
) -> DrawnArm:
    """Draw one robot of the batch.

    Args:
        errors: How far it may be from its page.
        robot: The page.
        seed: Seed of the run.
        name: Name of the arm in the file: two arms are two robots.
        fingers: Bodies that move in its gripper, which the page's links do not have.
    """
    links = _links(errors.links, list(robot.model.links), stream(seed, f"{name}:links"))
    links |= _links(errors.links, fingers, stream(seed, f"{name}:fingers"))
    camera, focal, stamp_s, bend = _camera(errors, stream(seed, f"{name}:calibration"))
    return DrawnArm(
        links=links,
        friction=_friction(errors, robot, stream(seed, f"{name}:friction")),
        rotor=_rotor(errors, robot, stream(seed, f"{name}:rotors")),
        gain=1.0 + errors.drive.gain.draw(stream(seed, f"{name}:drives"), robot.dof),
        camera=camera,
        focal=focal,
        stamp_s=stamp_s,
        bend=bend,
    )


def draw_object(errors: PayloadErrors, seed: int, name: str) -> LinkFactors:
    """Draw an object that an arm may come to hold."""
    rng = stream(seed, f"{name}:mass")
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
    turn, shift = spread.rotation.draw(rng, 3), spread.position.draw(rng, 3)
    focal = 1.0 + float(spread.focal.draw(rng, 1)[0])
    stamp = float(spread.stamp.draw(rng, 1)[0])
    k1, k2 = (float(one.draw(rng, 1)[0]) for one in (spread.k1, spread.k2))
    roll, pitch, yaw = np.radians(turn).tolist()
    is_exact = not (spread.rotation.most or spread.position.most or spread.focal.most)
    pose = None if is_exact else Pose.from_rpy(shift.tolist(), (roll, pitch, yaw))
    return pose, focal, stamp, (k1, k2)
