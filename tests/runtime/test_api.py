"""Python API: arguments, results, and isolation of runs from each other and the process."""

from __future__ import annotations

import json
import logging
import math
import os
import random
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bt_dualarm as bt
from bt_dualarm.core.errors import RunError
from bt_dualarm.runtime.options import MOST_SEED

REACH = {"reach_to_pose": {"offset": {"xyz": [0, 0, 0.05]}}}

ONE: dict[str, Any] = {
    "bt_dualarm": 1,
    "name": "one",
    "world": {"scene": "empty"},
    "params": {"seconds": {"type": "number", "default": 0.1, "range": [0, 10]}},
    "arms": {
        "arm1": {"robot": "ur5", "tree": {"sequence": [REACH, {"wait": {"seconds": "{seconds}"}}]}}
    },
}
"""An arm that moves for 0.7 s and waits."""

SEEN: dict[str, Any] = {
    "bt_dualarm": 1,
    "name": "seen",
    "world": {"scene": "empty", "seed": 3},
    "objects": {
        "cube": {
            "shape": "box",
            "size": [0.05, 0.05, 0.05],
            "mass": 0.1,
            "fixed": True,
            "color": "yellow",
            "pose": {"xyz": [0.68, 0.11, 0.701]},
            "noise": {"xyz": [0.01, 0.01, 0.01]},
        }
    },
    "arms": {
        "arm1": {
            "robot": "panda",
            "base": {"xyz": [1.6, 0.11, 0.28], "rpy": [0, 0, 180]},
            "posture": "look_out",
            "camera": {"mount": "wrist", "noise": 0.5, "drop": 0.1},
            "tree": {"timeout": {"seconds": 1.0, "child": {"track": {"color": "yellow"}}}},
        },
        "arm2": {"robot": "ur3", "base": {"xyz": [0, 1.5, 0]}, "tree": REACH},
    },
}
"""A camera with noise and a tracker beside another arm: nearly every source of randomness."""

AROUND: dict[str, Any] = {
    "bt_dualarm": 1,
    "name": "around",
    "world": {"scene": "empty", "time_limit": 3.0},
    "objects": {
        "wall": {
            "shape": "box",
            "size": [0.3, 0.02, 0.5],
            "mass": 5,
            "fixed": True,
            "spawned": False,
            "pose": {"xyz": [0.55, 0.0, 0.65]},
        }
    },
    "arms": {
        "arm1": {
            "robot": "ur5",
            "base": {"xyz": [0, 0, 0.4]},
            "tree": {
                "sequence": [
                    {"reach_to_pose": {"to": {"xyz": [0.5, 0.3, 0.6], "rpy": [180, 0, 0]}}},
                    {"spawn": {"object": "wall"}},
                    {"reach_to_pose": {"to": {"xyz": [0.5, -0.3, 0.6], "rpy": [180, 0, 0]}}},
                ]
            },
        }
    },
}
"""An arm that has to plan around a wall, in a separate process."""

TREES = {tree["name"]: tree for tree in (ONE, SEEN, AROUND)}


def sha_of(tree: Any, **options: Any) -> str:
    return bt.run(tree, renderer="ray", **options).state_sha256


@pytest.fixture(scope="module")
def alone() -> dict[str, str]:
    """Hashes of runs that are alone in the process, one after the other."""
    return {name: sha_of(tree) for name, tree in TREES.items()}


# Results


def test_a_run_returns_its_result() -> None:
    result = bt.run(ONE, params={"seconds": 0.2})
    assert (result.outcome, result.ending) == (bt.Outcome.SUCCESS, bt.Ending.FINISHED)
    assert (result.error, result.at_rest, result.name, result.renderer) == ("", True, "one", None)
    leaves = result.arms["arm1"].leaves
    assert list(leaves) == ["sequence/reach_to_pose", "sequence/wait"]
    leaf = leaves["sequence/reach_to_pose"]
    assert (leaf.status, leaf.code, leaf.reason) == ("SUCCESS", "", "")
    assert 0 <= float(leaf.metrics["position_error_m"]) < 0.001
    assert leaf.ended_s == leaves["sequence/wait"].started_s
    assert len(result.state_sha256) == 64


