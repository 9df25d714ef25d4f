"""The command ``bt-run``: its output, its record and its exit code."""

from __future__ import annotations

import io
import json
import logging
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bt_dualarm import cli
from bt_dualarm.core.share import share_dir
from bt_dualarm.runtime.options import NoSuchTree, find_tree, shipped_trees
from bt_dualarm.runtime.run import Run
from tests.families import some
from tests.no_plots import BT_RUN_NO_PLOTS

WAITING = """\
bt_dualarm: 1
name: waiting
world: {scene: empty}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.4]}
    tree: {sequence: [wait: {seconds: 0.1}, wait: {seconds: %s}]}
"""

BREAKING = '''\
"""A skill with a bug."""
from bt_dualarm import Skill

class Break(Skill):
    """Breaks."""
    def run(self):
        yield
        raise RuntimeError("boom")
'''


@pytest.fixture
def waiting(tmp_path: Path) -> Path:
    path = tmp_path / "waiting.yaml"
    path.write_text(WAITING % 0.1, encoding="utf-8")
    return path


def test_success_is_code_0(waiting: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run([str(waiting)]) == 0
    out, err = capsys.readouterr()
    assert "    0.100 s  arm1  ✔ SUCCESS  sequence/wait\n" in out
    assert "SUCCESS  waiting" in out
    assert err == ""


def test_unfinished_tree_is_code_1(waiting: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run([str(waiting), "--duration", "0.05"]) == 1
    out = capsys.readouterr().out
    assert "UNFINISHED" in out
    assert "The requested duration has passed." in out


def test_failed_tree_is_code_1_and_quiet_still_prints_the_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "skills").mkdir()
    (tmp_path / "skills" / "breaks.py").write_text(BREAKING)
    tree = tmp_path / "tree.yaml"
    text = (WAITING % 0.1).replace("sequence: [wait: {seconds: 0.1},", "sequence: [break: {},")
    tree.write_text(text)
    arguments = [str(tree), "--skills", str(tmp_path / "skills"), "--display", "quiet"]
    assert cli.run([*arguments, "--record", str(tmp_path / "out")]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert "EXCEPTION" in err
    assert "boom" in err
    assert "Traceback" in (tmp_path / "out" / "run.log").read_text()


def test_quiet_success_prints_nothing(waiting: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run([str(waiting), "--display", "quiet"]) == 0
    assert capsys.readouterr() == ("", "")


def test_ascii_output_is_ascii(waiting: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cli.run([str(waiting), "--ascii"])
    assert capsys.readouterr().out.isascii()


def test_outcome_is_printed_before_images_are_drawn(
    waiting: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    printed: list[str] = []
    write = Run.write_record

    def noting(opened: Run) -> None:
        # The line breaks where the path of the record makes it too long.
        printed.append(" ".join(capsys.readouterr().out.split()))
        write(opened)

    monkeypatch.setattr(Run, "write_record", noting)
    assert cli.run([str(waiting), "--record", str(tmp_path / "out")]) == 0
    assert "SUCCESS waiting" in printed[0]
    assert "its figures are being drawn" in printed[0]
    assert (tmp_path / "out" / "overview.png").is_file()


@pytest.mark.usefixtures("without_plots")
def test_record_has_summary_and_events(
    waiting: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "deep" / "out"
    assert cli.run([str(waiting), "--record", str(folder), "--seed", "7"]) == 0
    assert f"record: {folder}" in capsys.readouterr().out.replace("\n", "")
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["seed"], summary["renderer"]) == (7, None)
    assert [leaf["path"] for leaf in summary["arms"]["arm1"]["leaves"]] == [
        "sequence/wait",
        "sequence/wait#2",
    ]
    assert len((folder / "events.jsonl").read_text().splitlines()) == 6
    assert not (folder / "run.log").exists(), "nothing was logged"


@pytest.mark.usefixtures("without_plots")
def test_runs_with_equal_seeds_are_identical(waiting: Path, tmp_path: Path) -> None:
    hashes = set()
    for number in "12":
        cli.run([str(waiting), "--display", "quiet", "--record", str(tmp_path / number)])
        hashes.add(json.loads((tmp_path / number / "summary.json").read_text())["state_sha256"])
    assert len(hashes) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["pick_and_trak"], "did you mean 'pick_and_track'?"),
        (["no/such/file.yaml"], "there is no such file"),
        (["."], "is a folder, not a tree file"),
        (["circle", "--skills", "/no/such/folder"], "there is no such folder of skills"),
        (["circle", "--record", "/dev/null"], "it exists and is not a folder"),
        (["circle", "--param", "sped=1"], "sped"),
    ],
)
def test_unusable_argument_is_code_2(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.run(arguments) == 2
    out, err = capsys.readouterr()
    assert message in err
    assert out == ""
    assert "Traceback" not in err


def test_bad_file_is_code_2_with_the_places_of_its_errors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tree = tmp_path / "bad.yaml"
    tree.write_text((WAITING % 0.1).replace("seconds", "secnds").replace("ur5", "ur55"))
    assert cli.run([str(tree)]) == 2
    assert f"{tree}:8:" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "no tree file given"),
        (["circle", "--seed", "-1"], "'-1' is not a whole number"),
        (["circle", "--seed", "1.5"], "'1.5' is not a whole number"),
        (["circle", "--duration", "0"], "'0' is not a number of seconds above 0"),
        (["circle", "--duration", "nan"], "above 0"),
        (["circle", "--duration", "soon"], "above 0"),
        (["circle", "--watchdog", "-1"], "'-1' is not a number of seconds above 0, nor 0 for no"),
        (["circle", "--watchdog", "soon"], "'soon' is not a number of seconds above 0, nor 0 for"),
        (["circle", "--display", "film"], "invalid choice"),
        (["circle", "--param", "speed"], "NAME=VALUE"),
        (["circle", "--view-port", "8000"], "--view-port is for the page of a run; add --view"),
        (["circle", "--view-host", "10.0.0.2"], "--view-host is for the page of a run; add --vi"),
        (["circle", "--sed", "3", "--wrong"], "unrecognized"),
    ],
)
def test_wrong_usage_is_code_2(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.run(arguments)
    assert ended.value.code == 2
    assert message in capsys.readouterr().err


def test_shipped_trees_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [tree.name for tree in shipped_trees()]
    assert all(tree.description for tree in shipped_trees())


@pytest.mark.parametrize("given", ["circle", "circle.yaml", "trees/circle.yaml", "trees/circle"])
def test_shipped_tree_is_found_from_any_folder(
    given: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert find_tree(given) == share_dir("trees") / "circle.yaml"


def test_file_of_the_user_takes_precedence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "circle").write_text("")
    assert find_tree("circle") == Path("circle")


@pytest.mark.parametrize("given", ["../LICENSE", "/etc/passwd.yaml", "", "\0"])
def test_files_outside_the_shipped_trees_are_not_found(given: str) -> None:
    with pytest.raises(NoSuchTree):
        find_tree(given)


@pytest.mark.parametrize("command", [name for name in cli.__all__ if name != "experiments"])
def test_help_imports_nothing_heavy(command: str) -> None:
    """Help needs no simulator.

    The exception is ``bt-experiments``, which lists its curves and conditions in its help.
    """
    code = (
        "import sys, bt_dualarm.cli\n"
        f"try:\n  bt_dualarm.cli.{command}(['--help'])\nexcept SystemExit: pass\n"
        "heavy = {'mujoco', 'numpy', 'placo', 'rich', 'matplotlib', 'cv2', 'yaml', 'pydantic'}\n"
        "print('HEAVY', sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "HEAVY []" in done.stdout
    assert "examples:" in done.stdout


@pytest.fixture(scope="module")
def imported() -> str:
    """Modules that a new process has imported after a plain run and after one along a path."""
    code = (
        "import sys, bt_dualarm.cli, bt_dualarm.runtime.api\n"
        "print('TO PRINT', 'rich' in sys.modules)\n"
        "bt_dualarm.cli.run(['reach_to_pose', '--duration', '0.002', '--display', 'quiet'])\n"
        "slow = {'cv2', 'scipy.spatial', 'scipy.interpolate', 'scipy.optimize', 'matplotlib'}\n"
        "print('SLOW', sorted(slow & set(sys.modules)))\n"
        "skills = [name for name in sys.modules if name.startswith('bt_dualarm_skills_')]\n"
        "print('SKILLS', [name.split('_', 4)[4] for name in skills])\n"
        "bt_dualarm.cli.run(['circle', '--duration', '0.1', '--display', 'quiet'])\n"
        "print('ON A PATH', sorted(slow & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout


def test_run_starts_without_unused_modules(imported: str) -> None:
    """Each of these takes 0.1 to 0.5 s to import, as long as the whole start of a plain run."""
    assert "SLOW []" in imported


def test_run_from_python_does_not_import_rich(imported: str) -> None:
    """Workers of sweeps print nothing."""
    assert "TO PRINT False" in imported


def test_run_imports_only_the_skills_of_its_tree(imported: str) -> None:
    assert "SKILLS ['reach_to_pose']" in imported


def test_run_along_a_path_needs_no_other_modules(imported: str) -> None:
    """The package has its own splines and rotations, and plots nothing without a record."""
    assert "ON A PATH []" in imported


def test_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["--version"]) == 0
    assert capsys.readouterr().out.startswith("bt-run 0.")


def test_closed_pipe_does_not_stop_the_run(waiting: Path, tmp_path: Path) -> None:
    """``bt-run … | head -1`` runs to its end and writes its record."""
    out = tmp_path / "out"
    command = f"{sys.executable} -c '{BT_RUN_NO_PLOTS}' {waiting}"
    done = subprocess.run(
        ["bash", "-c", f"{command} --record {out} | true; exit ${{PIPESTATUS[0]}}"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "Traceback" not in done.stderr
    assert json.loads((out / "summary.json").read_text())["outcome"] == "SUCCESS"


def test_logging_is_left_as_it_was(waiting: Path) -> None:
    logger = logging.getLogger("bt_dualarm")
    before = logger.level, list(logger.handlers)
    cli.run([str(waiting), "--display", "quiet"])
    assert (logger.level, list(logger.handlers)) == before


@pytest.mark.parametrize(("number", "code"), some([(signal.SIGINT, 130), (signal.SIGTERM, 143)], 2))
def test_signal_ends_the_run_in_order(tmp_path: Path, number: signal.Signals, code: int) -> None:
    """The arms stop, the record is complete, and the exit code is the signal's."""
    out = tmp_path / "out"
    command = [
        sys.executable,
        "-c",
        BT_RUN_NO_PLOTS,
        "circle",
        "--real-time",
        "--record",
        str(out),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert "RUNNING" in process.stdout.readline()
        process.send_signal(number)
        rest = process.communicate(timeout=60)[0]
    assert process.returncode == code
    assert "UNFINISHED" in rest
    summary = json.loads((out / "summary.json").read_text())
    assert summary["arms"]["arm1"]["outcome"] == "UNFINISHED"
    events = [json.loads(line) for line in (out / "events.jsonl").read_text().splitlines()]
    assert (events[-1]["old"], events[-1]["new"]) == ("RUNNING", "INVALID")


def test_real_time_run_takes_the_simulated_time(waiting: Path) -> None:
    began = time.perf_counter()
    assert cli.run([str(waiting), "--display", "quiet", "--real-time"]) == 0
    assert time.perf_counter() - began >= 0.2


@pytest.mark.usefixtures("without_plots")
def test_divergence_reports_where_its_states_are(
    waiting: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from bt_dualarm.sim.world import World

    steps = World.step

    def diverging(world: World) -> None:
        if world.time > 0.05:
            world.data.qvel[0] = float("nan")
        steps(world)

    monkeypatch.setattr(World, "step", diverging)
    assert cli.run([str(waiting), "--display", "quiet"]) == 1
    assert "--record DIR saves them" in capsys.readouterr().err
    out = tmp_path / "out"
    assert cli.run([str(waiting), "--display", "quiet", "--record", str(out)]) == 1
    assert str(out / "divergence.npz") in capsys.readouterr().err.replace("\n", "")
    assert (out / "divergence.npz").stat().st_size > 0
    assert json.loads((out / "summary.json").read_text())["outcome"] == "UNFINISHED"


def test_output_in_another_encoding_is_readable(
    waiting: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding="latin-1"))
    assert cli.run([str(waiting)]) == 0
    sys.stdout.flush()
    assert b"+ SUCCESS" in raw.getvalue()
