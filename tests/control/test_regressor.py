"""Torques are linear in the inertial parameters of the links and of the payload."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.path_reality import curves, world_of
from bt_dualarm.control.dynamics import ArmDynamics
from bt_dualarm.control.payload_estimation import TorqueRegressor, inertial_parameters
from bt_dualarm.skill.registry import Registry
from tests.sim.worlds import WIDE

NODE_TYPES = Registry.load().kinds


@pytest.mark.parametrize("robot", WIDE)
def test_regressor_times_parameters_is_inverse_dynamics(robot: str) -> None:
    """Rotors, which are not links, are added; the payload adds parameters to the last link."""
    world = world_of(robot, next(curves(robot))[0], "lab", "known", 0, NODE_TYPES)
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
    """Both include the rotors' inertia."""
    world = world_of(robot, next(curves(robot))[0], "lab", "known", 0, NODE_TYPES)
    nominal = world.nominal["arm1"]
    dynamics = ArmDynamics(nominal, nominal.loads)
    q, v, a = np.random.default_rng(6).uniform(-1, 1, (3, nominal.model.nv))
    torques = dynamics.moving(q, v, a)
    dynamics.update(q, v)
    assert dynamics.accelerations(torques - dynamics.bias) == pytest.approx(a, abs=1e-9)
