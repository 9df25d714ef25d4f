"""Causes of failures with parts that move on a joint: doors, drawers, lids and levers."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.core.pose import Vector
from bt_dualarm.diagnosis.evidence import LOOK_BACK_S, Cause, Evidence
from bt_dualarm.replay.timeline import Scene
from bt_dualarm.spec.joints import moved_name

_STUCK_CODES: Final = frozenset(
    {"BLOCKED", "FORCE_LIMIT", "NOT_REACHED", "SLIPPED", "DROPPED", "TRACKING_ERROR"}
)
"""Codes of a leaf whose joint did not come to its goal."""

_STIFF: Final = 0.6
"""Smallest share of the allowed force that the joint resists with, to be named as too stiff: the
rest goes into the arm's own friction and the acceleration."""

_FIRM: Final = 0.85
"""Share of the allowed force below which the leaf stopped for the grip, not for that force."""

_MOST_FORCE_N: Final = 200.0
"""Largest `force` that can be allowed."""

_AT_END: Final = {True: math.radians(0.6), False: 1.5e-3}
"""Distance from the end of its range at which a joint has reached it, rad for a hinge, m."""

_LEAST_LEVER_M: Final = 0.01


@dataclass(frozen=True, eq=False)
class MovedJoint:
    """A joint that moves parts of an object, in the world at one time; the truth, for diagnosis.

    Args:
        scene: The world.
        name: Name of the object that the joint moves.

    Raises:
        KeyError: There is no such object, or it moves on no joint.
    """

    scene: Scene
    name: str

    def __post_init__(self) -> None:
        if not self.scene.has(self.name) or self.scene.model.body(self.name).jntnum[0] != 1:
            raise KeyError(self.name)

    @property
    def _id(self) -> int:
        return int(self.scene.model.body(self.name).jntadr[0])

    @property
    def is_hinge(self) -> bool:
        """Whether it turns."""
        return bool(self.scene.model.jnt_type[self._id] == mujoco.mjtJoint.mjJNT_HINGE)

    @property
    def position(self) -> float:
        """Position, rad or m."""
        return float(self.scene.data.qpos[self.scene.model.jnt_qposadr[self._id]])

    @property
    def limits(self) -> tuple[float, float]:
        """Least and largest position, rad or m."""
        low, high = self.scene.model.jnt_range[self._id].tolist()
        return low, high

    @property
    def axis(self) -> Vector:
        """Unit vector along the axis in the world, of shape (3,)."""
        found: Vector = self.scene.data.xaxis[self._id].copy()
        return found

    def direction(self, point: Vector) -> Vector:
        """Velocity of a point of the part, of shape (3,), m, per unit of the joint."""
        if not self.is_hinge:
            return self.axis
        return np.asarray(np.cross(self.axis, point - self.scene.data.xanchor[self._id]), float)

    def point_at(self, point: Vector, position: float) -> Vector:
        """Where a point of the part is in the world at another position of the joint."""
        moved = position - self.position
        if not self.is_hinge:
            return np.asarray(point + moved * self.axis, float)
        anchor = self.scene.data.xanchor[self._id]
        arm = point - anchor
        axis = self.axis
        along = (axis @ arm) * axis
        across = arm - along
        turned = math.cos(moved) * across + math.sin(moved) * np.cross(axis, across)
        return np.asarray(anchor + along + turned, float)

    def resistances(self, speed: float, sign: float) -> dict[str, float]:
        """What resists a motion by its source, N or N m; friction first.

        Args:
            speed: Largest speed of the motion, rad/s or m/s.
            sign: Sign of the motion.
        """
        model, data = self.scene.model, self.scene.data
        joint = self._id
        dof = int(model.jnt_dofadr[joint])
        static = np.zeros(model.nv)
        before = data.qvel.copy()
        data.qvel[:] = 0.0
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 0, static)
        data.qvel[:] = before
        rest = float(model.qpos_spring[model.jnt_qposadr[joint]])
        stiffness = float(np.atleast_1d(model.jnt_stiffness[joint])[0])
        return {
            "friction": float(model.dof_frictionloss[dof]),
            "spring": max(sign * stiffness * (self.position - rest), 0.0),
            "damping": float(np.atleast_1d(model.dof_damping[dof])[0]) * speed,
            "weight": max(sign * float(static[dof]), 0.0),
        }

    def text_of(self, position: float) -> str:
        """Position as text."""
        if self.is_hinge:
            return f"{math.degrees(position):.0f}°"
        return f"{1e3 * position:.0f} mm"

    def obstacles(self, sign: float) -> list[str]:
        """Bodies that touch the part, and push against its motion; arms are left out."""
        model, data = self.scene.model, self.scene.data
        body = int(model.body(self.name).id)
        owner = self.name.rpartition(".")[0]
        found = []
        for contact in data.contact[: data.ncon]:
            bodies = [int(model.geom_bodyid[geom]) for geom in contact.geom]
            if body not in bodies or contact.dist > 0.0:
                continue
            is_first = bodies[0] == body
            other = str(model.body(bodies[1] if is_first else bodies[0]).name) or "world"
            if other == owner or "/" in other:
                continue
            # The normal points from the first geom to the second one: out of the part, if first.
            out = contact.frame[:3] * (1.0 if is_first else -1.0)
            forward = sign * self.direction(contact.pos)
            size = float(np.linalg.norm(forward))
            if size > 1e-9 and float(out @ forward) > 0.5 * size:
                found.append(other)
        return found


