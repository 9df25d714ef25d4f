"""Kernels of the control loop agree with the same functions in plain Python."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys

import pytest

from bt_dualarm.control.kernel_rows import COMMANDED, NOT_FINITE, SATURATED
from tests.kinematics.moved import moved
from tests.source import ROOT

SEEDS = range(3)


def test_compiled_kernels_agree_with_plain_python() -> None:
    """Outcomes are equal, and numbers are equal except for rounding."""
    command = [sys.executable, "-m", "tests.kinematics.moved", *map(str, SEEDS)]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    found = set()
    for seed, (outcomes, states) in zip(SEEDS, pickle.loads(done.stdout), strict=True):  # noqa: S301
        compiled = moved(seed)
        assert compiled[0] == outcomes
        assert compiled[1] == pytest.approx(states, rel=1e-9, abs=1e-9, nan_ok=True)
        found |= set(outcomes)
    assert found == {COMMANDED, SATURATED, NOT_FINITE}