def test_series_are_arrays() -> None:
    result = bt.run("circle", renderer="ray")
    series = result.arms["arm1"].leaves["circle"].series
    assert {"planned", "executed"} <= series.keys()
    planned = series["planned"]
    assert planned.time.shape == (len(planned.values),)
    assert planned.values.shape == (len(planned.time), 3)
    assert np.isfinite(planned.values).all()


def test_a_leaf_that_ran_twice_reports_the_last_run_and_keeps_both() -> None:
    twice = {"repeat": {"times": 2, "child": {"wait": {"seconds": 0.1}}}}
    tree = {**ONE, "arms": {"arm1": {"robot": "ur5", "tree": twice}}}
    (leaf,) = bt.run(tree).arms["arm1"].leaves.values()
    first, last = leaf.runs
    assert first.started_s < last.started_s == leaf.started_s


def test_a_failed_tree_raises_nothing() -> None:
    tree = {**ONE, "arms": {"arm1": {"robot": "ur5", "tree": {"fail": {"reason": "so be it"}}}}}
    result = bt.run(tree)
    assert result.outcome is bt.Outcome.FAILURE
    (leaf,) = result.arms["arm1"].leaves.values()
    assert leaf.status == "FAILURE"
    assert "so be it" in leaf.reason


@pytest.mark.usefixtures("without_plots")
def test_the_hash_equals_that_of_the_record(tmp_path: Path) -> None:
    result = bt.run(ONE, record=tmp_path / "out")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["state_sha256"] == result.state_sha256 == sha_of(ONE)


# Forms of a tree


def test_a_tree_is_the_same_in_every_form(tmp_path: Path, alone: dict[str, str]) -> None:
    text = json.dumps(ONE, indent=1)
    path = tmp_path / "one.yaml"
    path.write_text(text, encoding="utf-8")
    forms = (path, str(path), text, json.dumps(ONE))
    assert {sha_of(form) for form in forms} == {alone["one"]}


def test_a_shipped_tree_is_found_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("circle", "trees/circle.yaml"):
        assert bt.check(name) == ()
    with pytest.raises(bt.DualArmError, match="did you mean 'circle'"):
        bt.check("cicle")
    (problem,) = bt.check(Path("circle"))
    assert "no such file" in problem.message, "a path is a path"


@pytest.mark.parametrize("tree", [None, 3, b"bytes", ["arms"]])
def test_other_types_are_refused_as_trees(tree: Any) -> None:
    with pytest.raises(bt.DualArmError, match="a tree is a path"):
        bt.check(tree)


def test_a_check_returns_all_problems_as_objects() -> None:
    wrong = json.loads(json.dumps(ONE).replace("ur5", "ur55").replace("offset", "ofset"))
    problems = bt.check(wrong)
    assert [problem.severity for problem in problems] == ["error"] * len(problems)
    with pytest.raises(bt.SpecError) as refused:
        bt.run(wrong)
    assert refused.value.problems == problems


def test_errors_equal_those_of_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from bt_dualarm import cli

    path = tmp_path / "bad.yaml"
    path.write_text(json.dumps(ONE, indent=1).replace("offset", "ofset"), encoding="utf-8")
    for tree, options, arguments in (
        (str(path), {}, []),
        ("cicle", {}, []),
        ("circle", {"params": {"sped": 1}}, ["--param", "sped=1"]),
        ("circle", {"record": "/dev/null"}, ["--record", "/dev/null"]),
        ("circle", {"skills": ["/no/such/folder"]}, ["--skills", "/no/such/folder"]),
    ):
        assert cli.run([tree, *arguments]) == 2
        message = capsys.readouterr().err.removeprefix("bt-run: error: ").rstrip("\n")
        with pytest.raises(bt.DualArmError) as refused:
            bt.run(tree, **options)
        assert str(refused.value) == message


