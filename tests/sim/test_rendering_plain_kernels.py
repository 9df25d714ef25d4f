"""Compiled kernels of the ray caster agree with the same functions in plain Python."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys

import numpy as np
import pytest

from tests.sim.piles import rendered
from tests.source import ROOT

SEEDS = range(4)


def test_compiled_kernels_agree_with_plain_python() -> None:
    """Geoms and pixels are identical; distances agree up to rounding."""
    command = [sys.executable, "-m", "tests.sim.piles", *map(str, SEEDS)]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    met = set()
    for seed, (geoms, distances, image) in zip(SEEDS, pickle.loads(done.stdout), strict=True):  # noqa: S301
        mine = rendered(seed)
        assert (mine[0] == geoms).all()
        assert mine[1] == pytest.approx(distances, rel=1e-12)
        assert (mine[2] == image).all()
        met |= set(np.unique(geoms))
    assert met == set(range(-1, 9))  # the background, the floor, and each shape of a pile
