"""The content of ``summary.json``: result, processor and versions.

The printed report is a module of its own: runs from Python do without rich, which takes 43 ms to
import.
"""

from __future__ import annotations

import ctypes
import hashlib
import math
import platform
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import version
from types import MappingProxyType
from typing import Final, TypedDict

import numpy as np

from bt_dualarm.core.share import LARGEST_INT, encodable
from bt_dualarm.runtime.outcome import ArmResult, RunResult

# The kind of processor is part of the summary, because the last bits of the results depend on it.
# Processors of one kind compute the same bits from the same file and seed. On another kind, the C
# library (with or without fused multiply-add), NumPy's loops (by SIMD extension) and BLAS (by core)
# round differently: samples differ by about 1e-13, and the state hash differs.


_CORE_NAMES: Final = (
    "scipy_openblas_get_corename64_",
    "scipy_openblas_get_corename",
    "openblas_get_corename64_",
    "openblas_get_corename",
)
"""Names of OpenBLAS's ``openblas_get_corename`` in the builds that NumPy is linked to."""


class Processor(TypedDict):
    """Kind of a processor, JSON-ready.

    Attributes:
        machine: Architecture, for example ``x86_64``.
        simd: SIMD extensions that NumPy uses.
        blas: Core type that OpenBLAS detected; ``unknown`` for another BLAS.
        arithmetic: Fingerprint of results of the C library, NumPy and BLAS; hashes of runs are
            comparable only if it is equal.
    """

    machine: str
    simd: list[str]
    blas: str
    arithmetic: str


def processor() -> Processor:
    """Kind of the processor that this process runs on."""
    return {
        "machine": platform.machine(),
        "simd": _simd(),
        "blas": _blas_core(),
        "arithmetic": _fingerprint(),
    }


def _simd() -> list[str]:
    found = np.show_config(mode="dicts")["SIMD Extensions"]
    return [*found.get("baseline", []), *found.get("found", [])]


def _blas_core() -> str:
    # A library handle also resolves symbols of the libraries that it is linked to.
    library = ctypes.CDLL(np.linalg._umath_linalg.__file__)
    for name in _CORE_NAMES:
        if hasattr(library, name):
            core_name = getattr(library, name)
            core_name.restype = ctypes.c_char_p
            return str(core_name().decode())
    return "unknown"


def _fingerprint() -> str:
    """Hash of computations that are sensitive to rounding, 16 hexadecimal digits."""
    angles = [0.37 * number + 0.01 for number in range(500)]
    values = np.array(angles)
    matrix = np.sin(values[:480]).reshape(20, 24)
    answers = (
        np.array([function(angle) for function in (math.sin, math.cos) for angle in angles]),
        np.array([math.exp(angle / 100) for angle in angles]),
        np.array([math.pow(angle, 1.3) for angle in angles]),
        np.array([math.atan2(angle, 1.3) for angle in angles]),
        np.sin(values),
        np.exp(values / 100),
        np.add.reduce(matrix, axis=1),
        matrix @ matrix.T,
        np.linalg.solve(matrix @ matrix.T + np.eye(20), matrix[:, 0]),
    )
    return hashlib.sha256(b"".join(answer.tobytes() for answer in answers)).hexdigest()[:16]


_PACKAGES = (
    "bt_dualarm",
    "example-robot-data",
    "mujoco",
    "numpy",
    "ompl",
    "opencv-python-headless",
    "placo",
    "py_trees",
    "ruckig",
    "scipy",
)


@cache
def versions() -> Mapping[str, str]:
    """Versions of Python and of every package that can change a result; cached, it takes 9 ms."""
    found = {"python": platform.python_version()} | {name: version(name) for name in _PACKAGES}
    return MappingProxyType(found)


def summary_of(
    result: RunResult, attachments: Sequence[Mapping[str, object]], attachments_left_out: int
) -> dict[str, object]:
    """The content of ``summary.json``; names carry their units.

    Args:
        result: Result of the run.
        attachments: Every attachment, or the first and the last ones if there were many.
        attachments_left_out: Number of dropped attachments.
    """
    summary = {
        "outcome": result.outcome,
        "ending": result.ending,
        "error": result.error,
        "at_rest": result.at_rest,
        "sim_time_s": result.sim_time_s,
        "wall_time_s": result.wall_time_s,
        "real_time_factor": result.real_time_factor,
        "seed": result.seed,
        "reality": result.reality,
        "state_sha256": result.state_sha256,
        "processor": processor(),
        "versions": versions(),
        "renderer": result.renderer,
        "attachments": attachments,
        "attachments_left_out": attachments_left_out,
        "goals": {name: vars(goal) for name, goal in result.goals.items()},
        "faults": [vars(event) for event in result.faults],
        "false_success": result.is_false_success,
        "arms": {arm.name: _arm(arm) for arm in result.arms.values()},
    }
    return {name: json_ready(value) for name, value in summary.items()}


def _arm(arm: ArmResult) -> dict[str, object]:
    return {
        "outcome": arm.outcome,
        "robot": arm.robot,
        "fault": arm.fault,
        "lives": [vars(life) for life in arm.lives],
        "lives_left_out": arm.lives_left_out,
        "clipped_setpoints": arm.clipped_setpoints,
        "guard": arm.guard,
        "slow_ticks": [vars(tick) for tick in arm.slow_ticks],
        "runs_left_out": arm.runs_left_out,
        "leaves": [run.as_dict() for run in arm.runs],
    }


def json_ready(value: object, decimals: int | None = 9) -> object:
    """A value with types that JSON has: plain Python numbers, rounded.

    Numbers that are not finite become null, because JSON has none; integers beyond 64 bits become
    floats, and texts encodable, because readers refuse others.

    Args:
        value: The value.
        decimals: Number of decimals that are kept; None for all, so that the number is exact.
    """
    if isinstance(value, Mapping):
        return {encodable(str(key)): json_ready(item, decimals) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_ready(item, decimals) for item in value]
    if hasattr(value, "tolist"):
        return json_ready(value.tolist(), decimals)
    if isinstance(value, int) and abs(value) > LARGEST_INT:
        value = float(value) if abs(value) <= sys.float_info.max else math.inf
    if isinstance(value, float):
        if not math.isfinite(value):
            return None
        return value if decimals is None else round(value, decimals)
    return encodable(value) if isinstance(value, str) else value
