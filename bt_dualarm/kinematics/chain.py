"""Kinematic chain of an arm: tool pose, Jacobian, distance from singularities and joint limits.

- `Chain` evaluates any configuration with PlaCo, and `Mechanism` those of several arms at once.
- `Posture` watches a simulated arm for singularities and joint limits, with MuJoCo's Jacobian.

PlaCo never frees the memory of a robot model: unused models are kept for the next user of the same
URDF.
"""

from __future__ import annotations

import warnings
import weakref
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from functools import cached_property
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.robots.robot import Robot
from bt_dualarm.sim.world import World

with warnings.catch_warnings():
    # Pinocchio 3.8, which PlaCo brings, imports a module that has been renamed.
    warnings.simplefilter("ignore", DeprecationWarning)
    import placo

__all__ = [
    "MOST_IDLE",
    "NEAR_LIMIT",
    "SINGULAR_CONDITION",
    "TOOL",
    "Chain",
    "Mechanism",
    "Posture",
    "broken",
    "origin",
    "placo",
    "with_tool",
]

TOOL = "tool/frame"
"""Name of the tool frame that is added to the chain; no link's name contains a slash."""

SINGULAR_CONDITION = 50.0
"""Condition number of the Jacobian from which an arm counts as singular, and moves at half speed:
its worst direction needs fifty times the joint rates of its best. A UR5 has 8 in its home posture,
and 50 within 14° of a straight elbow, 5 mm before the end of its reach."""

_AT_LIMIT = 0.02
"""Distance from a position limit at which a joint counts as the reason of a broken path, rad."""

NEAR_LIMIT = 0.01
"""Distance of a joint from its position limit below which an arm moves at half speed, rad."""

MOST_IDLE: Final = 16
"""Maximum number of unused models that are kept for reuse."""

_PARTS = ("joints", "lower", "upper", "placo", "_lent", "_q_ids", "v_ids")
"""Attributes of a `Mechanism`, without those of its subclasses."""


class Mechanism:
    """Joints and links of a URDF in PlaCo, in the last configuration that was evaluated.

    Results never depend on that configuration.

    Args:
        urdf: URDF text without geometry.
        joints: Names of the movable joints.
        lower: Lower position limits, of shape (dof,), rad.
        upper: Upper position limits, of shape (dof,), rad.
    """

    def __init__(self, urdf: str, joints: Sequence[str], lower: Vector, upper: Vector) -> None:
        self.joints = tuple(joints)
        self.lower = lower
        self.upper = upper
        self._lent = _Lent(urdf)
        self.placo = self._lent.model.placo
        # The model may come from another user, with other limits.
        for name, least, most in zip(joints, lower, upper, strict=True):
            self.placo.set_joint_limits(name, least, most)
        self._q_ids = np.array([self.placo.get_joint_offset(name) for name in joints])
        self.v_ids = np.array([self.placo.get_joint_v_offset(name) for name in joints])

    @property
    def bare(self) -> Mechanism:
        """Mechanism that shares this one's joints, links and state.

        For solvers owned by this mechanism: if they referred to their owner, both would stay in
        memory until Python's cycle collector runs.
        """
        bare = object.__new__(Mechanism)
        vars(bare).update((name, vars(self)[name]) for name in _PARTS)
        return bare

    @property
    def dof(self) -> int:
        """Number of movable joints."""
        return len(self._q_ids)

    @property
    def state(self) -> Vector:
        """Copy of PlaCo's current configuration, of shape (dof,), rad."""
        q: Vector = self.placo.state.q[self._q_ids]
        return q

    def set_state(self, q: Vector) -> None:
        """Set PlaCo's configuration, of shape (dof,), rad."""
        self.placo.state.q[self._q_ids] = q
        self.placo.update_kinematics()

    def frame(self, name: str) -> Matrix:
        """Transform of a link in the world in the current configuration, of shape (4, 4)."""
        matrix: Matrix = self.placo.get_T_world_frame(name)
        return matrix


