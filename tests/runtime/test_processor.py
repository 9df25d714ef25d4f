"""Processor fingerprint: constant on one processor, another where rounding differs."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys

import pytest

from bt_dualarm.runtime.summary import Processor, processor

HERE = processor()

OTHERS = {
    "another BLAS core": {"OPENBLAS_CORETYPE": "Nehalem"},
    "fewer SIMD extensions": {"NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512_SKX AVX2 FMA3"},
    "a C library without FMA": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2"},
}
"""Environments in which the same processor computes as an older one does."""


def elsewhere(**environment: str) -> Processor:
    """The fingerprint that a separate process finds."""
    code = (
        "import json; from bt_dualarm.runtime.summary import processor;"
        "print(json.dumps(processor()))"
    )
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    found: Processor = json.loads(done.stdout)
    return found


def test_processes_on_one_processor_agree() -> None:
    assert processor() == HERE == elsewhere()


@pytest.mark.skipif(
    platform.libc_ver()[0] != "glibc"
    or not {"AVX2", "FMA3"} <= set(HERE["simd"])
    or HERE["blas"] in ("unknown", "Nehalem"),
    reason="this processor is as old as those to emulate, or cannot emulate them",
)
@pytest.mark.parametrize("name", OTHERS)
def test_different_rounding_has_another_fingerprint(name: str) -> None:
    other = elsewhere(**OTHERS[name])
    assert other != HERE
    # NumPy's functions of doubles round differently only where AVX-512 replaces the C library.
    if name != "fewer SIMD extensions" or "AVX512_SKX" in HERE["simd"]:
        assert other["arithmetic"] != HERE["arithmetic"]
