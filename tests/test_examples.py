"""Every example runs, prints what its docstring shows, and writes only to its folder."""

from __future__ import annotations

import ast
import doctest
import inspect
import json
import runpy
import sys
import tempfile
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pytest

from tests.no_plots import no_plots
from tests.source import ROOT, imports_of

FOLDER = ROOT / "examples"
SCRIPTS = sorted(FOLDER.glob("*.py"))
NOTEBOOK = FOLDER / "tour.ipynb"
LOOKED_AT = ("plot_a_record", "camera_images")
"""Examples that use the plots of a record, or make some."""


def shown_output(script: Path) -> str:
    """The block below ``Prints::`` in a script's docstring."""
    text = ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or ""
    return inspect.cleandoc(text.partition("Prints::\n")[2]) + "\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Empty folder for an example, which runs in another empty folder that must stay empty."""
    out = tmp_path / "out"
    elsewhere = tmp_path / "elsewhere"
    for each in (out, elsewhere):
        each.mkdir()
    monkeypatch.chdir(elsewhere)
    monkeypatch.setattr(tempfile, "tempdir", str(out))
    return out


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_example_prints_what_its_docstring_shows(
    script: Path,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """``...`` stands for any text, as in doctest."""
    monkeypatch.setattr(sys, "argv", [str(script), str(folder)])
    with nullcontext() if script.stem.endswith(LOOKED_AT) else no_plots():
        runpy.run_path(str(script), run_name="__main__")
    printed = capsys.readouterr().out
    shown = shown_output(script)
    assert doctest.OutputChecker().check_output(shown, printed, doctest.ELLIPSIS), printed
    assert list(Path.cwd().iterdir()) == []


@pytest.mark.usefixtures("folder")
def test_tour_notebook_runs_completely() -> None:
    """Like in Jupyter, cells share one namespace, and show the value of their last expression."""
    mpl.use("agg")  # no window, whatever display there is
    names: dict[str, Any] = {"__name__": "__main__"}  # Any: whatever the cells define
    shown = []
    for number, cell in enumerate(json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]):
        if cell["cell_type"] != "code":
            continue
        assert (cell["outputs"], cell["execution_count"]) == ([], None), (
            "the notebook must be stored without outputs"
        )
        body = ast.parse("".join(cell["source"]))
        last = body.body.pop() if isinstance(body.body[-1], ast.Expr) else None
        # Without `dont_inherit` the cells would be under this file's `from __future__`.
        name = f"cell {number}"
        exec(compile(body, name, "exec", dont_inherit=True), names)  # noqa: S102 - our own cells
        if isinstance(last, ast.Expr):
            expression = compile(ast.Expression(last.value), name, "eval", dont_inherit=True)
            value = eval(expression, names)  # noqa: S307 - as above
            show = getattr(value, "_repr_html_", None)
            shown.append((show() if callable(show) else None) or repr(value))
    assert sum("<table" in text for text in shown) >= 2, "a run and a result are shown as tables"
    assert list(Path.cwd().iterdir()) == []


def test_examples_are_numbered_short_and_listed() -> None:
    numbers = [int(script.name[:2]) for script in SCRIPTS]
    assert numbers == list(range(1, len(SCRIPTS) + 1))
    lengths = {script.name: len(script.read_text().splitlines()) for script in SCRIPTS}
    assert {name: lines for name, lines in lengths.items() if not 20 <= lines <= 80} == {}
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert [each.name for each in (*SCRIPTS, NOTEBOOK) if f"]({each.name})" not in page] == []


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_example_uses_only_the_public_interface(script: Path) -> None:
    ours = {name for _, name in imports_of(script) if name.split(".")[0] in ("bt_dualarm", "tests")}
    assert ours == {"bt_dualarm"}
