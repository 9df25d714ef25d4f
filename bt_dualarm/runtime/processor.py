"""What kind of processor a run was computed on: the last bits of its numbers depend on that.

The same file and seed give the same bits again on processors of one kind. Another kind takes other
ways through the C library's functions (with fused multiply-add or without), NumPy's loops (by SIMD
extension) and BLAS (by core), which round differently: samples of a run then differ by about 1e-13,
and so does its hash.
"""

from __future__ import annotations

import ctypes
import hashlib
import math
import platform
from typing import Final, TypedDict

import numpy as np

_CORE_NAMES: Final = (
    "scipy_openblas_get_corename64_",
    "scipy_openblas_get_corename",
    "openblas_get_corename64_",
    "openblas_get_corename",
)
"""What OpenBLAS's ``openblas_get_corename`` is called in the builds that NumPy is linked to."""


class Processor(TypedDict):
    """The kind of a processor, ready for JSON.

    Attributes:
        machine: Architecture, for example ``x86_64``.
        simd: SIMD extensions that NumPy uses here.
        blas: Core that OpenBLAS computes for; ``unknown`` where NumPy has another BLAS.
        arithmetic: Fingerprint of what C library, NumPy and BLAS answer to a few fixed questions:
            where it differs, hashes of runs are not to be compared.
    """

    machine: str
    simd: list[str]
    blas: str
    arithmetic: str


def processor() -> Processor:
    """The kind of the processor that this process runs on."""
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
    # A handle finds the functions of the libraries that its own library is linked to.
    library = ctypes.CDLL(np.linalg._umath_linalg.__file__)
    for name in _CORE_NAMES:
        if hasattr(library, name):
            core_name = getattr(library, name)
            core_name.restype = ctypes.c_char_p
            return str(core_name().decode())
    return "unknown"


def _fingerprint() -> str:
    """Hash of numbers that come out otherwise by other ways of rounding, 16 hexadecimal digits."""
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
