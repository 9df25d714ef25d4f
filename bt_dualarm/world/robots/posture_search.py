"""Postures of an arm by chance: which links always touch, where it may begin, what it weighs."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.errors import CatalogueError
from bt_dualarm.pose import Vector
from bt_dualarm.world.robots.mjspec import TOOL_SITE, robot_spec
from bt_dualarm.world.robots.robot import Robot

_POSTURES: Final = 400
_ALWAYS: Final = 0.95  # of the postures: such links touch by how they are modelled
_STAND: Final = "stand/"
_STAND_SIZE: Final = (0.11, 0.11, 1.0)  # m, half lengths; as wide as a pedestal
_ROOM: Final = 0.1  # rad that home stays away from limits, where there is so much


@dataclass(frozen=True, eq=False)
class PostureSurvey:
    """What postures by chance say of an arm.

    Attributes:
        always: Pairs of links that touch in nearly all postures.
        home: Posture to begin from, rad, whole degrees, of shape (dof,).
        gravity: Torques that hold the arm there, N m, of shape (dof,).
        most_gravity: The largest torques of all postures, likewise.
        inertia: Diagonal of the mass matrix there, kg m², of shape (dof,).
    """

    always: tuple[tuple[str, str], ...]
    home: Vector
    gravity: Vector
    most_gravity: Vector
    inertia: Vector


def survey_of(robot: Robot) -> PostureSurvey:
    """Try postures of an arm, the same ones each time.

    Raises:
        CatalogueError: Links touch in every posture.
    """
    arm = _Arm(_on_a_stand(robot).compile(), robot)
    postures = _postures(robot)
    touching = [arm.touching(q) for q in postures]
    most = np.max([np.abs(arm.gravity(q)) for q in postures], axis=0)
    pairs = {pair for some in touching for pair in some if _STAND not in pair}
    always = {p for p in pairs if sum(p in some for some in touching) >= _ALWAYS * len(touching)}
    met = [(q, some - always) for q, some in zip(postures, touching, strict=True)]
    free = [q for q, some in met if not some]
    free = free or [q for q, some in met if all(_STAND in pair for pair in some)]
    if not free:
        often = max(pairs - always, key=lambda p: sum(p in some for some in touching))
        raise CatalogueError(
            f"no posture of {len(postures)} is free of contacts of the arm with itself; most often "
            f"{' and '.join(sorted(often))} touch: name the pair in 'exclude' if they may"
        )
    home = max(free, key=arm.quality)
    named = sorted((min(pair), max(pair)) for pair in always)
    return PostureSurvey(tuple(named), home, arm.gravity(home), most, arm.inertia(home))


def _on_a_stand(robot: Robot) -> mujoco.MjSpec:
    """The arm on a pedestal, which the link that is mounted there may touch."""
    spec = robot_spec(robot, visuals=False)
    stand = spec.worldbody.add_body(name=_STAND, pos=(0.0, 0.0, -_STAND_SIZE[2]))
    stand.add_geom(name=_STAND, type=mujoco.mjtGeom.mjGEOM_BOX, size=_STAND_SIZE)
    first = spec.joint(robot.joints[0]).parent.name
    spec.add_exclude(bodyname1=_STAND, bodyname2=first)
    return spec


def _postures(robot: Robot) -> list[Vector]:
    """The middle, zero, and some by chance, in whole degrees within the limits."""
    rng = np.random.default_rng(0)
    lower, upper = robot.limits.lower, robot.limits.upper
    room = np.minimum(_ROOM, (upper - lower) / 8)
    low, high = np.maximum(lower + room, -np.pi), np.minimum(upper - room, np.pi)
    low, high = np.minimum(low, high), np.maximum(low, high)
    drawn = rng.uniform(low, high, (_POSTURES, robot.dof))
    several = [np.clip(np.zeros(robot.dof), low, high), (low + high) / 2, *drawn]
    return [np.clip(np.radians(np.round(np.degrees(q))), lower, upper) for q in several]


class _Arm:
    """One arm alone in MuJoCo."""

    def __init__(self, model: mujoco.MjModel, robot: Robot) -> None:
        self.model, self.robot = model, robot
        self.data = mujoco.MjData(model)
        self.ids = np.array([int(model.joint(name).qposadr[0]) for name in robot.joints])
        self.site = model.site(TOOL_SITE).id

    def _at(self, q: Vector) -> None:
        self.data.qpos[self.ids] = q
        mujoco.mj_fwdPosition(self.model, self.data)

    def touching(self, q: Vector) -> set[frozenset[str]]:
        """Pairs of links that touch."""
        self._at(q)
        bodies = self.model.geom_bodyid
        return {
            frozenset(self.model.body(int(bodies[geom])).name for geom in contact.geom)
            for contact in itertools.islice(self.data.contact, self.data.ncon)
        }

    def gravity(self, q: Vector) -> Vector:
        """Torques that hold the arm, N m, of shape (dof,)."""
        self._at(q)
        self.data.qvel[:] = 0.0
        mujoco.mj_fwdVelocity(self.model, self.data)
        torques: Vector = self.data.qfrc_bias[self.ids].copy()
        return torques

    def inertia(self, q: Vector) -> Vector:
        """Diagonal of the mass matrix, kg m², of shape (dof,)."""
        self._at(q)
        mass = np.empty((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, mass)
        diagonal: Vector = np.diag(mass)[self.ids].copy()
        return diagonal

    def quality(self, q: Vector) -> float:
        """How well the arm can move on from a posture: free of limits and of singularities."""
        self._at(q)
        jacobian = np.empty((6, self.model.nv))
        mujoco.mj_jacSite(self.model, self.data, jacobian[:3], jacobian[3:], self.site)
        values = np.linalg.svd(jacobian[:, self.ids], compute_uv=False)
        limits = self.robot.limits
        room = np.minimum(q - limits.lower, limits.upper - q) / (limits.upper - limits.lower)
        weight = np.abs(self.gravity(q)) / limits.effort
        strength = max(0.01, 1.0 - float(weight.max()))
        return float(values[-1] / values[0] * min(room.min(), 0.15) * strength)
