"""Commands handle signals at any time and output that is closed, full or unread."""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import os
import signal
import subprocess
import sys
import threading
import time
import types
from pathlib import Path

import numpy as np
import pytest

from bt_dualarm.cli import entry
from bt_dualarm.cli.entry import ProcessEnd
from bt_dualarm.cli.safe_streams import SafeStream
from bt_dualarm.runtime.interruption import StopRequest
from tests.families import some
from tests.listening import HEEDING, STOPPING, wait_until, wait_until_it_listens
from tests.no_plots import BT_RUN_NO_PLOTS

PROGRAM = f"{HEEDING}import sys; import bt_dualarm.cli as cli; "
COMMANDS = {
    "bt-run": ("run", "reach_to_pose", "--display", "log", "--duration", "0.5"),
    "bt-check": ("check", "circle"),
    "bt-skills": ("skills", "circle"),
    "bt-robot": ("robot", "z1_description/urdf/z1.urdf"),
    "bt-tune-color": ("tune_color", "pick_and_track"),
    "bt-experiments": ("experiments", "--help"),
}
CODES = dict.fromkeys(COMMANDS, 0) | {"bt-run": 1, "bt-tune-color": 1}
"""1: the duration ends before the motion, and no object of the color is seen at the start."""

MOMENTS = np.random.default_rng(7).uniform(0.0, 1.0, (2, len(COMMANDS)))
"""Time from when a program handles signals, s: it then imports, computes or prints. Which of them
depends on the machine, the expected result does not."""


def command(name: str) -> list[str]:
    function, *arguments = COMMANDS[name]
    return [sys.executable, "-c", f"{PROGRAM}sys.exit(cli.{function}())", *arguments]


def in_shell(name: str, redirection: str) -> subprocess.CompletedProcess[str]:
    function, *arguments = COMMANDS[name]
    program = f"import sys; import bt_dualarm.cli as cli; sys.exit(cli.{function}())"
    line = f'"{sys.executable}" -c "{program}" {" ".join(arguments)} {redirection}'
    return subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False)


