"""The command ``bt-experiments``."""

from __future__ import annotations

import errno
import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from bt_dualarm.cli import experiments as main
from bt_dualarm.cli.bt_experiments import cells_of, command_line
from bt_dualarm.core.errors import RendererError
from bt_dualarm.experiments import report
from bt_dualarm.experiments.report import Campaign, Result
from bt_dualarm.experiments.trials import Cell
from bt_dualarm.sim import renderers
from tests.docs.test_docs import ONE_CELL
from tests.experiments.test_results import synthetic_trial
from tests.families import some

ONE = ("--case", "circle", "--speed", "1", "--controller", "predictive")


@pytest.mark.slow
def test_one_cell_writes_its_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The fastest circle with prediction has an RMS below 1 mm, no loss and no unrequested report.

    The command is that of a documentation page.
    """
    file = tmp_path / "cell.json"
    monkeypatch.chdir(tmp_path)
    assert main(ONE_CELL.split()[1:]) == 0
    content = json.loads(file.read_text(encoding="utf-8"))
    assert content["renderer"] == "ray", "available on every machine"
    assert content["outcome"] == ["SUCCESS"]
    assert content["yz_rms_m"][0] < 1e-3
    assert content["yz_max_m"][0] < 3e-3
    assert content["lost_count"] == [0]
    assert [path.name for path in tmp_path.iterdir()] == ["cell.json"]


@pytest.mark.parametrize(
    ("options", "expected"), [((), ["ray"]), (("--renderer", "both"), ["ray", "gl"])]
)
def test_renderer_is_ray_unless_another_is_given(
    options: tuple[str, ...], expected: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The choice is the same on every machine, whether OpenGL works there or not."""
    monkeypatch.setattr(renderers, "choose_renderer", lambda kind: kind)
    cells = cells_of(command_line().parse_args(["--case", "circle", *options]))
    assert list(dict.fromkeys(cell.renderer for cell in cells)) == expected


def test_missing_opengl_is_reported_before_anything_runs(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The report does not come after the half with rays."""

    def missing(kind: str) -> None:
        raise RendererError(f"no {kind} here")

    monkeypatch.setattr(renderers, "choose_renderer", missing)
    monkeypatch.setattr(report, "run_all", lambda *_: pytest.fail("it was run"))
    assert main(["--case", "circle", "--renderer", "both"]) == 2
    assert "no gl here" in capsys.readouterr().err


def test_unknown_curve_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--case", "drawn"]) == 2
    assert "see --untuned" in capsys.readouterr().err


def test_invalid_settings_are_reported(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--case", "circle", "--speed", "7"]) == 2
    assert "speed" in capsys.readouterr().err


@pytest.fixture
def no_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fails the test if anything is run."""
    monkeypatch.setattr(report, "run_all", lambda *_: pytest.fail("it was run"))


@pytest.mark.usefixtures("no_run")
@pytest.mark.parametrize("option", ["--out", "--json"])
@pytest.mark.parametrize("place", ["a file", "below a file", "of the system", "a folder"])
def test_unwritable_target_is_reported_before_anything_runs(
    option: str, place: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A target is a file where a folder is needed, the reverse, or at a place without access."""
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    target = {
        "a file": tmp_path / "file" if option == "--out" else tmp_path / "file" / "x.json",
        "below a file": tmp_path / "file" / "deep" / "x",
        "of the system": Path("/proc/experiments/x"),
        "a folder": tmp_path / "folder" if option == "--json" else tmp_path / "file",
    }[place]
    assert main([*ONE, option, str(target)]) == 2
    err = capsys.readouterr().err
    assert err.startswith("bt-experiments: error: cannot write ")
    assert err.count("\n") == 1
    assert str(target if place == "a folder" else target.parent) in err


@pytest.mark.usefixtures("no_run")
@pytest.mark.parametrize(
    "arguments",
    [("--fps", "0"), ("--fps", "nan"), ("--fps", "-60"), ("--out", ""), ("--json", " "),
     ("--jobs", "0"), ("--seeds", "many")],
)  # fmt: skip
def test_invalid_arguments_are_reported(
    arguments: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main([*ONE, *arguments])
    assert ended.value.code == 2
    assert f"argument {arguments[0]}: " in capsys.readouterr().err


def test_full_disk_at_the_end_leaves_the_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The table is printed, the numbers are in their file, and the exit code is 1."""

    def fail(folder: Path, results: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(folder))

    done = Campaign([Result(Cell("circle", 1.0), [synthetic_trial()])])
    monkeypatch.setattr(report, "run_all", lambda *_: done)
    monkeypatch.setattr(report, "write_report", fail)
    numbers = tmp_path / "numbers.json"
    folder = tmp_path / "report"
    assert main([*ONE, "--json", str(numbers), "--out", str(folder)]) == 1
    out, err = capsys.readouterr()
    assert "circle 1" in out
    assert err == f"bt-experiments: error: cannot write {folder}: No space left on device\n"
    assert json.loads(numbers.read_text(encoding="utf-8"))["case"] == "circle"


def descendants(process: int) -> Iterator[int]:
    """Ids of all descendants of a process, on Linux."""
    with suppress(OSError):  # one of them has ended meanwhile
        for task in Path(f"/proc/{process}/task").iterdir():
            for child in map(int, (task / "children").read_text(encoding="utf-8").split()):
                yield child
                yield from descendants(child)


@pytest.mark.slow
@pytest.mark.parametrize("number", some([signal.SIGINT, signal.SIGTERM, signal.SIGKILL], 2))
def test_no_process_is_left_behind(number: signal.Signals, tmp_path: Path) -> None:
    """Worker processes and their helpers end with the main process."""
    code = "import sys; import bt_dualarm.cli as cli; sys.exit(cli.experiments())"
    options = "--case lissajous --speed 0.05 --seeds 4 --jobs 2 --out"
    command = [sys.executable, "-c", code, *options.split(), str(tmp_path / "out")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert process.stderr.readline() == "8 runs\n"
        deadline = time.monotonic() + 60
        while len(below := set(descendants(process.pid))) < 3:
            assert time.monotonic() < deadline, "two workers and the process that monitors them"
        watched = []
        for child in below:
            with suppress(ProcessLookupError):
                watched.append(os.pidfd_open(child))
        process.send_signal(number)
        err = process.communicate(timeout=60)[1]
    assert process.returncode == (-number if number == signal.SIGKILL else 128 + number)
    if number != signal.SIGKILL:
        assert err == "bt-experiments: interrupted: 0 of 2 experiments are complete\n"
    for child in watched:
        assert select.select([child], [], [], 20)[0], "it has ended"
        os.close(child)
