"""Joint frames, inertia and bias of a rigid-body chain agree with MuJoCo."""

from __future__ import annotations

from itertools import product

import mujoco
import numpy as np
import pytest

from bt_dualarm.control.dynamics import ArmDynamics
from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.chain_kernel_arrays import links_of
from bt_dualarm.kinematics.chain_kernels import equations_of_motion, multiply, place, solve
from bt_dualarm.sim.arm_models import NominalLoad
from bt_dualarm.sim.world import World
from tests.families import some
from tests.sim.worlds import ROBOTS, arm, box, file_of

LOAD = NominalLoad.of("cube", box((0, 0, 0), mass=0.7), Pose.from_rpy((0.1, 0.2, 0.3)))


@pytest.mark.parametrize(("robot", "loads"), some(product(ROBOTS, [(), (LOAD,)]), 3))
def test_chain_agrees_with_mujoco(robot: str, loads: tuple[NominalLoad, ...]) -> None:
    """Compared at random states, with a base that is rotated and away from the origin."""
    nominal = World(file_of({"arm1": arm(robot, (0.3, 0.2, 0.1), 30.0)})).nominal["arm1"]
    dynamics = ArmDynamics(nominal, loads)
    rng = np.random.default_rng(3)
    links = links_of(dynamics.model)
    gravity = dynamics.model.opt.gravity
    dof = nominal.model.nv
    inertia, bias, product, found = np.empty((dof, dof)), *np.empty((3, dof))
    turns = np.empty((dof, 9))
    axes = np.empty((dof, 3))
    anchors = np.empty((dof, 3))
    for _ in range(5):
        q, v = rng.uniform(-2.0, 2.0, (2, dof))
        dynamics.update(q, v)
        equations_of_motion(links, gravity, q, v, inertia, bias)
        assert inertia == pytest.approx(dynamics.inertia, abs=1e-11)
        assert bias == pytest.approx(dynamics.bias, abs=1e-10)
        multiply(inertia, v, product)
        assert product == pytest.approx(dynamics.inertia_times(v), abs=1e-10)
        solve(inertia, v, found)
        assert found == pytest.approx(dynamics.accelerations(v), rel=1e-8, abs=1e-8)
        place(links, q, turns, axes, anchors)
        mujoco.mj_kinematics(dynamics.model, dynamics.data)
        assert axes == pytest.approx(dynamics.data.xaxis, abs=1e-12)
        assert anchors == pytest.approx(dynamics.data.xanchor, abs=1e-12)
