"""Laws of size: a reader takes a file, and a function, in at one look."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from statistics import median, quantiles

from tests.source import MODULES, ROOT, SKILLS, parsed

MOST_LINES = 250
MEDIAN_LINES = 110
MOST_OF_A_FUNCTION = 45
P95_OF_A_FUNCTION = 25

FILES = [*MODULES, *SKILLS, *sorted((ROOT / "benchmarks").rglob("*.py"))]


def functions() -> Iterator[tuple[int, str]]:
    """Lines and place of every function of the source."""
    for path in FILES:
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                assert node.end_lineno is not None
                place = f"{path.relative_to(ROOT)}:{node.lineno} {node.name}"
                yield node.end_lineno - node.lineno + 1, place


def test_files_are_short() -> None:
    lengths = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in FILES}
    print(f"files {len(lengths)}, median {median(lengths.values())}, max {max(lengths.values())}")
    assert {path.name: n for path, n in lengths.items() if n > MOST_LINES} == {}
    assert median(lengths.values()) <= MEDIAN_LINES


def test_functions_are_short() -> None:
    found = sorted(functions(), reverse=True)
    p95 = quantiles((lines for lines, _ in found), n=20)[-1]
    print(f"functions {len(found)}, p95 {p95}, max {found[0]}")
    assert [row for row in found if row[0] > MOST_OF_A_FUNCTION] == []
    assert p95 <= P95_OF_A_FUNCTION
