"""What the kernels of a chain mean: the same functions, read by Python itself."""

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


def test_compiled_kernels_do_what_plain_python_does() -> None:
    """Outcomes are the same, numbers but for rounding."""
    command = [sys.executable, "-m", "tests.kinematics.moved", *map(str, SEEDS)]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    found = set()
    for seed, (outcomes, states) in zip(SEEDS, pickle.loads(done.stdout), strict=True):  # noqa: S301
        mine = moved(seed)
        assert mine[0] == outcomes
        assert mine[1] == pytest.approx(states, rel=1e-9, abs=1e-9, nan_ok=True)
        found |= set(outcomes)
    assert found == {COMMANDED, SATURATED, NOT_FINITE}
