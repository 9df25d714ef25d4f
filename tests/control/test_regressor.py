"""Torques are linear in the inertial numbers of the links, and of what is held."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.path_reality import curves, world_of
from bt_dualarm.control.dynamics import ArmDynamics
from bt_dualarm.control.payload_estimation import TorqueRegressor, inertial_parameters
from bt_dualarm.skill.registry import Registry
from tests.sim.worlds import WIDE

KINDS = Registry.load().kinds


@pytest.mark.parametrize("robot", WIDE)
def test_columns_times_numbers_are_inverse_dynamics(robot: str) -> None:
    """Rotors aside, which are no links; a load is so many numbers more on the last of them."""
    world = world_of(robot, next(curves(robot))[0], "lab", "known", 0, KINDS)
    nominal = world.nominal["arm1"]
    (load,) = nominal.loads
    assert load.mass is not None
    assert load.inertia is not None
    regressor = TorqueRegressor(nominal)
    held = inertial_parameters(load.mass, load.inertia, regressor.tool_link @ load.pose)
    for q, v, a in np.random.default_rng(5).uniform(-2, 2, (5, 3, nominal.model.nv)):
        rotors = nominal.model.dof_armature * a
        columns = regressor(q, v, a)
        arm = np.einsum("jbk,bk->j", columns, regressor.links) + rotors
        assert arm == pytest.approx(ArmDynamics(nominal).moving(q, v, a), abs=1e-9)
        both = arm + columns[:, -1] @ held
        assert both == pytest.approx(ArmDynamics(nominal, (load,)).moving(q, v, a), abs=1e-9)


@pytest.mark.parametrize("robot", WIDE)
def test_inverse_dynamics_undo_forward_dynamics(robot: str) -> None:
    """The rotors' inertia is in both."""
    world = world_of(robot, next(curves(robot))[0], "lab", "known", 0, KINDS)
    nominal = world.nominal["arm1"]
    dynamics = ArmDynamics(nominal, nominal.loads)
    q, v, a = np.random.default_rng(6).uniform(-1, 1, (3, nominal.model.nv))
    torques = dynamics.moving(q, v, a)
    dynamics.update(q, v)
    assert dynamics.accelerations(torques - dynamics.bias) == pytest.approx(a, abs=1e-9)
