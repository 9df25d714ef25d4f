"""Python examples of the documentation pass mypy as strictly as the package."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.test_docs import ROOT, blocks_of

USES = '''
"""What a user does with results and skills: no cast, no ignore."""

import bt_dualarm as bt


class Pause(bt.Skill):
    """A bare yield beside one with progress, and motions of the arm."""

    def run(self) -> bt.Ticks:
        began = self.time
        while self.time - began < 1.0:
            yield
        yield 0.5
        yield from self.arm.travel([self.arm.posture("home")], 0.5)
        self.metrics["paused_s"] = self.time - began


result = bt.run("circle", seed=1)
for arm in result.arms.values():
    near: float = arm.guard["nearest_arm_m"] - 0.01
    for leaf in arm.leaves.values():
        good = leaf.metrics["path_rms_m"] < 1e-4 and leaf.metrics["path_max_m"] / 2 > 0.0
    worst = max(one.metrics.get("path_max_m", 0.0) for one in arm.runs)
    print(f"{1000 * worst:.1f} mm", good, near)
'''


@pytest.mark.slow
def test_examples_and_plain_uses_are_typed(tmp_path: Path) -> None:
    """The Python blocks of each page form one module.

    Mypy runs in a separate process: here it would leave millions of objects behind and make garbage
    collection, three seconds each time, include all objects that ``gc.freeze`` had excluded.
    """
    modules = {"uses": USES}
    for page in ("docs/first_skill.md", "docs/python.md", "docs/skills.md"):
        blocks = blocks_of(ROOT / page)
        text = "\n".join(block.text for block in blocks if block.language == "python")
        modules[Path(page).stem.lower()] = text
    for name, text in modules.items():
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    files = [str(tmp_path / f"{name}.py") for name in modules]
    config = ["--config-file", str(ROOT / "pyproject.toml")]
    cache = ["--cache-dir", str(ROOT / ".mypy_cache")]
    command = [sys.executable, "-m", "mypy", *config, *cache, *files]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.stdout.replace(str(tmp_path), ""), done.stderr, done.returncode) == (
        f"Success: no issues found in {len(files)} source files\n",
        "",
        0,
    )