class Nod(bt.Skill):
    """Nod in thought."""

    class Ports(bt.PortModel):
        times: int = bt.port(2, "how often", ge=1, le=9)

    example = "nod: {times: 2}"
    ports: Ports

    def run(self) -> Iterator[None]:
        """Wait for as many ticks."""
        for _ in range(self.ports.times):
            yield
        self.metrics["nodded"] = self.ports.times


def test_user_skills_are_classes(tmp_path: Path) -> None:
    tree = {"bt_dualarm": 1, "arms": {"arm1": {"robot": "ur5", "tree": {"nod": {"times": 3}}}}}
    assert "there is no node or skill 'nod'" in bt.check(tree)[0].message
    assert bt.check(tree, skills=[Nod]) == ()
    (leaf,) = bt.run(tree, skills=[Nod]).arms["arm1"].leaves.values()
    assert leaf.metrics == {"nodded": 3}
    assert bt.check(tree), "they are not registered permanently"
    with pytest.raises(bt.DualArmError, match="skills are classes derived from Skill"):
        bt.check(tree, skills=[3])  # type: ignore[list-item]  # that is the mistake


# Steps


@settings(max_examples=25)
@given(
    st.lists(
        st.one_of(
            st.floats(1e-4, 0.2),
            st.sampled_from([0.002, 0.001, 0.0005, 0.1 + 0.2, 1 / 3, 0.02]),
            st.fractions(Fraction(1, 1000), Fraction(1, 4)),
        ),
        max_size=30,
    )
)
def test_a_run_is_the_same_for_any_sequence_of_steps(parts: list[float | Fraction]) -> None:
    """Bit for bit; and no step goes beyond the requested time."""
    with bt.open(ONE) as run:
        requested = 0.0
        for part in parts:
            if run.done:
                break
            run.step(part)
            requested += float(part)
            assert run.done or requested - 0.0021 < run.time < requested + 1e-6
        assert run.finish().state_sha256 == sha_of_one()


@cache
def sha_of_one() -> str:
    return sha_of(ONE)


def test_a_step_may_be_a_number_of_numpy() -> None:
    """Without an overflow of its integers."""
    parts: list[Any] = [np.float32(0.1), np.float64(1 / 3), np.int64(1), np.uint8(1)]
    with bt.open(ONE) as run:
        for part in parts:
            if not run.done:
                run.step(part)
        assert run.finish().state_sha256 == sha_of_one()


def test_observing_a_run_does_not_change_it(alone: dict[str, str]) -> None:
    """All of its state is read after every step."""
    with bt.open(SEEN, renderer="ray") as run:
        assert run.time == 0.0
        assert "RUNNING" in repr(run)
        while not run.done:
            run.step(0.01)
            assert run.arms["arm1"].tool_pose.distance(run.world.arms["arm1"].tool_pose) == 0.0
            assert run.arms["arm2"].q.shape == run.arms["arm2"].v.shape == (6,)
            assert run.arms["arm1"].holds == ()
            assert run.world.object_pose("cube").position.shape == (3,)
            assert [child.kind for child in run.trees["arm1"].snapshot().children] == ["track"]
            assert all(repr(obj) for obj in (run, run.arms, run.trees))
        assert run.result.state_sha256 == alone["seen"]


def test_a_run_knows_arms_that_are_not_spawned_yet() -> None:
    late = {"robot": "ur3", "base": {"xyz": [0, 1.5, 0]}, "spawned": False, "tree": REACH}
    with bt.open({**ONE, "arms": {**ONE["arms"], "late": late}}) as run:
        arm = run.arms["late"]
        tree = run.trees["late"]
        assert (arm.is_present, arm.outcome, tree.status) == (False, None, "INVALID")
        assert tree.snapshot().kind == "reach_to_pose"
        with pytest.raises(bt.WorldError, match="no arm 'late' in the world"):
            _ = arm.q
        run.world.spawn_arm("late")
        run.step(0.05)
        assert (arm.is_present, tree.status) == (True, "RUNNING")


