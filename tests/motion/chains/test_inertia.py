"""A chain has the places, the inertia and the bias that MuJoCo has of the same arm."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from bt_dualarm.motion.chains.inertia_kernels import equations, solve, times
from bt_dualarm.motion.chains.links import links_of
from bt_dualarm.motion.chains.place_kernels import place
from bt_dualarm.motion.control.dynamics import ArmDynamics
from bt_dualarm.pose import Pose
from bt_dualarm.world.nominal.nominal_load import NominalLoad
from bt_dualarm.world.world import World
from tests.world.worlds import ROBOTS, arm, box, file_of

LOAD = NominalLoad.of("cube", box((0, 0, 0), mass=0.7), Pose.from_rpy((0.1, 0.2, 0.3)))


@pytest.mark.parametrize("loads", [(), (LOAD,)], ids=["bare", "loaded"])
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_chain_moves_as_mujoco_says(robot: str, loads: tuple[NominalLoad, ...]) -> None:
    """At random states, of a base that is turned and off the origin."""
    nominal = World(file_of({"arm1": arm(robot, (0.3, 0.2, 0.1), 30.0)})).nominal["arm1"]
    dynamics, rng = ArmDynamics(nominal, loads), np.random.default_rng(3)
    links, gravity, dof = links_of(dynamics.model), dynamics.model.opt.gravity, nominal.model.nv
    inertia, bias, product, found = np.empty((dof, dof)), *np.empty((3, dof))
    turns, axes, anchors = np.empty((dof, 9)), np.empty((dof, 3)), np.empty((dof, 3))
    for _ in range(5):
        q, v = rng.uniform(-2.0, 2.0, (2, dof))
        dynamics.update(q, v)
        equations(links, gravity, q, v, inertia, bias)
        assert inertia == pytest.approx(dynamics.inertia, abs=1e-11)
        assert bias == pytest.approx(dynamics.bias, abs=1e-10)
        times(inertia, v, product)
        assert product == pytest.approx(dynamics.inertia_times(v), abs=1e-10)
        solve(inertia, v, found)
        assert found == pytest.approx(dynamics.accelerations(v), rel=1e-8, abs=1e-8)
        place(links, q, turns, axes, anchors)
        mujoco.mj_kinematics(dynamics.model, dynamics.data)
        assert axes == pytest.approx(dynamics.data.xaxis, abs=1e-12)
        assert anchors == pytest.approx(dynamics.data.xanchor, abs=1e-12)