def joint_causes(e: Evidence) -> Iterator[Cause]:
    """Yields causes that kept a leaf from moving a joint of an object."""
    if e.leaf.kind != "operate":
        return
    owner = str(e.ports["object"])
    name = moved_name(owner, str(e.ports["joint"]))
    if e.code == "INVALID_TARGET":
        remedy = "a `to` within the range, or a wider `range` of the joint"
        yield e.cause("OUT_OF_RANGE", e.reason, remedy)
    if e.code not in _STUCK_CODES:
        return
    began = MovedJoint(e.scene(e.began), name)
    ended = MovedJoint(e.scene(e.ended), name)
    to = float(e.ports["to"])
    goal = math.radians(to) if ended.is_hinge else to
    sign = math.copysign(1.0, goal - began.position)
    where = f"{name} stopped at {ended.text_of(ended.position)} on its way to {ended.text_of(goal)}"
    in_way = _in_the_way(e, name, sign)
    if in_way:
        sentence = f"{in_way} is in the path of {name}: {where}"
        remedy = f"move {in_way} away, or a `to` before it"
        yield e.cause("IN_THE_WAY", sentence, remedy)
    else:
        yield from _too_stiff(e, name, sign, where)
    low, high = ended.limits
    end = high if sign > 0.0 else low
    is_at_end = abs(ended.position - end) < _AT_END[ended.is_hinge]
    if is_at_end and abs(goal - ended.position) < _AT_END[ended.is_hinge] and not in_way:
        believed = e.numbers.get("joint_rad" if ended.is_hinge else "joint_m")
        is_known = believed is not None and abs(float(believed) - end) < _AT_END[ended.is_hinge]
        sentence = f"{name} is at the end of its range, {ended.text_of(end)}"
        remedy = "a `to` before the end of the range, or a larger `tolerance`"
        if not is_known:
            sentence += f", and {e.arm} believes it to be elsewhere"
            remedy = f"`sensor: true`, or let `locate` find {owner} before"
        sentence += f": {e.reason}"
        yield e.cause("AT_ITS_END", sentence, remedy)
    if e.code in ("SLIPPED", "DROPPED"):
        sentence = f"the part of {name} slid out of the hand: {where}; {e.reason}"
        remedy = "a handle that stops the fingers, `grasp` with more `most_force`, or less `speed`"
        yield e.cause("HANDLE_SLIPPED", sentence, remedy)


def _in_the_way(e: Evidence, name: str, sign: float) -> str:
    """Body that most often pushed against the part in the last second; empty if none did."""
    found: Counter[str] = Counter()
    for scene in e.moments(25, since=max(e.ended - LOOK_BACK_S, e.began)):
        found.update(set(MovedJoint(scene, name).obstacles(sign)))
    return found.most_common(1)[0][0] if found else ""


def _too_stiff(e: Evidence, name: str, sign: float, where: str) -> Iterator[Cause]:
    """Yields a cause if what the joint resists with is about what the leaf allows."""
    allowed = float(e.ports.get("force", 40.0))
    worst: dict[str, float] = {}
    for scene in e.moments(12):
        joint = MovedJoint(scene, name)
        tool = scene.tool(e.arm)
        lever = 1.0
        if joint.is_hinge and tool is not None:
            lever = max(float(np.linalg.norm(joint.direction(tool))), _LEAST_LEVER_M)
        speed = float(e.ports.get("tool_speed", 0.12)) / lever
        forces = {source: value / lever for source, value in joint.resistances(speed, sign).items()}
        if sum(forces.values()) > sum(worst.values()):
            worst = forces
    needed = sum(worst.values())
    felt = float(e.numbers.get("force_n", allowed))
    if e.code in ("BLOCKED", "FORCE_LIMIT") and felt < _FIRM * allowed and felt < 1.5 * needed:
        sentence = (
            f"the grip of {e.arm} bears {felt:.0f} N, less than the {allowed:g} N that the leaf "
            f"allows, and the joint resists with {needed:.0f} N; {where}"
        )
        remedy = "`grasp` with a larger `most_force`, or a rougher handle"
        yield e.cause("WEAK_GRIP", sentence, remedy)
        return
    if needed < _STIFF * allowed:
        return
    most = max(worst, key=lambda source: worst[source])
    parts = ", ".join(f"{force:.0f} N by {one}" for one, force in worst.items() if force >= 0.5)
    sentence = (
        f"{name} is too stiff: its joint resists with {needed:.0f} N ({parts}), and the leaf "
        f"allows {allowed:g} N; {where}"
    )
    wanted = math.ceil(needed / _STIFF / 5.0) * 5.0
    remedy = f"less {most} of the joint"
    if wanted <= _MOST_FORCE_N:
        remedy = f"force: {wanted:g}, or {remedy}"
    if most == "damping":
        remedy += ", or a lower tool_speed"
    yield e.cause("TOO_STIFF", sentence, remedy)