@pytest.mark.parametrize("name", ["amr1", "", "cube"])
def test_an_unknown_name_gets_a_suggestion(name: str) -> None:
    with bt.open(ONE) as run:
        result = run.finish()
    for mappings in (run.arms, run.trees, result.arms):
        assert mappings.get(name) is None
        with pytest.raises(bt.DualArmError, match=f"there is no arm '{name}'; .*arm1"):
            _ = mappings[name]
    with pytest.raises(bt.DualArmError, match="did you mean 'sequence/wait'"):
        _ = result.arms["arm1"].leaves["sequence/wiat"]


@pytest.mark.parametrize(
    "seconds", [0, -1, -1e-9, math.nan, math.inf, None, "1", True, 1j, np.array([0.1]), 10**400]
)
def test_a_step_is_a_time_above_0(seconds: Any) -> None:
    with bt.open(ONE) as run:
        with pytest.raises(bt.DualArmError, match="is not a number of seconds above 0"):
            run.step(seconds)
        assert run.time == 0.0


@pytest.mark.parametrize(
    ("option", "value"),
    [
        *(("seed", value) for value in (-1, MOST_SEED + 1, 1.5, "1", True, math.nan)),
        *(("duration", value) for value in (0, -1, math.nan, math.inf, "1", True)),
        *(("renderer", value) for value in ("rays", "", 3)),
        ("record", ""),
        ("record", " "),
    ],
)
def test_options_are_checked_before_anything_is_done(option: str, value: Any) -> None:
    options = {option: value}
    with pytest.raises(bt.DualArmError, match=r"is not a|there is no renderer|empty name"):
        bt.open("no such tree", **options)


def test_a_finished_run_stays_finished() -> None:
    with bt.open(ONE) as run:
        with pytest.raises(bt.DualArmError, match=r"the run is not over: it is at 0\.000 s"):
            _ = run.result
        result = run.finish()
        assert run.finish() is run.result is result
        with pytest.raises(bt.DualArmError, match="it cannot be stepped any further"):
            run.step(0.1)
    run.close()
    with pytest.raises(bt.DualArmError, match="it cannot be stepped any further"):
        run.step(0.1)
    assert (run.done, run.result) == (True, result)


@pytest.mark.usefixtures("without_plots")
def test_a_run_that_is_left_early_is_closed_as_unfinished(tmp_path: Path) -> None:
    with bt.open(ONE, record=tmp_path) as run:
        run.step(0.1)
    assert run.result.ending is bt.Ending.CLOSED
    assert run.result.outcome is bt.Outcome.UNFINISHED
    assert run.result.sim_time_s == pytest.approx(0.1)
    leaf = run.result.arms["arm1"].leaves["sequence/reach_to_pose"]
    assert (leaf.status, leaf.code) == ("INVALID", "HALTED")
    assert json.loads((tmp_path / "summary.json").read_text())["ending"] == run.result.ending


def test_a_run_can_be_stopped() -> None:
    with bt.open(ONE) as run:
        run.step(0.1)
        run.stop()
        result = run.finish()
    assert (result.ending, result.at_rest) == (bt.Ending.STOPPED, True)
    assert result.sim_time_s < 0.6, "a stop, and not the whole motion"


def test_an_observer_cannot_advance_its_run() -> None:
    class Meddler:
        def on_event(self, change: object) -> None: ...

        def after_ticks(self, view: object) -> None: ...

        def after_step(self, time: float) -> None:
            with pytest.raises(bt.DualArmError, match="is already being advanced"):
                run.step(0.1)
            times.append(time)

    times: list[float] = []
    with bt.open(ONE) as run:
        run.watch(Meddler())
        run.step(0.01)
    assert times


# Isolation of runs


def test_consecutive_runs_are_independent(alone: dict[str, str]) -> None:
    for name in ("around", "one", "seen", "one"):
        assert sha_of(TREES[name]) == alone[name]


@pytest.mark.parametrize("seed", range(2))
def test_simultaneous_runs_are_independent(seed: int, alone: dict[str, str]) -> None:
    """Steps of several runs, some of them of one tree, in any order."""
    rng = random.Random(seed)  # noqa: S311 - nothing secret
    opened = [bt.open(TREES[name], renderer="ray") for name in ("one", "seen", "around", "one")]
    while open_ones := [run for run in opened if not run.done]:
        rng.choice(open_ones).step(rng.uniform(0.002, 0.3))
    for run in opened:
        run.close()
        assert run.result.state_sha256 == alone[run.name]


