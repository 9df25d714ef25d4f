"""What the kernels of grippers mean: the same functions, read by Python itself."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys

import pytest

from tests.source import ROOT
from tests.world.grippers.passed import passed

SEEDS = range(2)


def test_compiled_kernels_do_what_plain_python_does() -> None:
    """Numbers are the same but for rounding; something was held, and moved."""
    command = [sys.executable, "-m", "tests.world.grippers.passed", *map(str, SEEDS)]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    for seed, found in zip(SEEDS, pickle.loads(done.stdout), strict=True):  # noqa: S301
        assert passed(seed) == pytest.approx(found, rel=1e-9, abs=1e-12)
        assert {-1.0, 3.0, 5.0} <= set(found[:, :2].ravel().tolist())
