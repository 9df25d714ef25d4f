"""What the kernels of a servo mean: the same functions, read by Python itself."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys

import pytest

from tests.source import ROOT
from tests.trajectory.served import served

ROBOTS = ("panda", "ur5")


def test_compiled_kernels_do_what_plain_python_does() -> None:
    """Set-points are the same but for rounding."""
    command = [sys.executable, "-m", "tests.trajectory.served", *ROBOTS]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    for robot, sent in zip(ROBOTS, pickle.loads(done.stdout), strict=True):  # noqa: S301
        assert served(robot) == pytest.approx(sent, rel=1e-9, abs=1e-9)