class Chain(Mechanism):
    """Kinematic chain of one arm: joint positions to tool pose and Jacobian, in the world.

    Args:
        robot: Robot description.
        base: Pose of its base link in the world.
        room: Margin by which joints stay away from their position limits, rad.
    """

    def __init__(self, robot: Robot, base: Pose, room: float = 0.0) -> None:
        self.robot = robot
        self.base = base
        limits = robot.limits
        super().__init__(with_tool(robot), robot.joints, limits.lower + room, limits.upper - room)
        self.placo.set_T_world_frame(robot.base_link, base.matrix)

    def matrix(self, q: Vector) -> Matrix:
        """Homogeneous transform of the tool in the world at ``q``, of shape (4, 4)."""
        self.set_state(q)
        return self.frame(TOOL)

    def forward(self, q: Vector) -> Pose:
        """Pose of the tool in the world at ``q``, of shape (dof,), rad."""
        return Pose.from_matrix(self.matrix(q))

    def jacobian(self, q: Vector) -> Matrix:
        """Jacobian of the tool in world axes, linear velocity first, of shape (6, dof)."""
        self.set_state(q)
        jacobian: Matrix = self.placo.frame_jacobian(TOOL, "local_world_aligned")[:, self.v_ids]
        return jacobian

    def tool(self, q: Vector) -> tuple[Matrix, Matrix]:
        """Results of ``matrix`` and ``jacobian``, at the cost of one of them."""
        jacobian = self.jacobian(q)
        return self.frame(TOOL), jacobian

    def condition(self, q: Vector) -> float:
        """Condition number of the Jacobian: largest over smallest singular value; may be infinite.

        Meters and radians have equal weight.
        """
        values = np.linalg.svd(self.jacobian(q), compute_uv=False)
        return float(values[0] / values[-1]) if values[-1] > 0.0 else float("inf")

    def room(self, q: Vector) -> float:
        """Distance in rad from ``q``, of shape (dof,) or (n, dof), to the nearest joint limit."""
        limits = self.robot.limits
        return float(np.minimum(q - limits.lower, limits.upper - q).min())

    @cached_property
    def bounding_ball(self) -> tuple[Vector, float]:
        """Outer bound of the workspace: center in the world, of shape (3,), and radius in m.

        A ball around the first joint whose radius is the sum of distances from joint to joint to
        tool (triangle inequality): the tool may not reach all of it, but nothing beyond.
        """
        children = {
            str(joint.get("name")): str(child.get("link"))
            for joint in ET.fromstring(self.robot.urdf_text).iter("joint")  # noqa: S314 # our own
            for child in joint.iter("child")
        }
        self.set_state(self.robot.postures["home"])
        positions = [self.frame(children[name])[:3, 3] for name in self.joints]
        # Distances from joint to joint are the same in every configuration: any will do.
        steps = np.diff([*positions, self.frame(TOOL)[:3, 3]], axis=0)
        return positions[0].copy(), float(np.linalg.norm(steps, axis=1).sum())


def with_tool(robot: Robot) -> str:
    """URDF text of a robot with the tool frame added as a link."""
    tool = (
        f'<link name="{TOOL}"/><joint name="{TOOL}_joint" type="fixed">'
        f'{origin(robot.tool)}<parent link="{robot.tool_link}"/>'
        f'<child link="{TOOL}"/></joint></robot>'
    )
    return robot.urdf_text.replace("</robot>", tool)


def origin(pose: Pose) -> str:
    """URDF ``origin`` element of a pose."""
    xyz = " ".join(map(repr, pose.position.tolist()))
    rpy = " ".join(map(repr, pose.rpy))
    return f'<origin xyz="{xyz}" rpy="{rpy}"/>'