def test_runs_in_threads_are_independent(alone: dict[str, str], tmp_path: Path) -> None:
    def hash_of(name: str) -> str:
        return sha_of(TREES[name], record=tmp_path / f"{name}{threading.get_ident()}")

    with ThreadPoolExecutor(3) as pool:
        assert list(pool.map(hash_of, TREES)) == [alone[name] for name in TREES]


class Mutter(bt.Skill):
    """Say something into the log."""

    class Ports(bt.PortModel):
        what: str = bt.port("nothing", "what is said")

    example = "mutter: {what: nothing}"
    ports: Ports

    def run(self) -> Iterator[None]:
        """Say it with every tick."""
        for _ in range(5):
            self.context.log.info("%s", self.ports.what)
            yield


def test_logs_of_runs_are_separate_and_the_logger_is_restored(tmp_path: Path) -> None:
    logger = logging.getLogger("bt_dualarm")
    before = logger.level, list(logger.handlers)
    words = ("apple", "pear")
    runs = []
    for what in words:
        arm = {"robot": "ur5", "tree": {"mutter": {"what": what}}}
        tree = {**ONE, "arms": {"arm1": arm}}
        runs.append(bt.open(tree, record=tmp_path / what, skills=[Mutter]))
    while not all(run.done for run in runs):
        for run in runs:
            run.step(0.02)
            assert (logger.level, list(logger.handlers)) == before
    for run in runs:
        run.stop()
        run.stop()  # urgent: without plots
        run.close()
    for what in words:
        assert (tmp_path / what / "run.log").read_text().split() == [what] * 5
    assert (logger.level, list(logger.handlers)) == before


def test_nothing_is_printed(capfd: pytest.CaptureFixture[str]) -> None:
    """Not even for a skill that raises, or by a logger without configuration."""
    tree = {**ONE, "arms": {"arm1": {"robot": "ur5", "tree": {"nod": {}}}}}
    program = f"import bt_dualarm as bt; print(bt.run({tree!r}, skills=[Broken]).outcome)"
    broken = (
        "import bt_dualarm\n"
        "class Nod(bt_dualarm.Skill):\n"
        "    'Break.'\n"
        "    def run(self):\n"
        "        yield\n"
        "        raise RuntimeError('boom')\n"
        "Broken = Nod\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", broken + program], capture_output=True, text=True, check=True
    )
    assert (done.stdout, done.stderr) == ("FAILURE\n", "")


def test_an_unclosed_run_is_cleaned_up_before_the_interpreter_ends() -> None:
    """Later, nothing can be imported anymore, and Python would print the resulting error."""
    tree = {**ONE, "arms": {"arm1": {"robot": "ur5", "tree": {"nod": {}}}}}
    program = (
        "import bt_dualarm as bt\n"
        "class Nod(bt.Skill):\n"
        "    'Nod on and on.'\n"
        "    def run(self):\n"
        "        try:\n"
        "            while True:\n"
        "                yield\n"
        "        finally:\n"
        "            import colorsys\n"
        "            print('cleaned up with', colorsys.__name__)\n"
        f"left = bt.open({tree!r}, skills=[Nod])\n"
        "left.step(0.02)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert (done.stdout, done.stderr) == ("cleaned up with colorsys\n", "")


@pytest.mark.usefixtures("without_plots")
@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError, SystemExit])
def test_an_exception_in_the_block_closes_everything(
    error: type[BaseException], tmp_path: Path
) -> None:
    """The planning process has ended, the record is written and its folder unlocked."""
    pid = None

    def break_while_it_plans() -> None:
        nonlocal pid
        with bt.open(AROUND, record=tmp_path) as run:
            while (pid := run.assembly.planning.pid) is None:
                run.step(0.02)
            raise error

    with pytest.raises(error):
        break_while_it_plans()
    assert pid is not None
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    assert json.loads((tmp_path / "summary.json").read_text())["outcome"] == "UNFINISHED"
    assert not list(tmp_path.glob(".*"))


