"""Calls of a function on the engines of sweeps: deaths, resuming, order, failures."""

from __future__ import annotations

import argparse
import math
import os
import re
import shutil
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count, islice
from pathlib import Path
from typing import Any

import pytest

from benchmarks import campaign as campaign_module
from benchmarks.campaign import Campaign, Drawn, add_options
from bt_dualarm.sweeps.calls import Call, calls_of, run_calls
from bt_dualarm.sweeps.engine import Done, Engine, ProcessEngine, Task
from bt_dualarm.sweeps.job import COST_COLUMNS
from bt_dualarm.sweeps.manifest import SweepError
from bt_dualarm.sweeps.sweep import Progress
from tests.sweeps import example_calls

MODULE = "tests.sweeps.example_calls"


@dataclass
class HereEngine:
    """Runs calls in this process, in an order selected by `turn`."""

    turn: int = 0
    slots: int = 3
    queue: deque[Task] = field(default_factory=deque)

    def submit(self, task: Task) -> None:
        self.queue.append(task)

    def completed(self, timeout: float) -> Sequence[Done]:
        if not self.queue:
            return []
        self.queue.rotate(self.turn)
        task = self.queue.pop()
        return [Done(task, task.job.run(), "here")]

    def close(self) -> None:
        """Do nothing, as there are no processes."""


