"""Compiled kernels of sensors and drives agree with the same functions in plain Python."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys

import numpy as np
import pytest

from bt_dualarm.sim.device_kernels import apply_friction
from bt_dualarm.sim.devices import rows_of
from bt_dualarm.sim.kernel_arrays import FRICTION
from tests.sim.passed import passed
from tests.sim.worlds import ROBOTS, world_with
from tests.source import ROOT

SEEDS = range(2)


def test_compiled_kernels_agree_with_plain_python() -> None:
    """Numbers agree up to rounding."""
    command = [sys.executable, "-m", "tests.sim.passed", *map(str, SEEDS)]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    for seed, found in zip(SEEDS, pickle.loads(done.stdout), strict=True):  # noqa: S301
        assert passed(seed) == pytest.approx(found, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("robot", ROBOTS)
def test_simulated_joint_friction_follows_the_model(robot: str) -> None:
    """Dry friction and damping add up to the torque of the robot description, at any velocity."""
    friction = world_with(robot).robots["arm1"].friction
    rows = rows_of(friction)
    dof = len(friction.coulomb)
    assert rows.shape == (dof, FRICTION)
    where = np.stack((np.arange(dof), np.arange(dof)), axis=1)
    for v in np.random.default_rng(1).normal(size=(20, dof)):
        dry, damping = np.empty((2, len(v)))
        apply_friction(where, rows, v, dry, damping)
        assert dry * np.sign(v) + damping * v == pytest.approx(friction.torque(v), abs=1e-6)
