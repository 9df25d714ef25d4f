"""The planning process: it plans as this process does, and its failures block nothing."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from bt_dualarm.core.errors import Failure
from bt_dualarm.planning import process
from bt_dualarm.planning.problem import motion_around
from bt_dualarm.planning.process import PlanningProcess
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.trajectory import Trajectory
from tests.control.walls import LEFT, RIGHT, locked_world, problem_in, walled_world

ROOT = Path(__file__).parents[2]

ENDLESS = 10**9
"""A budget of checks that no test waits to see spent."""

TIMEOUT_S = 60.0
"""Wall-clock seconds after which a process that should have ended counts as hung."""


@pytest.fixture(scope="module")
def world() -> World:
    return walled_world()


@pytest.fixture(scope="module")
def planning() -> Iterator[PlanningProcess]:
    """One for all tests: if a test ends it, it restarts with the next problem."""
    process = PlanningProcess()
    yield process
    process.close()


def is_same(one: Trajectory, other: Trajectory) -> bool:
    return one.q.tobytes() == other.q.tobytes() and one.v.tobytes() == other.v.tobytes()


def test_plans_equal_those_of_this_process_bit_for_bit(
    planning: PlanningProcess, world: World
) -> None:
    """Whatever it has planned before, and in whichever process."""
    there = problem_in(world, RIGHT, LEFT)
    back = problem_in(world, LEFT, RIGHT, seed=5)
    pending = [planning.solve(problem) for problem in (back, there)]
    here = motion_around(there)
    assert is_same(pending[1].result(), here)
    assert not is_same(pending[0].result(), here)
    planning.close()
    assert is_same(planning.solve(there).result(), here)


def test_the_reason_for_a_missing_path_is_transmitted(planning: PlanningProcess) -> None:
    problem = problem_in(locked_world(), RIGHT, LEFT, checks=500)
    with pytest.raises(Failure, match="RRTConnect") as caught:
        planning.solve(problem).result()
    assert caught.value.code == "NO_PLAN"
    assert 500 <= int(caught.value.numbers["states"]) < 1000


def test_a_search_that_is_abandoned_ends_and_the_next_one_is_answered(
    planning: PlanningProcess, world: World
) -> None:
    """Were the first one to go on, this test would not end."""
    first = planning.solve(problem_in(locked_world(), RIGHT, LEFT, checks=ENDLESS))
    waiting = planning.solve(problem_in(locked_world(), RIGHT, LEFT, checks=ENDLESS))
    last = planning.solve(problem_in(world, RIGHT, LEFT))
    waiting.abandon()
    first.abandon()
    assert len(last.result()) > 1
    last.abandon()  # harmless


def test_a_process_that_dies_fails_its_problem_and_the_next_gets_another(
    planning: PlanningProcess, world: World
) -> None:
    pending = planning.solve(problem_in(locked_world(), RIGHT, LEFT, checks=ENDLESS))
    dead = planning.pid
    assert dead is not None
    os.kill(dead, signal.SIGKILL)
    with pytest.raises(Failure, match="was killed by signal 9") as caught:
        pending.result()
    assert caught.value.code == "NO_PLAN"
    assert caught.value.numbers["exit_code"] == -9
    pending.abandon()
    assert len(planning.solve(problem_in(world, RIGHT, LEFT)).result()) > 1
    assert planning.pid != dead


def test_ctrl_c_does_not_end_the_process(planning: PlanningProcess, world: World) -> None:
    """It has its own process group, and ignores the signal itself."""
    planning.solve(problem_in(world, RIGHT, LEFT)).result()
    pid = planning.pid
    assert pid is not None
    assert os.getpgid(pid) != os.getpgid(0)
    os.kill(pid, signal.SIGINT)
    assert len(planning.solve(problem_in(world, RIGHT, LEFT)).result()) > 1
    assert planning.pid == pid


@pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="only Linux can wait for any process")
def test_the_process_dies_with_its_parent_during_a_search() -> None:
    """The parent is killed, so it cannot clean up; the pipe to its child breaks."""
    program = textwrap.dedent(
        """
        import os, signal, sys
        from bt_dualarm.planning.process import PlanningProcess
        from tests.control.walls import LEFT, RIGHT, locked_world, problem_in, walled_world
        planning = PlanningProcess()
        planning.solve(problem_in(walled_world(), RIGHT, LEFT)).result()
        planning.solve(problem_in(locked_world(), RIGHT, LEFT, checks=10**9))
        os.write(1, b"%d" % planning.pid)
        os.kill(os.getpid(), signal.SIGKILL)
        """
    )
    parent = subprocess.run(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, cwd=ROOT, check=False
    )
    assert parent.returncode == -signal.SIGKILL
    with contextlib.suppress(ProcessLookupError):  # gone already
        child = os.pidfd_open(int(parent.stdout))
        ended, _, _ = select.select([child], [], [], TIMEOUT_S)
        os.close(child)
        assert ended


def test_an_exception_in_the_planner_is_reported(planning: PlanningProcess, world: World) -> None:
    broken = problem_in(world, RIGHT, LEFT, goals=(np.full(3, np.nan),))
    with pytest.raises(Failure, match="the planner raised ") as caught:
        planning.solve(broken).result()
    assert caught.value.code == "NO_PLAN"


def test_a_process_that_cannot_be_started_is_reported(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with pytest.raises(Failure, match="no planning process can be started") as caught:
        PlanningProcess().solve(problem_in(world, RIGHT, LEFT))
    assert caught.value.code == "NO_PLAN"


def test_the_process_starts_with_the_first_problem_and_ends_when_closed(
    planning: PlanningProcess, world: World
) -> None:
    assert PlanningProcess().pid is None
    planning.solve(problem_in(world, RIGHT, LEFT))
    pid = planning.pid
    assert pid is not None
    planning.close()  # in the middle of it
    with pytest.raises(ProcessLookupError):  # not even a zombie
        os.kill(pid, 0)


def test_an_idle_process_is_reused(world: World) -> None:
    """At most one idle process is kept, and one that has died meanwhile is not reused."""
    problem = problem_in(world, RIGHT, LEFT)
    first, second = PlanningProcess(), PlanningProcess()
    for planning in (first, second):
        planning.solve(problem).result()
    kept, ended = first.pid, second.pid
    assert kept is not None
    assert ended is not None
    first.close()
    second.close()
    with pytest.raises(ProcessLookupError):
        os.kill(ended, 0)
    first.solve(problem).result()
    assert first.pid == kept
    first.close()
    os.kill(kept, signal.SIGKILL)
    os.waitid(os.P_PID, kept, os.WEXITED | os.WNOWAIT)
    first.solve(problem).result()
    assert first.pid not in (None, kept)
    first.close()


def test_a_forked_child_leaves_its_parents_process_alone(world: World) -> None:
    problem = problem_in(world, RIGHT, LEFT)
    planning = PlanningProcess()
    planning.solve(problem).result()
    kept = planning.pid
    planning.close()
    child = os.fork()
    if child == 0:
        os._exit(1 if process._idle else 0)
    assert os.waitpid(child, 0)[1] == 0
    planning.solve(problem).result()
    assert planning.pid == kept
    planning.close()


def test_a_process_that_is_stopped_is_not_waited_for(
    planning: PlanningProcess, world: World
) -> None:
    """Whether it is searching or idle; each time, the next problem gets another process."""
    problem = problem_in(world, RIGHT, LEFT)
    endless = problem_in(locked_world(), RIGHT, LEFT, checks=ENDLESS)
    for busy in (True, False):
        planning.solve(problem).result()
        pending = planning.solve(endless) if busy else None
        stopped = planning.pid
        assert stopped is not None
        os.kill(stopped, signal.SIGSTOP)
        with pytest.raises(Failure, match="was stopped by signal 19") as caught:
            (pending or planning.solve(problem)).result()
        assert caught.value.code == "NO_PLAN"
        assert len(planning.solve(problem).result()) > 1
        assert planning.pid != stopped


def test_an_endless_search_times_out(
    planning: PlanningProcess, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise this test would not end. Its process is replaced as well."""
    pending = planning.solve(problem_in(locked_world(), RIGHT, LEFT, checks=ENDLESS))
    lost = planning.pid
    with monkeypatch.context() as patched:
        patched.setattr(process, "LONGEST_S", 0.1)
        with pytest.raises(Failure, match=r"gave no answer for 0\.1 s") as caught:
            pending.result()
    assert caught.value.code == "NO_PLAN"
    pending.abandon()
    assert len(planning.solve(problem_in(world, RIGHT, LEFT)).result()) > 1
    assert planning.pid != lost
