"""Joints and links in PlaCo: the state below forward and inverse kinematics."""

from __future__ import annotations

import warnings
import weakref
from collections.abc import Sequence
from typing import Final

import numpy as np

from bt_dualarm.pose import Matrix, Pose, Vector

__all__ = ["MOST_IDLE", "Mechanism", "origin", "placo"]

with warnings.catch_warnings():
    # Pinocchio 3.8, which PlaCo brings, imports a module that has been renamed.
    warnings.simplefilter("ignore", DeprecationWarning)
    import placo

_PARTS = ("joints", "lower", "upper", "placo", "_lent", "_q_ids", "v_ids")

MOST_IDLE: Final = 16
"""Models that wait for the next who needs one of their kind."""

_idle: list[_Model] = []


class _Model:
    """A robot in PlaCo: what it takes in memory PlaCo never gives back, so it is used again."""

    def __init__(self, urdf: str) -> None:
        self.urdf = urdf
        self.placo = placo.RobotWrapper("", placo.Flags.ignore_collisions, urdf)
        self._first = self.placo.state.q.copy()

    def begin_anew(self) -> None:
        """Be as if it had just been made, but for what whoever takes it sets."""
        self.placo.state.q[:] = self._first
        self.placo.update_kinematics()


class _Lent:
    """A model for as long as somebody refers to this."""

    def __init__(self, urdf: str) -> None:
        self.model = model = _taken(urdf) or _Model(urdf)
        weakref.finalize(self, _give_back, model).atexit = False


def _taken(urdf: str) -> _Model | None:
    """A model of this URDF that nobody uses, as if it were new."""
    for model in tuple(_idle):
        if model.urdf == urdf:
            try:
                _idle.remove(model)
            except ValueError:  # another thread was faster
                continue
            model.begin_anew()
            return model
    return None


def _give_back(model: _Model) -> None:
    """Keep a model for the next; the one that has waited longest goes where there are many."""
    _idle.append(model)
    if len(_idle) > MOST_IDLE:
        _idle.pop(0)


class Mechanism:
    """Joints and links, in the configuration that was asked for last: no result depends on it.

    Args:
        urdf: Text of a URDF without shapes.
        joints: Names of the joints that move.
        lower: Their lower position limits, of shape (dof,), rad.
        upper: Their upper ones, likewise.
    """

    def __init__(self, urdf: str, joints: Sequence[str], lower: Vector, upper: Vector) -> None:
        self.joints = tuple(joints)
        self.lower, self.upper = lower, upper
        self._lent = _Lent(urdf)
        self.placo = self._lent.model.placo
        for name, least, most in zip(joints, lower, upper, strict=True):
            self.placo.set_joint_limits(name, least, most)
        self._q_ids = np.array([self.placo.get_joint_offset(name) for name in joints])
        self.v_ids = np.array([self.placo.get_joint_v_offset(name) for name in joints])

    @property
    def bare(self) -> Mechanism:
        """These joints and links in a mechanism of their own, with which they share their state.

        For what a mechanism searches with: if that referred to its owner, both would stay in memory
        until Python looks for circles.
        """
        bare = object.__new__(Mechanism)
        vars(bare).update((name, vars(self)[name]) for name in _PARTS)
        return bare

    @property
    def dof(self) -> int:
        """Number of joints that move."""
        return len(self._q_ids)

    @property
    def state(self) -> Vector:
        """The configuration that PlaCo holds, a copy, of shape (dof,)."""
        q: Vector = self.placo.state.q[self._q_ids]
        return q

    def set_state(self, q: Vector) -> None:
        """Give PlaCo a configuration, of shape (dof,)."""
        self.placo.state.q[self._q_ids] = q
        self.placo.update_kinematics()

    def frame(self, name: str) -> Matrix:
        """A link in the world at the present state, of shape (4, 4)."""
        matrix: Matrix = self.placo.get_T_world_frame(name)
        return matrix


def origin(pose: Pose) -> str:
    """A pose as the ``origin`` of a URDF joint."""
    xyz = " ".join(map(repr, pose.position.tolist()))
    rpy = " ".join(map(repr, pose.rpy))
    return f'<origin xyz="{xyz}" rpy="{rpy}"/>'
