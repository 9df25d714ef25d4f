"""Inertial loads of what moves with an arm's tool."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.arm.time_scale import link_motion
from bt_dualarm.core.pose import Vector
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.trajectory import Trajectory
from tests.sim.worlds import arm, file_of

DT = 0.004


def test_moments_are_the_change_of_the_angular_momentum() -> None:
    """All joints of a UR5 swing; the momentum follows from the Jacobian, its change from 4 ms."""
    nominal = World(file_of({"arm1": arm("ur5", (0.0, 0.0, 0.0))})).nominal["arm1"]
    amplitude = np.array((0.5, 0.3, 0.4, 0.6, 0.5, 0.8))[None]
    rate = np.array((2.0, 3.0, 2.5, 4.0, 3.0, 5.0))[None]
    t = DT * np.arange(301)[:, None]
    q = amplitude * np.cos(rate * t) + (0.0, -1.0, 1.0, 0.5, 1.2, 0.0)
    v = -amplitude * rate * np.sin(rate * t)
    moved = link_motion(
        Trajectory(DT, q, v, -(rate**2) * amplitude * np.cos(rate * t)), nominal, np.zeros(3)
    )
    inertia = np.array(((0.02, 0.003, 0.0), (0.003, 0.05, 0.004), (0.0, 0.004, 0.06)))

    def momentum(row: int) -> Vector:
        turn = nominal.tool_link_pose_at(q[row]).rotation_matrix
        spinning = nominal.tool_jacobian_at(q[row])[3:] @ v[row]
        found: Vector = turn @ inertia @ turn.T @ spinning
        return found

    moments = np.einsum("nij,nj->ni", moved.turns, moved.moments(inertia))
    inner = range(3, len(moments) - 3)
    rows = [3 * sample for sample in inner]  # samples are 12 ms apart
    expected = [(momentum(row + 1) - momentum(row - 1)) / (2.0 * DT) for row in rows]
    assert moments[inner] == pytest.approx(np.array(expected), abs=5e-3)
    assert np.abs(expected).max() > 0.5
