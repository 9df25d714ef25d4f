"""Objects of a tree file as bodies of a world: their shape, their mass, where they begin."""

from __future__ import annotations

import math
import zlib
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.pose import Pose, Vector
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.world.hardware.drawn_arm import LinkFactors
from bt_dualarm.world.marker_bodies import add_marker
from bt_dualarm.world.nominal.nominal_load import inertia_per_mass
from bt_dualarm.world.robots.geom_groups import OBJECT_GROUP
from bt_dualarm.world.robots.primitives import GEOM_TYPES, half_sizes

_SLIDING_AND_ROLLING: Final = 6  # MuJoCo's `condim`: friction against every relative motion
_TORSION: Final = 0.005  # m, MuJoCo's default
_ROLLING: Final = 0.1  # of the radius; a ball at 0.05 m/s rolls 15 mm, one at 0.3 m/s 140 mm
_NO_ROLLING: Final = 0.0001  # m, MuJoCo's default; without effect but against what rolls
_UPRIGHT: Final = math.cos(math.radians(45))


def add_object(
    spec: mujoco.MjSpec, name: str, thing: ObjectSpec, pose: Pose, drawn: LinkFactors
) -> None:
    """Add an object; body, joint and geom bear its name, and its mass is the drawn one."""
    body = spec.worldbody.add_body(name=name, pos=pose.position, quat=pose.quaternion)
    if not thing.fixed:
        body.add_freejoint(name=name)
    body.add_geom(
        name=name,
        type=GEOM_TYPES[thing.shape],
        size=half_sizes(thing.shape, thing.size),
        mass=thing.mass * drawn.mass,
        rgba=thing.rgba,
        friction=(thing.friction, _TORSION, _rolling(thing)),
        condim=3 if thing.shape == "box" else _SLIDING_AND_ROLLING,
        group=OBJECT_GROUP,
    )
    add_marker(body, thing)
    shift = _where_it_rests(thing, pose, drawn.shift)
    if shift.any():
        body.mass, body.ipos = thing.mass * drawn.mass, shift
        body.inertia = body.mass * inertia_per_mass(thing)
        body.explicitinertial = True


def _rolling(thing: ObjectSpec) -> float:
    """Coefficient of rolling friction in m: what rolls comes to rest, as everything does."""
    return _NO_ROLLING if thing.shape == "box" else _ROLLING * thing.size[0]


def _where_it_rests(thing: ObjectSpec, pose: Pose, shift: Vector) -> Vector:
    """The drawn offset of the centre of mass, of shape (3,), m, as far as it makes nothing roll.

    A ball whose centre is aside would roll away from where the file has it as soon as time begins,
    as would a cylinder or capsule that lies; there it stays in the middle, or on the axis.
    """
    if thing.shape == "sphere":
        return np.zeros(3)
    lies = abs(float(pose.rotation_matrix[2, 2])) < _UPRIGHT
    return shift * (0, 0, 1) if thing.shape in ("cylinder", "capsule") and lies else shift


def noisy_pose(name: str, thing: ObjectSpec, seed: int) -> Pose:
    """The declared pose, moved by the object's noise; independent of all other objects."""
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    shift = rng.uniform(-1, 1, 3) * np.asarray(thing.noise.xyz)
    turn = rng.uniform(-1, 1) * math.radians(thing.noise.yaw)
    declared = thing.pose.pose
    moved = Pose.from_rpy(declared.position + shift, (0, 0, turn))
    return Pose(moved.position, (moved @ Pose(np.zeros(3), declared.quaternion)).quaternion)
