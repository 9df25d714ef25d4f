"""Readability figures of the package: sizes, helpers, comments.

    python -m benchmarks.code_figures [--worst 10]

Lines include blank lines and comments. A function counts as called once if its name occurs once in
the package besides its definition. A packed assignment gives several names unrelated values in one
statement (``a, b = x, y``); swaps and unpacked calls do not count.
"""

from __future__ import annotations

import argparse
import ast
import re
from collections import Counter, defaultdict
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parent.parent
PACKAGE: Final = ROOT / "bt_dualarm"
COMMENTED: Final = ("control", "trajectory", "safety", "collision")
FUNCTIONS: Final = (ast.FunctionDef, ast.AsyncFunctionDef)


def _is_packed(node: ast.Assign) -> bool:
    if not (isinstance(node.value, ast.Tuple) and isinstance(node.targets[0], ast.Tuple)):
        return False
    targets = {ast.unparse(target) for target in node.targets[0].elts}
    used = {ast.unparse(part) for part in ast.walk(node.value) if isinstance(part, ast.expr)}
    return not targets & used  # a swap or a shift needs one statement


def main() -> int:
    """Print a line for each figure, and the worst cases."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--worst", type=int, default=5)
    worst = parser.parse_args().worst
    paths = sorted(PACKAGE.rglob("*.py"))
    text = {path: path.read_text(encoding="utf-8") for path in paths}
    trees = {path: ast.parse(source) for path, source in text.items()}
    lines = {path: source.count("\n") for path, source in text.items()}
    words = Counter(re.findall(r"\w+", "\n".join(text.values())))
    lengths: list[tuple[int, str]] = []
    once: list[str] = []
    packed = Counter[Path]()
    assignments = 0
    functions = 0
    classes = defaultdict(list)
    importers = defaultdict(set)
    for path, tree in trees.items():
        name = str(path.relative_to(PACKAGE))
        for node in ast.walk(tree):
            if isinstance(node, FUNCTIONS):
                functions += 1
                lengths.append(((node.end_lineno or 0) - node.lineno + 1, f"{name}:{node.name}"))
                is_private = node.name.startswith("_") and not node.name.startswith("__")
                if is_private and words[node.name] == 2:
                    once.append(f"{name}:{node.name}")
            elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                classes[node.name].append(name)
            elif isinstance(node, ast.Assign):
                assignments += 1
                packed[path] += _is_packed(node)
            elif isinstance(node, ast.ImportFrom) and node.module:
                importers[node.module].add(path)
                for alias in node.names:
                    importers[f"{node.module}.{alias.name}"].add(path)
    lengths.sort(reverse=True)
    single = [
        f"{path.relative_to(PACKAGE)} ({lines[path]})"
        for path in paths
        if path.stem != "__init__" and "kernel" not in path.stem and lines[path] < 120
        if len(importers[".".join(path.relative_to(ROOT).with_suffix("").parts)]) == 1
    ]
    twice = {name: where for name, where in classes.items() if len(where) > 1}
    comments = re.compile(r"(?:^|\s)# (?!type:|noqa)", re.MULTILINE)
    code = sum(lines[path] for path in paths if path.parent.name in COMMENTED)
    comment_count = sum(len(comments.findall(text[p])) for p in paths if p.parent.name in COMMENTED)
    p95 = lengths[len(lengths) // 20][0]
    total = sum(packed.values())
    print(f"modules {len(paths)}, lines {sum(lines.values())}")
    print(
        f"longest modules {sorted(((n, p.name) for p, n in lines.items()), reverse=True)[:worst]}"
    )
    print(f"packed assignments {total} of {assignments} ({100 * total / assignments:.1f} %)")
    print(f"  most in {[(p.name, n) for p, n in packed.most_common(worst)]}")
    print(f"private functions called once {len(once)} of {functions} functions")
    print(f"  ({100 * len(once) / functions:.1f} %)")
    print(f"function length p95 {p95}, longest {lengths[:worst]}")
    print(f"small modules with one importer {len(single)}: {single[:worst]}")
    print(f"class names used twice {len(twice)}: {twice}")
    print(f"lines per comment in {', '.join(COMMENTED)}: {code / max(comment_count, 1):.0f}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
