"""Planning in a complete run: concurrent, repeatable, and over when the run is."""

from __future__ import annotations

import os
import signal
from typing import Any

import pytest

from bt_dualarm.runtime.outcome import Ending
from tests.plays import Play, Stage

WALL = {
    "shape": "box",
    "size": [0.3, 0.02, 0.5],
    "mass": 5,
    "fixed": True,
    "spawned": False,
    "pose": {"xyz": [0.55, 0.0, 0.65]},
}

LEFT, RIGHT = (
    {"reach_to_pose": {"to": {"xyz": [0.5, y, 0.6], "rpy": [180, 0, 0]}}} for y in (0.3, -0.3)
)


FAR_ARM = {
    "arm2": {"robot": "ur10", "base": {"xyz": [4, 0, 0.4]}, "tree": {"wait": {"seconds": 1}}}
}


def around(*last: Any) -> dict[str, Any]:
    """An arm moves to the left of a wall, then runs ``last``; moving right needs a search."""
    tree = {"sequence": [LEFT, {"spawn": {"object": "wall"}}, *(last or [RIGHT])]}
    arm = {"robot": "ur5", "base": {"xyz": [0, 0, 0.4]}, "tree": tree}
    return {
        "name": "around",
        "world": {"scene": "empty"},
        "objects": {"wall": WALL},
        "arms": {"arm1": arm},
    }


def process_of(play: Play) -> int | None:
    return play.opened.assembly.planning.pid


def planning_processes(play: Play) -> set[int | None]:
    """Every process that plans for a run, and None for the time before."""
    seen: set[int | None] = set()
    play.watchers.append(lambda _: seen.add(process_of(play)))
    return seen


def test_the_planning_process_is_reused_and_runs_are_bit_identical(
    stage: Stage,
) -> None:
    """However long their processes take to start and to search, and whatever they did before."""
    pids: list[int | None] = []
    states = []
    for _ in range(2):
        play = stage.play(around())
        seen = planning_processes(play)
        play.run()
        assert [leaf.status for leaf in play.arm().runs] == ["SUCCESS"] * 3
        pids += seen - {None}
        assert process_of(play) is None
        states.append(play.world.state().tobytes())
    first, second = pids
    assert first == second
    assert states[0] == states[1]


def test_a_run_can_be_stopped_while_it_plans(stage: Stage) -> None:
    """Ctrl-C goes to the run, which halts the leaf, which abandons its problem."""
    seen: set[int] = set()
    play = stage.play(around())

    def interrupt(_: object) -> None:
        pid = process_of(play)
        if pid is not None and not seen:
            seen.add(pid)
            play.opened.stop()

    play.watchers.append(interrupt)
    result = play.run()
    assert result.ending is Ending.STOPPED
    assert result.at_rest
    (pid,) = seen
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


@pytest.mark.parametrize("arms", [{}, FAR_ARM], ids=["alone", "beside a far arm"])
def test_a_process_that_dies_fails_its_leaf_and_nothing_else(
    stage: Stage, arms: dict[str, Any]
) -> None:
    """The other branch plans again, in a new process, and succeeds.

    An arm out of reach, which cannot be the reason, is not waited for.
    """
    killed: set[int] = set()
    file = around({"selector": [RIGHT, RIGHT]})
    play = stage.play(file | {"arms": file["arms"] | arms})

    def kill(_: object) -> None:
        pid = process_of(play)
        if pid is not None and not killed:
            killed.add(pid)
            os.kill(pid, signal.SIGKILL)

    play.watchers.append(kill)
    play.run()
    failed, again = play.arm().runs[2:]
    assert (failed.code, again.status) == ("NO_PLAN", "SUCCESS")
    assert "was killed by signal 9" in failed.reason