class Pressed(bt.Skill):
    """Simulates Ctrl-C while a skill computes, or cleans up."""

    class Ports(bt.PortModel):
        """When."""

        late: bool = bt.port(default=False, description="only when it is halted")

    example = "pressed"
    ports: Ports

    def run(self) -> Iterator[None]:
        """Wait for the end."""
        try:
            yield
            if not self.ports.late:
                os.kill(os.getpid(), signal.SIGINT)
            yield
        finally:
            if self.ports.late:
                os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize("late", [False, True])
def test_ctrl_c_during_a_skill_is_no_failure_of_the_skill(late: bool) -> None:
    """It is raised as KeyboardInterrupt, not a failure of the leaf; the handler stays Python's."""
    tree = {**ONE, "arms": {"arm1": {"robot": "ur5", "tree": {"pressed": {"late": late}}}}}
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            bt.run(tree, duration=0.1, skills=[Pressed])
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_ctrl_c_during_a_run_leaves_no_process() -> None:
    """Python raises KeyboardInterrupt anywhere; the run is closed as it propagates."""
    program = (
        "import os, signal, sys, threading, time\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's & ignores it\n"
        "import bt_dualarm as bt\n"
        f"tree = {AROUND!r}\n"
        "from bt_dualarm.planning import process\n"
        "spawn = process.spawn\n"
        "def spawning():\n"
        "    made = spawn()\n"
        "    print(made[0].pid, flush=True)\n"
        "    threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT)).start()\n"
        "    return made\n"
        "process.spawn = spawning\n"
        "bt.run(tree, real_time=True)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == -signal.SIGINT
    assert done.stderr.rstrip().endswith("KeyboardInterrupt")
    with pytest.raises(ProcessLookupError):
        os.kill(int(done.stdout), 0)


# The facade


def test_the_facade_lists_its_contents() -> None:
    assert {"run", "open", "check", "__version__", "Skill"} <= set(dir(bt))
    assert all(hasattr(bt, name) for name in dir(bt))
    assert all(getattr(bt, name).__doc__ for name in ("run", "open", "check", "Run", "RunResult"))
    assert bt.__version__.split(".")[0].isdecimal()
    with pytest.raises(AttributeError, match="has no attribute 'rnu'"):
        _ = bt.rnu  # type: ignore[attr-defined]  # that is the mistake


def test_importing_loads_no_heavy_modules() -> None:
    code = (
        "import sys; before = set(sys.modules); import bt_dualarm; "
        "print(sorted(name for name in set(sys.modules) - before if '.' not in name))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"numpy", "pydantic", "mujoco", "yaml", "logging"} & set(eval(done.stdout))  # noqa: S307 - our own list


def test_the_module_is_bt_run() -> None:
    command = [sys.executable, "-m", "bt_dualarm"]
    done = subprocess.run([*command, "--help"], capture_output=True, text=True, check=True)
    assert "Run the behavior trees of a file" in done.stdout
    subprocess.run([*command, "circle", "--display", "quiet"], check=True)


def test_a_result_reports_the_reality_of_each_arm() -> None:
    """An argument is for all arms, a file's for those that it names; ideal arms report nothing."""
    tree = {
        "bt_dualarm": 1,
        "world": {"scene": "empty", "reality": "rough"},
        "arms": {"arm1": {"robot": "ur5", "reality": "ideal", "tree": {"wait": 0.01}}},
    }
    assert bt.run(tree).reality == {"arm1": {}}
    reported = bt.run(tree, reality={"drive": {"delay": 0.002}, "links": {"mass": 0.1}}).reality
    assert reported == {"arm1": {"drive": {"delay": 0.002}, "links": {"mass": {"uniform": 0.1}}}}
    assert bt.run(tree, reality="lab").reality["arm1"].keys() >= {"links", "friction", "camera"}
    with pytest.raises(RunError, match="no reality 'lap'; did you mean 'lab'"):
        bt.run(tree, reality="lap")
