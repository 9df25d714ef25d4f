"""Objects of a tree file as bodies of a world: their shape, their mass, where they begin."""

from __future__ import annotations

import math
import zlib

import mujoco
import numpy as np

from bt_dualarm.pose import Pose
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.world.hardware.drawn_arm import LinkFactors
from bt_dualarm.world.marker_bodies import add_marker
from bt_dualarm.world.nominal.nominal_load import inertia_per_mass
from bt_dualarm.world.robots.geom_groups import OBJECT_GROUP
from bt_dualarm.world.robots.primitives import GEOM_TYPES, half_sizes


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
        friction=(thing.friction, 0.005, 0.0001),
        group=OBJECT_GROUP,
    )
    add_marker(body, thing)
    if drawn.shift.any():
        body.mass, body.ipos = thing.mass * drawn.mass, drawn.shift
        body.inertia = body.mass * inertia_per_mass(thing)
        body.explicitinertial = True


def noisy_pose(name: str, thing: ObjectSpec, seed: int) -> Pose:
    """The declared pose, moved by the object's noise; independent of all other objects."""
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    shift = rng.uniform(-1, 1, 3) * np.asarray(thing.noise.xyz)
    turn = rng.uniform(-1, 1) * math.radians(thing.noise.yaw)
    declared = thing.pose.pose
    moved = Pose.from_rpy(declared.position + shift, (0, 0, turn))
    return Pose(moved.position, (moved @ Pose(np.zeros(3), declared.quaternion)).quaternion)
