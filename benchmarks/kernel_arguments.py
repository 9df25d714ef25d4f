"""Cost of kernel arguments, and stale cached callees: python -m benchmarks.kernel_arguments.

Times the same work, a sum over nine values of each of six joints, with the values as nine vectors,
as a named tuple of nine vectors, as one matrix with integer rows, and as one structured array. Then
prints the result of a cached kernel that calls a kernel of another file, before and after that file
is changed, with numba's own cache.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, NamedTuple

import numba
import numpy as np

DOF: Final = 6
NAMES: Final = "abcdefghi"
CALLS: Final = 20_000
ROUNDS: Final = 7


class Rows(NamedTuple):
    """Nine named vectors."""

    a: Any
    b: Any
    c: Any
    d: Any
    e: Any
    f: Any
    g: Any
    h: Any
    i: Any


@numba.njit
def of_vectors(a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, g: Any, h: Any, i: Any) -> float:
    """Sum of nine arguments."""
    total = 0.0
    for k in range(len(a)):
        total += a[k] + b[k] + c[k] + d[k] + e[k] + f[k] + g[k] + h[k] + i[k]
    return total


@numba.njit
def of_tuple(rows: Any) -> float:
    """Sum of one tuple of nine vectors."""
    total = 0.0
    for k in range(len(rows.a)):
        total += rows.a[k] + rows.b[k] + rows.c[k] + rows.d[k] + rows.e[k]
        total += rows.f[k] + rows.g[k] + rows.h[k] + rows.i[k]
    return total


@numba.njit
def of_matrix(rows: Any) -> float:
    """Sum of one matrix with a row for each name."""
    total = 0.0
    for k in range(rows.shape[1]):
        total += rows[0, k] + rows[1, k] + rows[2, k] + rows[3, k] + rows[4, k]
        total += rows[5, k] + rows[6, k] + rows[7, k] + rows[8, k]
    return total


@numba.njit
def of_records(joints: Any) -> float:
    """Sum of one structured array with a record for each joint."""
    total = 0.0
    for k in range(len(joints)):
        joint = joints[k]
        total += joint.a + joint.b + joint.c + joint.d + joint.e
        total += joint.f + joint.g + joint.h + joint.i
    return total


def microseconds(call: Callable[[], object]) -> float:
    """Smallest mean of several rounds, µs."""
    call()
    best = np.inf
    for _ in range(ROUNDS):
        began = time.perf_counter()
        for _ in range(CALLS):
            call()
        best = min(best, (time.perf_counter() - began) / CALLS)
    return 1e6 * best


CALLER: Final = """
import numba
from callee import constant
@numba.njit(cache=True)
def answer():
    return constant()
print(answer())
"""

CALLEE: Final = """
import numba
@numba.njit(cache=True)
def constant():
    return {}
"""


def results_of_numba_cache() -> tuple[str, str]:
    """Results of a cached caller before and after its callee in another file changes."""
    with tempfile.TemporaryDirectory() as folder:
        directory = Path(folder)
        environment = os.environ | {"NUMBA_CACHE_DIR": str(directory / "cache")}
        (directory / "caller.py").write_text(CALLER)
        answers = []
        for number in (1, 2):
            callee = directory / "callee.py"
            callee.write_text(CALLEE.format(number))
            os.utime(callee, (number, number))  # numba compares the time and size of its own file
            done = subprocess.run(
                [sys.executable, "caller.py"],
                cwd=directory,
                env=environment,
                capture_output=True,
                text=True,
                check=True,
            )
            answers.append(done.stdout.strip())
    return answers[0], answers[1]


def main() -> None:
    """Print the figures."""
    matrix = np.random.default_rng(0).uniform(size=(len(NAMES), DOF))
    vectors = [row.copy() for row in matrix]
    rows = Rows(*vectors)
    records = np.zeros(DOF, dtype=[(name, float) for name in NAMES])
    for name, vector in zip(NAMES, vectors, strict=True):
        records[name] = vector
    costs = {
        "nine vectors": microseconds(lambda: of_vectors(*vectors)),
        "tuple of nine vectors": microseconds(lambda: of_tuple(rows)),
        "matrix with rows": microseconds(lambda: of_matrix(matrix)),
        "structured array": microseconds(lambda: of_records(records)),
    }
    for name, cost in costs.items():
        print(f"{name:22} {cost:5.2f} us per call  {cost / costs['matrix with rows']:5.2f}")
    before, after = results_of_numba_cache()
    print(f"numba's own cache: {before}, and {after} after the callee returns 2")


if __name__ == "__main__":
    main()
