"""Compiled kernels of a servo agree with the same functions in plain Python."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys

import pytest

from tests.source import ROOT
from tests.trajectory.served import served

ROBOTS = ("panda", "ur5")


def test_compiled_kernels_agree_with_plain_python() -> None:
    """Set-points agree up to rounding."""
    command = [sys.executable, "-m", "tests.trajectory.served", *ROBOTS]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    for robot, sent in zip(ROBOTS, pickle.loads(done.stdout), strict=True):  # noqa: S301
        assert served(robot) == pytest.approx(sent, rel=1e-9, abs=1e-9)
