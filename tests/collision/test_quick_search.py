"""The compiled search finds free paths, and the same ones each time."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys

import mujoco
import numpy as np
import pytest

from bt_dualarm.collision.distance_kernels import SCRATCH, distance
from bt_dualarm.collision.swept import is_path_free
from bt_dualarm.collision.swept_kernels import first_too_near, free_share
from bt_dualarm.planning.path_search import warm_up_edges, warm_up_search
from bt_dualarm.planning.rrt_kernels import connect
from tests.collision.cluttered import found, small_search
from tests.source import ROOT

SEEDS = range(3)


def test_compiled_kernels_agree_with_plain_python() -> None:
    command = [sys.executable, "-m", "tests.collision.cluttered", *map(str, SEEDS)]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    for seed, (path, states) in zip(SEEDS, pickle.loads(done.stdout), strict=True):  # noqa: S301
        compiled, checked = found(seed)
        assert checked == states
        assert compiled == pytest.approx(path, abs=1e-12)


def test_path_leads_from_the_start_to_a_goal_and_is_free() -> None:
    for seed in SEEDS:
        path, _ = found(seed)
        assert path[0] == pytest.approx((0.3, 0.0), abs=0.0)
        assert path[-1] == pytest.approx((-2.8, 0.1), abs=0.0)
        edges = small_search(seed)[1]
        assert is_path_free(edges, path)
        assert not edges.is_free(path[0], path[-1])


def test_path_depends_on_the_seed_alone() -> None:
    assert (found(0)[0] == found(0)[0]).all()
    assert not np.array_equal(found(0)[0], found(1)[0])


def test_search_ends_after_its_checks_and_when_abandoned() -> None:
    search, edges = small_search(0)
    assert search.path(3, lambda: False) is None
    assert edges.checked < 60
    assert small_search(0)[0].path(2_000, lambda: True) is None


def test_warm_up_compiles_the_code_that_a_search_uses() -> None:
    """Each kernel has one compiled version, so nothing is compiled during a run."""
    warm_up_search()
    warm_up_edges()
    found(0)
    for kernel in (connect, free_share, first_too_near):
        assert len(vars(kernel)["overloads"]) == 1


def test_distances_are_lower_bounds_and_nearly_exact() -> None:
    """The reference is MuJoCo's distance of meshes, for hulls of random points."""
    rng = np.random.default_rng(3)
    for _ in range(12):
        one, other = rng.normal(0.0, 0.1, (2, 14, 3))
        other += rng.normal(0.0, 0.4, 3)
        corners = np.vstack((one, other))
        ranges = np.array(((0, 14, 0), (14, 28, 0)))
        frames = np.eye(3, 4)[None].copy()
        hints = np.array(((0.1, 0.2, 0.3),))
        scratch = np.empty(SCRATCH)
        found = distance(corners, ranges, frames, 0, 1, 10.0, 0.0, hints, 0, scratch)
        true = _distance_by_mujoco(one, other)
        if true <= 0.0:
            assert found < 0.0
        else:
            assert true - 2e-4 * true - 1e-6 < found < true + 1e-6


def _distance_by_mujoco(one: np.ndarray, other: np.ndarray) -> float:
    spec = mujoco.MjSpec()
    for name, points in (("one", one), ("other", other)):
        spec.add_mesh(name=name, uservert=points.ravel())
        spec.worldbody.add_body(name=name).add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    # Compilation moves a mesh's frame, and the geom with it, to the mesh's center.
    return float(mujoco.mj_geomDistance(model, data, 0, 1, 10.0, None))
