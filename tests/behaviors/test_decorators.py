"""Tick tables of nodes with one child; time passes by one second a tick."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from tests.behaviors.ticking import Stage, rows

TABLES = {
    "inverter": (
        "inverter: {child: {act: {script: RF}}}",
        """
        tick | inverter, child
        1    | R R
        2    | S F
        """,
    ),
    "inverter of a success": (
        "inverter: {child: {act: {script: S}}}",
        """
        tick | inverter, child
        1    | F S
        """,
    ),
    "force_success": (
        "force_success: {child: {act: {script: RF}}}",
        """
        tick | force_success, child
        1    | R R
        2    | S F
        """,
    ),
    "force_failure": (
        "force_failure: {child: {act: {script: RS}}}",
        """
        tick | force_failure, child
        1    | R R
        2    | F S
        """,
    ),
    "retry until success": (
        "retry: {times: 3, child: {act: {script: F|RS}}}",
        """
        tick | retry, child
        1    | R F
        2    | R R
        3    | S S
        """,
    ),
    "retry fails when its attempts are used up": (
        "retry: {times: 2, child: {act: {script: F}}}",
        """
        tick | retry, child
        1    | R F
        2    | F F
        """,
    ),
    "retry with a pause": (
        "retry: {times: 2, delay: 2 s, child: {act: {script: F|S}}}",
        """
        tick | retry, child
        1    | R F
        2    | R F
        3    | S S
        """,
    ),
    "repeat until its count": (
        "repeat: {times: 2, child: {act: {script: RS}}}",
        """
        tick | repeat, child
        1    | R R
        2    | R S
        3    | R R
        4    | S S
        """,
    ),
    "repeat ends with a failure": (
        "repeat: {times: forever, child: {act: {script: S|S|F}}}",
        """
        tick | repeat, child
        1    | R S
        2    | R S
        3    | F F
        """,
    ),
    "timeout": (
        "timeout: {seconds: 2, child: {act: {script: RRRR}}}",
        """
        tick | timeout, child
        1    | R R
        2    | R R
        3    | F -
        """,
    ),
    "timeout: an end at the deadline counts": (
        "timeout: {seconds: 2, child: {act: {script: RRS}}}",
        """
        tick | timeout, child
        1    | R R
        2    | R R
        3    | S S
        """,
    ),
    "delay": (
        "delay: {seconds: 2, child: {act: {script: RS}}}",
        """
        tick | delay, child
        1    | R -
        2    | R -
        3    | R R
        4    | S S
        """,
    ),
    "rate: every other tick": (
        "rate: {hz: 0.5, child: {act: {script: RRS}}}",
        """
        tick | rate, child
        1    | R R
        2    | R R
        3    | R R
        4    | R R
        5    | S S
        """,
    ),
    "on_halt does nothing at a normal end": (
        "on_halt: {child: {act: {script: RS}}, cleanup: {act: {script: S}}}",
        """
        tick | on_halt, child, cleanup
        1    | R R -
        2    | S S -
        """,
    ),
    "run_once repeats its result": (
        "repeat: {times: 2, child: {run_once: {child: {act: {script: RS|F}}}}}",
        """
        tick | repeat, run_once, child
        1    | R R R
        2    | R S S
        3    | S S S   # the child is not started again, or it would fail
        """,
    ),
    "wait": (
        "wait: 2",
        """
        tick | wait
        1    | R
        2    | R
        3    | S
        """,
    ),
}


@pytest.mark.parametrize("name", TABLES)
def test_tick_table(name: str, tmp_path: Path) -> None:
    tree, table = TABLES[name]
    expected = rows(table)[1:]
    assert Stage(tmp_path, tree).table(len(expected)) == expected


DECORATORS = {
    "inverter": "inverter: {child: {act: {script: RF}}}",
    "force_success": "force_success: {child: {act: {script: RF}}}",
    "force_failure": "inverter: {child: {force_failure: {child: {act: {script: RS}}}}}",
    "retry": "retry: {times: 2, delay: 1, child: {act: {script: RS}}}",
    "repeat": "repeat: {times: 2, child: {act: {script: RS}}}",
    "timeout": "timeout: {seconds: 2, child: {act: {script: RS}}}",
    "delay": "delay: {seconds: 1, child: {act: {script: RS}}}",
    "rate": "rate: {hz: 1, child: {act: {script: RS}}}",
    "on_halt": "on_halt: {child: {act: {script: RS}}, cleanup: {act: {script: S}}}",
}


@pytest.mark.parametrize("name", [*DECORATORS])
def test_halt_stops_all_nodes_and_the_next_start_is_fresh(name: str, tmp_path: Path) -> None:
    stage = Stage(tmp_path, DECORATORS[name])
    first = stage.tick()
    assert first.startswith("R")
    stage.tree.halt()
    assert set(stage.letters.split()) == {"-"}
    stage.now += 100.0
    assert stage.tick() == first


@pytest.mark.parametrize("name", [*DECORATORS])
def test_start_after_an_end_is_fresh(name: str, tmp_path: Path) -> None:
    """Counters and clocks are reset: the second round takes as long as the first."""
    stage = Stage(tmp_path, f"repeat:\n  times: 2\n  child: {{{DECORATORS[name]}}}")
    table: list[str] = []
    while not table or table[-1].startswith("R"):
        table.append(stage.tick())
    half = len(table) // 2
    assert len(table) == 2 * half
    ends = [row.split()[1] for row in table]
    assert ends[:half] == ends[half:]
    assert table[-1].startswith("S")


def test_halted_run_once_runs_again(tmp_path: Path) -> None:
    stage = Stage(tmp_path, "run_once: {child: {act: {script: RS}}}")
    stage.tick()
    stage.tree.halt()
    assert stage.table(2) == ["R R", "S S"]


CLEANUP = "cleanup: {act: {script: S, name: tidy}}"


def test_cleanup_of_on_halt_runs_after_the_child_is_halted(tmp_path: Path) -> None:
    stage = Stage(
        tmp_path,
        f"sequence: [{{on_halt: {{child: {{act: {{script: R}}}}, {CLEANUP}}}}}]",
    )
    stage.tick()
    stage.events.clear()
    stage.tree.halt()
    assert [(e.path.rpartition("/")[2], e.new) for e in stage.events] == [
        ("act", "INVALID"),
        ("tidy", "SUCCESS"),
        ("tidy", "INVALID"),
        ("on_halt", "INVALID"),
        ("sequence", "INVALID"),
    ]


def test_cleanup_of_on_halt_runs_only_if_its_child_was_running(tmp_path: Path) -> None:
    stage = Stage(
        tmp_path,
        f"sequence: [{{on_halt: {{child: {{act: {{script: S}}}}, {CLEANUP}}}}},"
        " {act: {script: R}}]",
    )
    stage.tick()
    stage.tree.halt()
    assert not [e for e in stage.events if e.path.endswith("tidy")]


def test_cleanup_that_needs_more_than_one_tick_is_cut_short(tmp_path: Path) -> None:
    stage = Stage(tmp_path, "on_halt: {child: {act: {script: R}}, cleanup: {act: {script: RRR}}}")
    stage.tick()
    stage.tree.halt()
    assert stage.letters == "- - -"


def test_timeout_is_the_reason_of_the_failure(tmp_path: Path) -> None:
    stage = Stage(tmp_path, "timeout: {seconds: 1, child: {act: {script: RRRR}}}")
    stage.table(2)
    assert stage.tree.view().reason == "TIMEOUT: not finished within 1 s"


def test_deadlines_tolerate_the_rounding_of_summed_steps(tmp_path: Path) -> None:
    """0.1 s added ten times is less than 1 s in binary; the wait must not take one more tick."""
    stage = Stage(tmp_path, "wait: 1")
    letters = [stage.tick(0.1) for _ in range(11)]
    assert letters == ["R"] * 10 + ["S"]


def test_rate_keeps_its_phase_when_ticks_are_late(tmp_path: Path) -> None:
    """Due at 0, 1, 2 and 3, the child is ticked at 0, 1.3, 2 and 3.1."""
    stage = Stage(tmp_path, "rate: {hz: 1, child: {act: {script: RRRS}}}")
    letters = []
    for time in (0.0, 0.9, 1.3, 2.0, 2.9, 3.1):
        stage.now = time
        letters.append(stage.tick(0.0))
    assert letters == ["R R"] * 5 + ["S S"]


@pytest.mark.parametrize("times", range(2, 6))
@pytest.mark.parametrize(
    "child", ["fail", "sequence: [succeed, fail]", "timeout: {seconds: 9, child: fail}"]
)
@pytest.mark.parametrize("delay", [0, 1.5])
def test_every_failed_attempt_of_a_retry_is_reported(
    times: int, child: str, delay: float, tmp_path: Path
) -> None:
    """This includes successive attempts that fail in their first ticks."""
    node = child if child == "fail" else f"{{{child}}}"
    stage = Stage(tmp_path, f"retry: {{times: {times}, delay: {delay}, child: {node}}}")
    while stage.tree.status in ("INVALID", "RUNNING"):
        stage.tick()
    failures = [e for e in stage.events if e.kind == "fail" and e.new == "FAILURE"]
    assert len(failures) == len(stage.tree.leaves) // (2 if "sequence" in child else 1) == times
    for before, after in itertools.pairwise(e for e in stage.events if e.kind == "fail"):
        assert before.new == after.old, "status changes of a node follow each other"
