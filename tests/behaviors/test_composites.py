"""Tick tables: one row per tick, one letter per node, parents before children.

S success, F failure, R running, - invalid. Time passes by one second a tick.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.behaviors.ticking import Stage, rows

TABLES = {
    "sequence: one after the other": (
        "sequence: [{act: {script: RS}}, {act: {script: S}}, {act: {script: RS}}]",
        """
        tick | sequence, its three children
        1    | R R - -
        2    | R S S R
        3    | S S S S
        """,
    ),
    "sequence: fails with the first failure": (
        "sequence: [{act: {script: S}}, {act: {script: F}}, {act: {script: S}}]",
        """
        tick | sequence, its three children
        1    | F S F -
        """,
    ),
    "sequence with memory does not ask again": (
        "sequence: [{act: {script: S|F}}, {act: {script: RRS}}]",
        """
        tick | sequence, its two children
        1    | R S R
        2    | R S R
        3    | S S S
        """,
    ),
    "reactive sequence asks again and halts what runs": (
        "sequence: {memory: false, children: [{act: {script: S|S|F}}, {act: {script: RRRR}}]}",
        """
        tick | sequence, condition, action
        1    | R S R
        2    | R S R
        3    | F F -
        """,
    ),
    "selector: one after the other": (
        "selector: [{act: {script: RF}}, {act: {script: F}}, {act: {script: RS}}]",
        """
        tick | selector, its three children
        1    | R R - -
        2    | R F F R
        3    | S - - S   # py_trees clears the children that it has passed
        """,
    ),
    "selector: fails when all fail": (
        "selector: [{act: {script: F}}, {act: {script: RF}}]",
        """
        tick | selector, its two children
        1    | R F R
        2    | F - F
        """,
    ),
    "reactive selector: a higher branch halts a lower one": (
        "selector: {memory: false, children: [{act: {script: F|F|RS}}, {act: {script: RRRRR}}]}",
        """
        tick | selector, higher, lower
        1    | R F R
        2    | R F R
        3    | R R -
        4    | S S -
        """,
    ),
    "parallel: all must succeed, ended children are not started again": (
        "parallel: [{act: {script: RS|F}}, {act: {script: S|F}}, {act: {script: RRS}}]",
        """
        tick | parallel, its three children
        1    | R R S R
        2    | R S S R
        3    | S S S S
        """,
    ),
    "parallel: any ends with the first success and halts the rest": (
        "parallel: {policy: any, children: [{act: {script: RRR}}, {act: {script: RS}}]}",
        """
        tick | parallel, its two children
        1    | R R R
        2    | S - S
        """,
    ),
    "parallel: a failure fails it, whatever the policy": (
        "parallel: {policy: any, children: [{act: {script: RRR}}, {act: {script: RF}}]}",
        """
        tick | parallel, its two children
        1    | R R R
        2    | F - F
        """,
    ),
    "parallel: a failure beats a success of the same tick": (
        "parallel: {policy: any, children: [{act: {script: S}}, {act: {script: F}}]}",
        """
        tick | parallel, its two children
        1    | F S F
        """,
    ),
    "parallel: two of three, a failure is carried": (
        "parallel: {policy: 2, on_failure: continue,"
        " children: [{act: {script: F}}, {act: {script: RS}}, {act: {script: RRS}}]}",
        """
        tick | parallel, its three children
        1    | R F R R
        2    | R F S R
        3    | S F S S
        """,
    ),
    "parallel: two of three, fails once that is out of reach": (
        "parallel: {policy: 2, on_failure: continue,"
        " children: [{act: {script: F}}, {act: {script: RF}}, {act: {script: RRS}}]}",
        """
        tick | parallel, its three children
        1    | R F R R
        2    | F F F -
        """,
    ),
    "if: then": (
        "if: {condition: {act: {script: RS}}, then: {act: {script: RS}}, else: {act: {script: F}}}",
        """
        tick | if, condition, then, else
        1    | R R - -
        2    | R S R -
        3    | S S S -
        """,
    ),
    "if: else": (
        "if: {condition: {act: {script: F}}, then: {act: {script: S}}, else: {act: {script: RF}}}",
        """
        tick | if, condition, then, else
        1    | R F - R
        2    | F F - F
        """,
    ),
    "if: without else there is nothing to do": (
        "if: {condition: {act: {script: F}}, then: {act: {script: S}}}",
        """
        tick | if, condition, then
        1    | S F -
        """,
    ),
    "while: as long as the condition holds": (
        "while: {condition: {act: {script: S|S|F}}, child: {act: {script: RS}}}",
        """
        tick | while, condition, child
        1    | R S R
        2    | R S S   # the condition is not ticked while the child runs
        3    | R S R
        4    | R S S
        5    | S F S
        """,
    ),
    "while: ends when the child fails": (
        "while: {condition: {act: {script: S}}, child: {act: {script: S|F}}}",
        """
        tick | while, condition, child
        1    | R S S
        2    | F S F
        """,
    ),
    "while: waits for its condition": (
        "while: {condition: {act: {script: RF}}, child: {act: {script: S}}}",
        """
        tick | while, condition, child
        1    | R R -
        2    | S F -
        """,
    ),
    "guard: halts the child once the condition fails": (
        "guard: {condition: {act: {script: S|S|F}}, child: {act: {script: RRRR}}}",
        """
        tick | guard, condition, child
        1    | R S R
        2    | R S R
        3    | F F -
        """,
    ),
    "guard: a slow condition keeps the child from starting, not from going on": (
        "guard: {condition: {act: {script: RS|RS}}, child: {act: {script: RRS}}}",
        """
        tick | guard, condition, child
        1    | R R -
        2    | R S R
        3    | R R R
        4    | S S S
        """,
    ),
    "guard: a condition still at it is halted at the end": (
        "guard: {condition: {act: {script: S|RRRR}}, child: {act: {script: RS}}}",
        """
        tick | guard, condition, child
        1    | R S R
        2    | S - S
        """,
    ),
    "only_if: the condition is asked once": (
        "act: {script: RRS, only_if: {act: {script: RS|F}}}",
        """
        tick | only_if, condition, act
        1    | R R -
        2    | R S R
        3    | R S R
        4    | S S S
        """,
    ),
    "only_if: fails without its child": (
        "act: {script: S, only_if: {act: {script: F}}}",
        """
        tick | only_if, condition, act
        1    | F F -
        """,
    ),
    "skip_if: succeeds without its child": (
        "act: {script: F, skip_if: {act: {script: RS}}}",
        """
        tick | skip_if, condition, act
        1    | R R -
        2    | S S -
        """,
    ),
    "skip_if: the condition is asked once": (
        "act: {script: RF, skip_if: {act: {script: F|S}}}",
        """
        tick | skip_if, condition, act
        1    | R F R
        2    | F F F
        """,
    ),
    "until: halts its child once the condition holds": (
        "act: {script: RRRR, until: {act: {script: F|F|S}}}",
        """
        tick | until, condition, act
        1    | R F R
        2    | R F R
        3    | S S -
        """,
    ),
    "until: nothing to do if the condition holds": (
        "act: {script: RRRR, until: {act: {script: S}}}",
        """
        tick | until, condition, act
        1    | S S -
        """,
    ),
    "until: the condition is asked once more after the child": (
        "act: {script: RS, until: {act: {script: F|F|S}}}",
        """
        tick | until, condition, act
        1    | R F R
        2    | S S S
        """,
    ),
    "until: the child has ended, and the condition does not hold": (
        "act: {script: RS, until: {act: {script: F|F|F}}}",
        """
        tick | until, condition, act
        1    | R F R
        2    | F F S
        """,
    ),
    "until: fails with its child": (
        "act: {script: RF, until: {act: {script: F}}}",
        """
        tick | until, condition, act
        1    | R F R
        2    | F F F
        """,
    ),
    "until: a slow condition keeps the child from starting, not from going on": (
        "act: {script: RS, until: {act: {script: RF|RRS}}}",
        """
        tick | until, condition, act
        1    | R R -
        2    | R F R
        3    | R R S   # its end waits for the condition
        4    | R R S
        5    | S S S
        """,
    ),
    "conditions around a node: skip_if first, until last": (
        "act: {script: RR, until: {act: {script: F|S}}, only_if: {act: {script: S}},"
        " skip_if: {act: {script: F}}}",
        """
        tick | skip_if, condition, only_if, condition, until, condition, act
        1    | R F R S R F R
        2    | S F S S S S -
        """,
    ),
    "switch: the case that equals the value": (
        "sequence:\n"
        "- set: {key: color, value: red}\n"
        '- switch: {value: "{color}", cases:'
        " {blue: {act: {script: F}}, red: {act: {script: RS}}}, default: {act: {script: F}}}",
        """
        tick | sequence, set, switch, blue, red, default
        1    | R S R - R -
        2    | S S S - S -
        """,
    ),
    "switch: the default": (
        "switch: {value: 3, cases: {blue: {act: {script: F}}}, default: {act: {script: S}}}",
        """
        tick | switch, blue, default
        1    | S - S
        """,
    ),
    "switch: no case": (
        "switch: {value: true, cases: {blue: {act: {script: S}}}}",
        """
        tick | switch, blue
        1    | F -
        """,
    ),
    "switch: a truth value": (
        'switch: {value: true, cases: {"true": {act: {script: S}}}}',
        """
        tick | switch, true
        1    | S S
        """,
    ),
}


@pytest.mark.parametrize("name", TABLES)
def test_tick_table(name: str, tmp_path: Path) -> None:
    tree, table = TABLES[name]
    expected = rows(table)[1:]
    assert Stage(tmp_path, tree).table(len(expected)) == expected


COMPOSITES = {
    "sequence": "sequence: [{act: {script: S}}, {act: {script: RS}}]",
    "reactive sequence": (
        "sequence: {memory: false, children: [{act: {script: S}}, {act: {script: RS}}]}"
    ),
    "selector": "selector: [{act: {script: F}}, {act: {script: RS}}]",
    "reactive selector": (
        "selector: {memory: false, children: [{act: {script: F}}, {act: {script: RS}}]}"
    ),
    "reactive_sequence": "reactive_sequence: [{act: {script: S}}, {act: {script: RS}}]",
    "reactive_fallback": "reactive_fallback: [{act: {script: F}}, {act: {script: RS}}]",
    "if_then_else": "if_then_else: [{act: {script: S}}, {act: {script: RS}}]",
    "for_each": "for_each: {items: [1], item: n, child: {act: {script: RS}}}",
    "parallel": "parallel: [{act: {script: S}}, {act: {script: RS}}]",
    "switch": "switch: {value: 1, cases: {'1': {act: {script: RS}}}}",
    "if": "if: {condition: {act: {script: S}}, then: {act: {script: RS}}}",
    "while": "while: {condition: {act: {script: S|F}}, child: {act: {script: RS}}}",
    "guard": "guard: {condition: {act: {script: S}}, child: {act: {script: RS}}}",
    "only_if": "only_if: {condition: {act: {script: S}}, child: {act: {script: RS}}}",
    "skip_if": "skip_if: {condition: {act: {script: F}}, child: {act: {script: RS}}}",
    "until": "until: {condition: {act: {script: F|F|S|F|F|S}}, child: {act: {script: RS}}}",
}


@pytest.mark.parametrize("name", COMPOSITES)
def test_halt_stops_all_nodes_and_the_next_start_is_fresh(name: str, tmp_path: Path) -> None:
    """A halt makes all nodes INVALID; the next ticks are those of a new tree."""
    stage = Stage(tmp_path, COMPOSITES[name].replace("S|F", "S"))
    first = stage.tick()
    assert first.startswith("R")
    stage.tree.halt()
    assert set(stage.letters.split()) == {"-"}
    assert stage.tick() == first


@pytest.mark.parametrize("name", COMPOSITES)
def test_start_after_an_end_is_fresh(name: str, tmp_path: Path) -> None:
    """Inside a repeat, the second round ticks like the first, apart from the repeat itself."""
    tree = f"repeat:\n  times: 2\n  child: {{{COMPOSITES[name]}}}"
    if name == "while":
        tree = tree.replace("S|F", "S|F|S|F")
    stage = Stage(tmp_path, tree)
    table: list[str] = []
    while not table or table[-1].startswith("R"):
        table.append(stage.tick())
    half = len(table) // 2
    assert [row[1:] for row in table[:half]] == [row[1:] for row in table[half:]]
    assert table[-1].startswith("S")


def test_halt_is_reported_for_each_running_node(tmp_path: Path) -> None:
    """RUNNING to INVALID is an event like any other, children before parents."""
    stage = Stage(tmp_path, "sequence: [{parallel: [{act: {script: R}}, {act: {script: R}}]}]")
    stage.tick()
    stage.events.clear()
    stage.tree.halt()
    reported = [(e.path, e.old, e.new, e.code) for e in stage.events]
    assert reported == [
        ("sequence/parallel/act", "RUNNING", "INVALID", "HALTED"),
        ("sequence/parallel/act#2", "RUNNING", "INVALID", "HALTED"),
        ("sequence/parallel", "RUNNING", "INVALID", ""),
        ("sequence", "RUNNING", "INVALID", ""),
    ]


def test_view_distinguishes_halted_nodes_from_reset_ones(tmp_path: Path) -> None:
    """Halted, reset and never started nodes are all INVALID; a new start clears the mark."""
    stage = Stage(
        tmp_path, "sequence: [{act: {script: S}}, {act: {script: RS}}, {act: {script: S}}]"
    )
    stage.tick()
    stage.tree.halt()
    view = stage.tree.view()
    assert view.halted
    assert [child.halted for child in view.children] == [False, True, False]
    stage.tick()
    stage.tick()
    assert not any(node.halted for node in (stage.tree.view(), *stage.tree.view().children))


def test_failed_parallel_names_the_child(tmp_path: Path) -> None:
    stage = Stage(tmp_path, "parallel: [{act: {script: R}}, {act: {script: F, name: left}}]")
    stage.tick()
    assert stage.tree.view().reason == "CHILD_FAILED: 'left' failed"


def test_composite_whose_key_has_no_value_fails_with_the_reason(tmp_path: Path) -> None:
    """The key is written in a branch that may not run, so the static check cannot refuse it."""
    stage = Stage(
        tmp_path,
        "sequence:\n"
        "- selector: [succeed, {set: {key: n, value: 3}}]\n"
        "- retry: {times: '{n}', child: succeed}",
    )
    stage.tick()
    assert stage.tree.view().children[1].reason == "NO_VALUE: no node has written 'n' yet"