def options(folder: Path | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_options(parser)
    given = [] if folder is None else ["--out", str(folder)]
    return parser.parse_args([*given, "--jobs", "1"])


def results_here(
    folder: Path | None,
    function: Callable[..., Any],
    cases: Iterable[dict[str, Any]],
    turn: int = 0,
) -> list[Any]:
    """Results of a campaign that runs in this process."""
    with Campaign(options(folder)) as campaign:
        campaign._start = partial(HereEngine, turn)
        return [result for _, result in campaign.run(function, cases)]


def squares(folder: Path, *numbers: int) -> list[Call]:
    return list(
        calls_of(f"{MODULE}:square", [{"number": n, "folder": str(folder)} for n in numbers])
    )


def nothing_left() -> Engine:
    raise AssertionError("nothing is left to run")


def runs_of(folder: Path) -> dict[str, int]:
    return {path.name: len(path.read_text()) for path in sorted(folder.glob("calls_*"))}


@pytest.mark.slow
def test_dead_worker_costs_one_attempt_and_three_deaths_are_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The other cases have results, and the exit code shows that one is missing."""
    times = {1: 0, 2: 1, 3: 3, 4: 0}
    cases = [{"number": n, "times": t, "folder": str(tmp_path)} for n, t in times.items()]
    with pytest.raises(SystemExit) as end, Campaign(options(tmp_path / "out")) as campaign:
        found = [result for _, result in campaign.run(example_calls.die, cases)]
    assert end.value.code == 1
    assert found == [1, 2, 4]
    output = capsys.readouterr().err
    assert f"{MODULE}:die(number=3, times=3" in output
    assert "CRASHED WORKER_DIED: each of 3 worker processes died" in output
    assert f"cases without a result: 1; the same command with --out {tmp_path / 'out'}" in output
    # The case has died often enough to succeed now: only it runs again.
    with Campaign(options(tmp_path / "out")) as campaign:
        campaign._start = HereEngine
        assert [result for _, result in campaign.run(example_calls.die, cases)] == [1, 2, 3, 4]


def test_finished_calls_do_not_run_again(tmp_path: Path) -> None:
    """Neither after an interruption, nor in a longer or reordered list."""
    out = tmp_path / "out"
    with closing(run_calls(squares(tmp_path, 1, 2, 3, 4), out, HereEngine)) as results:
        assert next(results)[0].arguments["number"] == 1
    before = runs_of(tmp_path)
    rows = [row for _, row in run_calls(squares(tmp_path, 5, 4, 3, 2, 1), out, HereEngine)]
    assert [row["argument.number"] for row in rows] == [5, 4, 3, 2, 1]
    assert set(before.items()) <= set(runs_of(tmp_path).items())
    assert set(runs_of(tmp_path).values()) == {1}
    again = [row for _, row in run_calls(squares(tmp_path, 5, 4, 3, 2, 1), out, nothing_left)]
    assert [row["result"] for row in again] == [row["result"] for row in rows]


def test_results_do_not_depend_on_workers_or_order(tmp_path: Path) -> None:
    """Numbers are returned exactly, including those that a table would round or convert."""
    lists = []
    for turn, slots in ((0, 1), (0, 3), (1, 3), (2, 7)):
        start = partial(HereEngine, turn, slots)
        out = tmp_path / f"out_{turn}_{slots}"
        lists.append([
            {name: cell for name, cell in row.items() if name not in COST_COLUMNS}
            for _, row in run_calls(squares(tmp_path, *range(9)), out, start)
        ])  # fmt: skip
    assert all(rows == lists[0] for rows in lists)
    cases = [{"number": n, "folder": str(tmp_path)} for n in range(3)]
    found = results_here(None, example_calls.square, cases, turn=1)
    assert [one["third"] for one in found] == [0.0, 1 / 3, 2 / 3]
    assert [one["parts"] for one in found] == [[0, None], [1, None], [2, None]]
    assert math.isnan(found[0]["nan"])


def test_exception_of_the_function_is_reported_with_its_case(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All other calls run, and the next time only the failed ones."""
    states: list[Progress] = []
    calls = list(calls_of(f"{MODULE}:quarrel", [{"number": n} for n in range(2, 7)]))
    rows = [row for _, row in run_calls(calls, tmp_path, HereEngine, progress=states.append)]
    assert [row["outcome"] for row in rows] == ["SUCCESS", "ERROR", "ERROR", "FAILURE", "SUCCESS"]
    assert rows[1]["reason"] == "nothing comes of 3"
    assert "in quarrel" in str(rows[1]["traceback"])
    assert rows[2]["reason"] == "a object is nothing that JSON can express"
    assert str(states[-1].rate) == "40.0 % (11.8 to 76.9)"
    assert states[-1].failures == {"ValueError": 1, "TypeError": 1, "ODD": 1}
    with pytest.raises(SystemExit):
        results_here(tmp_path, example_calls.quarrel, [{"number": 2}, {"number": 3}])
    output = capsys.readouterr().err
    assert f"{MODULE}:quarrel(number=3): ERROR ValueError: nothing comes of 3" in output
    assert 'raise ValueError(f"nothing comes of' in output


def test_endless_cases_run_until_enough_of_them_count(tmp_path: Path) -> None:
    cases: Iterator[dict[str, Any]] = ({"number": n} for n in count(1))
    with Campaign(options(tmp_path)) as campaign:
        campaign._start = partial(HereEngine, 1)
        found = [result for _, result in campaign.run(example_calls.even, cases, wanted=3)]
        assert found == [None, 2, None, 4, None, 6]
        campaign._start = nothing_left
        again = campaign.run(example_calls.even, ({"number": n} for n in count(1)), wanted=3)
        assert [result for _, result in again] == found
        assert not list(campaign.run(example_calls.even, cases, wanted=0))


def test_items_can_be_accessed_by_number_in_any_order() -> None:
    begun: list[int] = []

    def begin() -> Iterator[int]:
        begun.append(0)
        return (n * n for n in count())

    items = Drawn(begin)
    assert [items[n] for n in (0, 3, 3, 5)] == [0, 9, 9, 25]
    assert len(begun) == 1
    assert [items[n] for n in (2, 4)] == [4, 16]
    assert len(begun) == 2


def interrupted(campaign: Campaign) -> None:
    """Raise Ctrl-C after the first of four cases."""
    with campaign:
        campaign._start = HereEngine
        for _ in campaign.run(example_calls.even, [{"number": n} for n in range(4)]):
            raise KeyboardInterrupt


def test_calls_started_ahead_do_not_affect_the_next_run(tmp_path: Path) -> None:
    with Campaign(options(tmp_path / "out")) as campaign:
        campaign._start = partial(HereEngine, -1)  # the oldest first, as the list is endless
        endless = ({"number": n} for n in count())
        assert len(list(campaign.run(example_calls.even, endless, wanted=1))) == 1
        cases = [{"number": n, "folder": str(tmp_path)} for n in range(4)]
        found = [result["square"] for _, result in campaign.run(example_calls.square, cases)]
    assert found == [0, 1, 4, 9]


def test_temporary_folder_is_deleted_unless_results_are_missing(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with Campaign(options(None)) as campaign:
        folder = campaign._folder
        campaign._start = HereEngine
        assert len(list(campaign.run(example_calls.even, [{"number": 2}]))) == 1
    assert not folder.exists()
    campaign = Campaign(options(None))
    with pytest.raises(SystemExit) as end:
        interrupted(campaign)
    assert end.value.code == 130
    output = capsys.readouterr().err
    assert f"interrupted; the same command with --out {campaign._folder}" in output
    assert list(campaign._folder.glob("rows/*.parquet"))
    shutil.rmtree(campaign._folder)


def test_changed_code_is_refused_and_changes_the_identity(tmp_path: Path) -> None:
    call = next(calls_of(f"{MODULE}:even", [{"number": 2}]))
    assert {"module", "code", "trees", "version of numpy"} <= set(call.inputs)
    changed = replace(call, inputs={**call.inputs, "module": "0123456789abcdef"})
    assert changed.identity != call.identity
    assert replace(call, index=5).identity == call.identity
    with pytest.raises(SweepError, match=r"cannot run .*even\(number=2\): it differs .* in module"):
        list(run_calls([changed], tmp_path, HereEngine))


def test_digest_of_a_module_includes_its_imports() -> None:
    one, other = (
        next(calls_of(f"benchmarks.{name}:main", [{}])).inputs for name in ("grasping", "inserting")
    )
    assert one["module"] != other["module"]
    assert one["code"] == other["code"]


@pytest.mark.parametrize(
    ("function", "cases", "message"),
    [
        ("no_module:f", [{}], "cannot import the function no_module:f"),
        (f"{MODULE}:missing", [{}], "cannot import the function .*:missing"),
        (f"{MODULE}:even", [{"number": object()}], "argument of case 0 of .*: a object is nothing"),
    ],
)
def test_invalid_calls_are_errors_before_anything_runs(
    function: str, cases: list[dict[str, Any]], message: str
) -> None:
    with pytest.raises(SweepError, match=message):
        list(islice(calls_of(function, cases), 1))


@pytest.mark.slow
def test_worker_processes_run_calls(tmp_path: Path) -> None:
    engine = ProcessEngine(1)
    try:
        calls = squares(tmp_path, 3, 4)
        rows = [row for _, row in run_calls(calls, tmp_path / "out", lambda: engine)]
    finally:
        engine.close()
    here = [call.run() for call in calls]
    assert [row["result"] for row in rows] == [row["result"] for row in here]


LINGER = """
import sys, time
from pathlib import Path
from bt_dualarm.sweeps.calls import calls_of
from bt_dualarm.sweeps.engine import ProcessEngine, Task

engine = ProcessEngine(1)
cases = [{"number": 0, "folder": sys.argv[1]}]
engine.submit(Task(next(iter(calls_of("tests.sweeps.example_calls:linger", cases)))))
begun = Path(sys.argv[1], "lingers_0")
while not (begun.exists() and begun.read_text()):  # it may exist, and not yet be written
    engine.completed(0.1)
print("begun", flush=True)
sys.stdin.read()
engine.close()
"""


@pytest.mark.slow
@pytest.mark.parametrize("is_killed", [False, True])
def test_workers_leave_no_temporary_files(tmp_path: Path, is_killed: bool) -> None:
    """Neither those that are killed in the middle of a call, nor those whose parent is killed."""
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    command = [sys.executable, "-c", LINGER, str(tmp_path)]
    pipe = subprocess.PIPE
    environment = os.environ | {"TMPDIR": str(scratch)}
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, env=environment) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == b"begun\n"
        used = Path((tmp_path / "lingers_0").read_text())
        assert used.is_relative_to(scratch)
        assert used.exists()
        if is_killed:
            parent.kill()
    until = time.monotonic() + 20.0
    while any(scratch.iterdir()) and is_killed and time.monotonic() < until:
        time.sleep(0.05)
    assert [*scratch.iterdir()] == []


def test_every_benchmark_is_a_campaign_or_a_listed_exception() -> None:
    """The docstring of `benchmarks.campaign` lists the exceptions."""
    named = re.findall(r"`(\w+)`", str(campaign_module.__doc__))
    folder = Path(str(campaign_module.__file__)).parent
    texts = {path.stem: path.read_text(encoding="utf-8") for path in folder.glob("*.py")}
    run = {name for name, text in texts.items() if '__name__ == "__main__"' in text}
    assert {name for name in run if "with Campaign(" not in texts[name]} <= set(named)
    assert {name for name in named if name in run and "with Campaign(" in texts[name]} == {
        "gripping"
    }