SIGNALLED = some(
    (
        (name, STOPPING[number % len(STOPPING)], float(moment))
        for number, (moment, name) in enumerate(zip(MOMENTS.flat, [*COMMANDS] * 2, strict=True))
    ),
    3,
)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "number", "moment"), SIGNALLED)
def test_signal_ends_a_command_without_a_traceback(
    name: str, number: signal.Signals, moment: float
) -> None:
    with subprocess.Popen(
        command(name), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        wait_until_it_listens(process)
        time.sleep(moment)
        process.send_signal(number)
        out, err = process.communicate()
    assert "Traceback" not in out + err
    assert "Exception ignored" not in err
    assert process.returncode in (128 + number, CODES[name]), err  # the latter: it had finished


@pytest.mark.parametrize(
    ("name", "number"),
    some([*itertools.product(["bt-skills"], STOPPING), ("bt-experiments", 15)], 2),
)
def test_signal_before_the_imports_ends_a_command_unless_ignored(name: str, number: int) -> None:
    """A signal that is ignored from the start, as by ``nohup`` and ``&``, stays ignored."""
    with subprocess.Popen(
        command(name), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        wait_until_it_listens(process)
        process.send_signal(number)
        out, err = process.communicate()
    assert (process.returncode, out, err) == (128 + number, "", "")
    function, *arguments = COMMANDS[name]
    ignoring = f"{PROGRAM}signal.signal({number:d}, signal.SIG_IGN); "
    code = f"{ignoring}import os; os.kill(os.getpid(), {number:d}); sys.exit(cli.{function}())"
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0


def test_second_signal_ends_a_command_that_ignores_the_first(tmp_path: Path) -> None:
    """A file of skills whose import never ends catches all exceptions."""
    (tmp_path / "hung.py").write_text(
        "import pathlib, time\n"
        "while True:\n"
        "    try:\n"
        "        pathlib.Path(__file__).with_name('reached').touch()\n"
        "        time.sleep(1000)\n"
        "    except BaseException:\n"
        "        pathlib.Path(__file__).with_name('noticed').touch()\n"
    )
    with subprocess.Popen([*command("bt-check"), "--skills", str(tmp_path)]) as process:
        for name in ("reached", "noticed"):
            wait_until(process, (tmp_path / name).exists)
            process.send_signal(signal.SIGTERM)
        assert process.wait() == 143


def test_threads_of_skills_do_not_keep_a_command_alive(tmp_path: Path) -> None:
    (tmp_path / "threaded.py").write_text(
        "import threading\n"
        "threading.Thread(target=threading.Event().wait, name='endless').start()\n"
        "from bt_dualarm import Skill\n"
        "class Threaded(Skill):\n"
        '    """Leaves a thread behind."""\n'
        "    example = 'threaded'\n"
        "    def run(self):\n"
        "        yield\n"
    )
    done = subprocess.run(
        [*command("bt-check"), "--skills", str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "bt-check: abandoned threads that are still running: 'endless'" in done.stderr
    assert "circle" in done.stdout
    assert done.returncode == 0


@pytest.mark.parametrize("name", some(COMMANDS, 3))
def test_full_disk_is_reported(name: str) -> None:
    done = in_shell(name, "> /dev/full")
    assert f"{name}: error: cannot write the output: No space left on device" in done.stderr
    assert "Traceback" not in done.stderr
    assert done.returncode == 1


@pytest.mark.parametrize(
    ("redirection", "name"), some(itertools.product(["<&- >&- 2>&-", "| true"], COMMANDS), 4)
)
def test_closed_or_unread_output_changes_no_exit_code(name: str, redirection: str) -> None:
    done = in_shell(name, f"{redirection}; exit ${{PIPESTATUS[0]}}")
    assert "Traceback" not in done.stderr
    assert done.returncode == CODES[name]


def test_write_error_is_kept_without_its_traceback() -> None:
    """A traceback would keep the run alive past the exit, where libraries report leaks."""
    with open("/dev/full", "w") as full:  # noqa: PTH123 - a device
        stream = SafeStream(full)
        stream.write("lost")
        stream.flush()
        assert stream.error is not None
        assert stream.error.__traceback__ is None


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_characters_that_an_encoding_lacks_are_escaped(encoding: str) -> None:
    written = io.BytesIO()
    stream = SafeStream(io.TextIOWrapper(written, encoding))
    stream.write("turns \u2265 1, ")
    stream.write("90\u00b0\n")
    stream.flush()
    degree = "\u00b0" if encoding == "latin-1" else r"\xb0"
    assert written.getvalue().decode(encoding) == f"turns \\u2265 1, 90{degree}\n"


def test_record_is_complete_with_closed_streams(tmp_path: Path) -> None:
    """A file opened while standard output is closed would get its file descriptor."""
    done = in_shell("bt-run", f"--record {tmp_path} <&- >&- 2>&-")
    assert done.returncode == 1, "the duration ended first"
    assert json.loads((tmp_path / "summary.json").read_text())["outcome"] == "UNFINISHED"
    for name in ("overview.png", "scene.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("display", some(["live", "log", "quiet"], 3))
def test_record_is_complete_after_the_terminal_is_closed(tmp_path: Path, display: str) -> None:
    """The shell sends SIGHUP, and all later output fails."""
    ours, theirs = os.openpty()
    arguments = ("circle", "--real-time", "--display", display, "--record", str(tmp_path / "out"))
    with subprocess.Popen(
        [sys.executable, "-c", f"{HEEDING}{BT_RUN_NO_PLOTS}", *arguments],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env=os.environ | {"TERM": "xterm"},
        start_new_session=True,
    ) as process:
        os.close(theirs)
        wait_until(process, (tmp_path / "out" / "events.jsonl").exists)  # the run has begun
        os.close(ours)
        process.send_signal(signal.SIGHUP)
        assert process.wait() == 129
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["ending"], summary["at_rest"]) == ("a stop was requested", True)


def test_ignored_sighup_stays_ignored(tmp_path: Path) -> None:
    """``nohup`` ignores SIGHUP."""
    command = ["nohup", sys.executable, "-c", BT_RUN_NO_PLOTS]
    arguments = ("circle", "--duration", "0.5", "--real-time", "--record", str(tmp_path / "out"))
    with subprocess.Popen([*command, *arguments], stdout=subprocess.DEVNULL) as process:
        wait_until(process, (tmp_path / "out" / "events.jsonl").exists)
        process.send_signal(signal.SIGHUP)
        assert process.wait() == 1
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["ending"] == "the requested duration has passed"


def test_process_end_arms_no_timer_outside_its_block() -> None:
    """A run closed after the block used to start another monitor process, which never ended."""
    end = ProcessEnd("bt-run", StopRequest())
    end.postpone(60.0)
    assert signal.getitimer(signal.ITIMER_VIRTUAL) == (0.0, 0.0)
    with end:
        end.postpone(60.0)
        assert signal.getitimer(signal.ITIMER_VIRTUAL)[0] > 0.0
    end.postpone(60.0)
    assert signal.getitimer(signal.ITIMER_VIRTUAL) == (0.0, 0.0)


def test_two_threads_that_postpone_the_end_start_one_monitor(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The watchdog's thread and its target used to start two, the first of which never ended."""
    started = []
    both = threading.Barrier(2)

    def slowly() -> types.SimpleNamespace:
        started.append(threading.get_ident())
        with contextlib.suppress(threading.BrokenBarrierError):
            both.wait(0.2)  # the second thread gets here at once or never
        return types.SimpleNamespace(stdin=None, wait=lambda: 0)

    monkeypatch.setattr(entry, "_started_monitor", slowly)
    with ProcessEnd("bt-run", StopRequest()) as end:
        other = threading.Thread(target=end.postpone, args=(60.0,))
        other.start()
        end.postpone(60.0)
        other.join()
    assert len(started) == 1
