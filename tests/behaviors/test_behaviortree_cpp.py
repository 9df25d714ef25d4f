"""Nodes named after BehaviorTree.CPP nodes tick as its documentation and sources specify.

Written by hand from https://www.behaviortree.dev/docs/nodes-library/SequenceNode and
…/FallbackNode, and from the sources of version 4: `controls/reactive_sequence.cpp`,
`controls/reactive_fallback.cpp`, `controls/if_then_else_node.h`, `decorators/loop_node.h`.

S success, F failure, R running, - idle. At the end of a tick, a reactive node of BehaviorTree.CPP
sets the children before the running one to idle; here they keep their result until they are ticked
again, which no child can distinguish from a new start.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.behaviors.ticking import Stage, rows
from tests.spec.writing import task, tree_of

TABLES = {
    # "ReactiveSequence: if a child returns FAILURE, the sequence returns FAILURE; RUNNING: the
    # children are ticked again from the first" (SequenceNode).
    "reactive_sequence: ticks from the first child, halts the running one on a failure": (
        "reactive_sequence: [{act: {script: S|S|F}}, {act: {script: RRRR}}]",
        """
        tick | reactive_sequence, condition, action
        1    | R S R
        2    | R S R
        3    | F F -
        """,
    ),
    "reactive_sequence: a condition that runs again halts what follows": (
        "reactive_sequence: [{act: {script: S|RS|S}}, {act: {script: RRR|RS}}]",
        """
        tick | reactive_sequence, condition, action
        1    | R S R
        2    | R R -   # haltChildren of all but the running one
        3    | R S R   # the action starts again
        4    | S S S
        """,
    ),
    "reactive_sequence: an action that has succeeded is started again": (
        "reactive_sequence: [{act: {script: S|S|S}}, {act: {script: S|S|F}}, {act: {script: RRR}}]",
        """
        tick | reactive_sequence, its three children
        1    | R S S R
        2    | R S S R
        3    | F S F -
        """,
    ),
    # "ReactiveFallback: if a child returns RUNNING, it is ticked again, with those before it; used
    # to interrupt an asynchronous child if one of the previous conditions changes to SUCCESS."
    "reactive_fallback: a condition that turns true interrupts the action": (
        "reactive_fallback: [{act: {script: F|F|S}}, {act: {script: RRRR}}]",
        """
        tick | reactive_fallback, condition, action
        1    | R F R
        2    | R F R
        3    | S S -
        """,
    ),
    "reactive_fallback: fails when all children fail": (
        "reactive_fallback: [{act: {script: F|F}}, {act: {script: RF}}]",
        """
        tick | reactive_fallback, its two children
        1    | R F R
        2    | F F F
        """,
    ),
    # "IfThenElse is not reactive": the condition is not ticked again.
    "if_then_else: the condition is ticked once": (
        "if_then_else: [{act: {script: RS|F}}, {act: {script: RRS}}, {act: {script: F}}]",
        """
        tick | if_then_else, condition, then, else
        1    | R R - -
        2    | R S R -
        3    | R S R -
        4    | S S S -
        """,
    ),
    "if_then_else: the third child": (
        "if_then_else: [{act: {script: F}}, {act: {script: S}}, {act: {script: RF}}]",
        """
        tick | if_then_else, condition, then, else
        1    | R F - R
        2    | F F - F
        """,
    ),
    # "If you have only 2 children, this node will return FAILURE when the statement is FAILURE."
    "if_then_else: fails without a third child": (
        "if_then_else: [{act: {script: F}}, {act: {script: S}}]",
        """
        tick | if_then_else, condition, then
        1    | F F -
        """,
    ),
    # LoopNode: one item a tick, a failure of the child ends it. There one more tick finds the queue
    # empty; here the node ends with its last item.
    "for_each: one item a tick": (
        "for_each: {items: [1, 2], item: n,"
        " child: {sequence: [{log: '{n}'}, {act: {script: RS}}]}}",
        """
        tick | for_each, sequence, log, act
        1    | R R S R
        2    | R S S S
        3    | R R S R
        4    | S S S S
        """,
    ),
    "for_each: fails with its child": (
        "for_each: {items: [1, 2, 3], item: n, child: {test: '{n} < 2'}}",
        """
        tick | for_each, test
        1    | R S
        2    | F F
        """,
    ),
    "for_each: nothing to do": (
        "for_each: {items: [], item: n, child: {act: {script: F}}}",
        """
        tick | for_each, act
        1    | S -
        """,
    ),
    "for_each: if_empty is FAILURE": (
        "for_each: {items: [], item: n, if_empty: fail, child: {act: {script: S}}}",
        """
        tick | for_each, act
        1    | F -
        """,
    ),
}


@pytest.mark.parametrize("name", TABLES)
def test_tick_table(name: str, tmp_path: Path) -> None:
    tree, table = TABLES[name]
    expected = rows(table)[1:]
    assert Stage(tmp_path, tree).table(len(expected)) == expected


def test_for_each_reads_its_list_at_the_start(tmp_path: Path) -> None:
    """The list comes from a key; writes of the child to that key do not change the loop."""
    stage = Stage(
        tmp_path,
        "sequence:\n"
        "- set: {key: found, value: [{xyz: [1, 2, 3]}, {xyz: [4, 5, 6]}]}\n"
        "- set: {key: sum, value: 0}\n"
        "- for_each:\n"
        "    items: '{found}'\n"
        "    item: pose\n"
        "    index: i\n"
        "    child:\n"
        "      sequence:\n"
        "      - set: {key: found, value: []}\n"
        "      - set: {key: sum, value: '{sum} + {pose}.z + 10 * {i}'}\n"
        "- test: '{sum} == 19 and {i} == 1'",
    )
    table = stage.table(2)
    assert (table[0][0], table[1][0]) == ("R", "S")


def test_for_each_in_a_subtree_has_its_own_keys(tmp_path: Path) -> None:
    before = (
        "subtrees: {each: {params: {to: {type: key}}, tree: {for_each: {items: [1, 2], item: to,"
        " index: i, child: {test: '{to} + {i} > 0'}}}}}\n"
    )
    tree = "sequence: [{subtree: {use: each, params: {to: '{last}'}}}, {test: '{last} == 2'}]"
    loop = next(n for n in tree_of(task(tmp_path, tree, before)).walk() if n.kind == "for_each")
    assert (loop.ports["item"], loop.ports["index"]) == ("last", "each#1/i")