class Posture:
    """Distance of a simulated arm from singularities and joint limits, and the speed it allows.

    To be rebuilt after the world is recompiled.

    Args:
        world: World that contains the arm.
        arm: Name of the arm.

    Attributes:
        room: Distance to the nearest position limit at the last `look`, rad.
        condition: Condition number of the tool's Jacobian at the last `look`.
    """

    def __init__(self, world: World, arm: str) -> None:
        self._world = world
        self._body = world.arms[arm]
        self._limits = world.robots[arm].limits
        self._jacobian = np.zeros((6, world.model.nv))
        self.room = float("inf")
        self.condition = 1.0

    def look(self) -> None:
        """Update ``room`` and ``condition`` from the sensed joint positions."""
        limits = self._limits
        body = self._body
        model = self._world.model
        data = self._world.sensed
        q = data.qpos[body.qpos_ids]
        self.room = float(min((q - limits.lower).min(), (limits.upper - q).min()))
        # Jacobians refer to centers of mass, which the kinematics alone does not update.
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacSite(model, data, self._jacobian[:3], self._jacobian[3:], body.tool_site)
        values = np.linalg.svd(self._jacobian[:, body.dof_ids], compute_uv=False)
        self.condition = float(values[0] / max(values[-1], 1e-9))

    @property
    def time_scale(self) -> tuple[float, str]:
        """Time scale of a motion along a path, and the reason if it is less than 1."""
        if self.condition > SINGULAR_CONDITION:
            return 0.5, f"condition {self.condition:.0f}"
        if self.room < NEAR_LIMIT:
            return 0.5, f"{self.room:.3f} rad from a limit"
        return 1.0, ""


def broken(arm: Chain, q: Vector, pose: Pose, fraction: float, branches: int) -> Failure:
    """Failure for a path that cannot be followed to its end.

    Args:
        arm: Arm that should follow it.
        q: Configuration at the last sample that could be followed, of shape (dof,), rad.
        pose: First pose that could not.
        fraction: Share of the path up to there.
        branches: Number of start configurations that were tried.

    Returns:
        ``SINGULAR`` if the arm is singular at ``q``, else ``PATH_BROKEN``.
    """
    position = ", ".join(f"{x:.3f}" for x in pose.position)
    how_far = f"the arm can follow only {100.0 * fraction:.0f} % of the path, to ({position}) m"
    numbers = {"fraction": fraction, "branches": branches}
    condition = min(arm.condition(q), 1e12)  # JSON has no infinity
    if condition > SINGULAR_CONDITION:
        return Failure(
            "SINGULAR", f"{how_far}: it is singular there", **numbers, condition=condition
        )
    room = np.minimum(q - arm.lower, arm.upper - q)
    joint = int(np.argmin(room))
    why = f": {arm.robot.joints[joint]} is at its limit" if room[joint] < _AT_LIMIT else ""
    return Failure("PATH_BROKEN", how_far + why, **numbers)


class _Model:
    """Robot model of PlaCo, with its URDF for reuse."""

    def __init__(self, urdf: str) -> None:
        self.urdf = urdf
        self.placo = placo.RobotWrapper("", placo.Flags.ignore_collisions, urdf)
        self._first = self.placo.state.q.copy()

    def reset(self) -> None:
        """Restore the initial state; position limits are set by the next user."""
        self.placo.state.q[:] = self._first
        self.placo.update_kinematics()


_idle: list[_Model] = []


class _Lent:
    """Holds a model until the last reference to this object is gone."""

    def __init__(self, urdf: str) -> None:
        self.model = model = _taken(urdf) or _Model(urdf)
        weakref.finalize(self, _give_back, model).atexit = False


def _taken(urdf: str) -> _Model | None:
    """Unused model of this URDF in its initial state; None if there is none."""
    for model in tuple(_idle):
        if model.urdf == urdf:
            try:
                _idle.remove(model)
            except ValueError:  # another thread was faster
                continue
            model.reset()
            return model
    return None


def _give_back(model: _Model) -> None:
    """Keep a model for reuse; the oldest unused one is dropped if there are too many."""
    _idle.append(model)
    if len(_idle) > MOST_IDLE:
        _idle.pop(0)
