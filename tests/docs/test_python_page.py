"""Every block of docs/python.md runs in order and prints the text below it."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

import pytest

from tests.docs.test_docs import ROOT, blocks_of


@pytest.mark.slow
@pytest.mark.usefixtures("without_plots")
def test_every_block_runs_and_prints_what_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "page"}
    printed = ""
    for block in blocks_of(ROOT / "docs" / "python.md"):
        if block.language == "python":
            output = io.StringIO()
            with contextlib.redirect_stdout(output):
                exec(compile(block.text, "docs/python.md", "exec"), names)  # noqa: S102 - own page
            printed = output.getvalue()
        elif block.language == "text":
            assert printed == block.text
            printed = ""
        assert block.language == "python" or printed == "", "all output is on the page"
