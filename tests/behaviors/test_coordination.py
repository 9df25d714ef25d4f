"""Tick tables of trees that coordinate: a value that one arm writes is seen one tick later.

S success, F failure, R running, - invalid. Time passes by one second a tick; ``|`` separates arms.
The tables of signals, rendezvous and claims are checked in every order of the arms.
"""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import pytest

from bt_dualarm.spec.problems import SpecError
from tests.behaviors.ticking import Cells

SIGNAL = "signals: {ready: {type: boolean, written_by: [arm1]}}"
COUNT = "signals: {count: {type: integer, written_by: [arm1], initial: 0}}"
MEETING = "rendezvous: {there: [arm1, arm2]}"
OF_THREE = "rendezvous: {there: [arm1, arm2, arm3]}"
BIN = "zones: {bin: {size: [0.2, 0.2, 0.2]}}"
TWO_ZONES = "zones: {a: {size: [0.2, 0.2, 0.2]}, b: {shape: cylinder, size: [0.1, 0.2]}}"

TABLES = {
    "a value is seen one tick after it was written": (
        SIGNAL,
        {
            "arm1": "sequence: [{act: {script: RS}}, signal: ready, {act: {script: RRS}}]",
            "arm2": "await: ready",
        },
        ["R R - - | R", "R S S R | R", "R S S R | S"],
    ),
    "an initial value is there from the start": (
        "signals: {ready: {type: boolean, written_by: [arm1], initial: true}}",
        {"arm1": "signal: ready", "arm2": "await: ready"},
        ["S | S"],
    ),
    "a comparison": (
        COUNT,
        {
            "arm1": "sequence: [{signal: {signal: count, value: 1}}, {act: {script: RS}}, "
            "{signal: {signal: count, value: 2}}]",
            "arm2": "await: {signal: count, relation: greater, to: 1}",
        },
        ["R S R - | R", "S S S S | R", "S S S S | S"],
    ),
    "every value once, those between the ticks too": (
        COUNT,
        {
            "arm1": "sequence: [{signal: {signal: count, value: 1}}, "
            "{signal: {signal: count, value: 2}}, {signal: {signal: count, value: 3}}]",
            "arm2": "sequence:\n"
            "- await: {signal: count, values: every, relation: any, value: '{one}'}\n"
            "- await: {signal: count, values: every, relation: any, value: '{two}'}\n"
            "- compare: {value: '{one}', to: 1}\n"
            "- compare: {value: '{two}', to: 2}",
        },
        ["S S S S | R R - - -", "S S S S | S S S S S"],
    ),
    "a timeout": (
        SIGNAL,
        {
            "arm1": "sequence: [{act: {script: RRRRS}}, signal: ready]",
            "arm2": "await: {signal: ready, timeout: 2}",
        },
        ["R R - | R", "R R - | R", "R R - | F"],
    ),
    "a timeout is not waited for once the only writer has ended": (
        SIGNAL,
        {
            "arm1": "sequence: [{act: {script: RF}}, signal: ready]",
            "arm2": "await: {signal: ready, timeout: 60}",
        },
        ["R R - | R", "F F - | R", "F F - | F"],
    ),
    "what it wrote last is looked at before": (
        COUNT,
        {
            "arm1": "signal: {signal: count, value: 1}",
            "arm2": "await: {signal: count, to: 1, timeout: 60}",
            "arm3": "await: {signal: count, to: 2, timeout: 60}",
        },
        ["S | R | R", "S | S | R", "S | S | F"],
    ),
    "a meeting takes place in the tick after the last arrival": (
        MEETING,
        {
            "arm1": "sequence: [{act: {script: RRS}}, meet: there]",
            "arm2": "sequence: [meet: there, {act: {script: S}}]",
        },
        ["R R - | R R -", "R R - | R R -", "R S R | R R -", "S S S | S S S"],
    ),
    "three arms meet": (
        OF_THREE,
        {
            "arm1": "meet: there",
            "arm2": "sequence: [{act: {script: RS}}, meet: there]",
            "arm3": "sequence: [{act: {script: RRS}}, meet: there]",
        },
        ["R | R R - | R R -", "R | R S R | R R -", "R | R S R | R S R", "S | S S S | S S S"],
    ),
    "a participant that fails on its way": (
        MEETING,
        {
            "arm1": "sequence: [{act: {script: RF}}, meet: there]",
            "arm2": "meet: there",
        },
        ["R R - | R", "F F - | R", "F F - | F"],
    ),
    "one that is halted while it waits": (
        OF_THREE,
        {
            "arm1": "timeout: {seconds: 1, child: {meet: there}}",
            "arm2": "meet: there",
            "arm3": "sequence: [{act: {script: RRRRS}}, meet: there]",
        },
        ["R R | R | R R -", "F - | R | R R -", "F - | F | R R -"],
    ),
    "one that is halted may come again": (
        MEETING,
        {
            "arm1": "retry: {times: 2, child: {sequence: [{meet: {at: there, timeout: 1}}]}}",
            "arm2": "sequence: [{act: {script: RRS}}, meet: there]",
        },
        ["R R R | R R -", "R F F | R R -", "R R R | R S R", "S S S | S S S"],
    ),
    "a claim is granted in the next tick, the second one after its release": (
        BIN,
        {
            "arm1": "claim: {zone: bin, child: {act: {script: RS}}}",
            "arm2": "claim: {zone: bin, child: {act: {script: S}}}",
        },
        ["R - | R -", "R R | R -", "S S | R -", "S S | S S"],
    ),
    "claims of different zones do not wait for each other": (
        TWO_ZONES,
        {
            "arm1": "claim: {zone: a, child: {act: {script: RS}}}",
            "arm2": "claim: {zone: b, child: {act: {script: S}}}",
        },
        ["R - | R -", "R R | S S"],
    ),
    "several at once": (
        TWO_ZONES,
        {
            "arm1": "claim: {zone: [b, a], child: {act: {script: RS}}}",
            "arm2": "claim: {zone: a, child: {act: {script: S}}}",
            "arm3": "claim: {zone: b, child: {act: {script: S}}}",
        },
        ["R - | R - | R -", "R R | R - | R -", "S S | R - | R -", "S S | S S | S S"],
    ),
    "nobody overtakes": (  # arm3 wants only b, which is free, but arm2 wants it, too, and was first
        TWO_ZONES,
        {
            "arm1": "claim: {zone: a, child: {act: {script: RRS}}}",
            "arm2": "sequence: [{act: {script: RS}}, {claim: {zone: [a, b], child: succeed}}]",
            "arm3": "sequence: [{act: {script: RRS}}, {claim: {zone: b, child: succeed}}]",
        },
        [
            "R - | R R - - | R R - -",
            "R R | R S R - | R R - -",
            "R R | R S R - | R S R -",
            "S S | R S R - | R S R -",
            "S S | S S S S | R S R -",
            "S S | S S S S | S S S S",
        ],
    ),
    "a claim is released by a halt": (
        BIN,
        {
            "arm1": "timeout: {seconds: 2, child: {claim: {zone: bin, "
            "child: {act: {script: RRRR}}}}}",
            "arm2": "claim: {zone: bin, child: succeed}",
        },
        ["R R - | R -", "R R R | R -", "F - - | R -", "F - - | S S"],
    ),
    "and by a failure": (
        BIN,
        {
            "arm1": "claim: {zone: bin, child: {act: {script: F}}}",
            "arm2": "claim: {zone: bin, child: succeed}",
        },
        ["R - | R -", "F F | R -", "F F | S S"],
    ),
    "a claim has a timeout": (
        BIN,
        {
            "arm1": "claim: {zone: bin, child: {act: {script: RRRRS}}}",
            "arm2": "claim: {zone: bin, timeout: 2, child: succeed}",
        },
        ["R - | R -", "R R | R -", "R R | F -"],
    ),
    "two arms in step begin and end together": (
        SIGNAL,
        {
            "arm1": "in_step: {with: arm2, child: {act: {script: RS}}}",
            "arm2": "in_step: {with: arm1, child: {act: {script: S}}}",
        },
        ["R - | R -", "R R | R S", "R S | R S", "S S | S S"],
    ),
    "both children end in the same tick": (
        SIGNAL,
        {
            "arm1": "in_step: {with: arm2, child: {act: {script: S}}}",
            "arm2": "in_step: {with: arm1, child: {act: {script: S}}}",
        },
        ["R - | R -", "R S | R S", "S S | S S"],
    ),
    "the first one in step waits for the other": (
        SIGNAL,
        {
            "arm1": "in_step: {with: arm2, child: {act: {script: S}}}",
            "arm2": "sequence: [{act: {script: RRS}}, "
            "{in_step: {with: arm1, child: {act: {script: S}}}}]",
        },
        ["R - | R R - -", "R - | R R - -", "R - | R S R -", "R S | R S R S", "S S | S S S S"],
    ),
    "a child in step that fails": (
        SIGNAL,
        {
            "arm1": "in_step: {with: arm2, child: {act: {script: F}}}",
            "arm2": "in_step: {with: arm1, child: {act: {script: RRR}}}",
        },
        ["R - | R -", "F F | R R", "F F | F -"],
    ),
    "one that has done its part hears that the other has failed": (
        SIGNAL,
        {
            "arm1": "in_step: {with: arm2, child: {act: {script: S}}}",
            "arm2": "in_step: {with: arm1, child: {act: {script: RF}}}",
        },
        ["R - | R -", "R S | R R", "R S | F F", "F S | F F"],
    ),
    "one that is halted in step": (
        SIGNAL,
        {
            "arm1": "timeout: {seconds: 2, child: {in_step: {with: arm2, "
            "child: {act: {script: RRRR}}}}}",
            "arm2": "in_step: {with: arm1, child: {act: {script: RRRR}}}",
        },
        ["R R - | R -", "R R R | R R", "F - - | R R", "F - - | F -"],
    ),
    "an arm that does not come in time": (
        SIGNAL,
        {
            "arm1": "in_step: {with: arm2, timeout: 1, child: succeed}",
            "arm2": "sequence: [{act: {script: RRRS}}, {in_step: {with: arm1, child: succeed}}]",
        },
        ["R - | R R - -", "F - | R R - -", "F - | R R - -", "F - | R S R -", "F - | F S F -"],
    ),
    "both try again": (
        SIGNAL,
        {
            "arm1": "retry: {times: 2, child: {in_step: {with: arm2, "
            "child: {act: {script: F|S}}}}}",
            "arm2": "retry: {times: 2, child: {in_step: {with: arm1, "
            "child: {act: {name: other, script: R|S}}}}}",
        },
        [
            "R R - | R R -",
            "R F F | R R R",
            "R R - | R F -",
            "R R - | R R -",
            "R R S | R R S",
            "S S S | S S S",
        ],
    ),
}
ORDERS = [
    pytest.param(name, order, id=f"{name}-{'-'.join(order)}")
    for name, (_, trees, _) in TABLES.items()
    for order in permutations(trees)
]


@pytest.mark.parametrize(("name", "order"), ORDERS)
def test_tick_table_holds_in_every_order_of_the_arms(
    name: str, order: tuple[str, ...], tmp_path: Path
) -> None:
    cell, trees, table = TABLES[name]
    cells = Cells(tmp_path, cell, {arm: trees[arm] for arm in order})
    for expected in table:
        letters = dict(zip(order, cells.tick().split(" | "), strict=True))
        assert " | ".join(letters[arm] for arm in trees) == expected


def test_waiting_arms_fail_with_the_partner_that_is_gone_and_the_reason(tmp_path: Path) -> None:
    cells = Cells(
        tmp_path,
        OF_THREE,
        {
            "arm1": "sequence: [{act: {script: RF}}, meet: there]",
            "arm2": "meet: there",
            "arm3": "meet: there",
        },
    )
    cells.table(3)
    why = "arm1 has ended with FAILURE at 1.00 s; 'there' had been waited for 1.00 s"
    assert cells.failures()[1:] == [("arm2", "PARTNER_GONE", why), ("arm3", "PARTNER_GONE", why)]


@pytest.mark.parametrize(
    "waits",
    [
        "await: ready",
        "await: {signal: ready, timeout: 60}",
        "timeout: {seconds: 60, child: {await: ready}}",
    ],
)
def test_signal_whose_writer_has_ended_is_not_awaited(waits: str, tmp_path: Path) -> None:
    """The wait fails at once and names the writer and its end, whatever its timeout."""
    cells = Cells(
        tmp_path, SIGNAL, {"arm1": "sequence: [{act: {script: RF}}, signal: ready]", "arm2": waits}
    )
    cells.table(3)
    (failure,) = [one for one in cells.failures() if one[0] == "arm2"]
    assert failure[1] == "PARTNER_GONE"
    assert "arm1 has ended with FAILURE at 1.00 s" in failure[2]


def test_last_value_of_a_writer_that_has_ended_counts(tmp_path: Path) -> None:
    cells = Cells(
        tmp_path,
        SIGNAL,
        {
            "arm1": "sequence: [{act: {script: RS}}, signal: ready]",
            "arm2": "await: {signal: ready, timeout: 60}",
        },
    )
    assert cells.table(3)[-1].endswith("| S")
    assert cells.failures() == []


def test_removed_arm_ends_waits_for_it_and_releases_its_claims(tmp_path: Path) -> None:
    cells = Cells(
        tmp_path,
        f"{MEETING}\n{BIN}",
        {
            "arm1": "claim: {zone: bin, child: {sequence: [{act: {script: RRRR}}, meet: there]}}",
            "arm2": "selector: [meet: there, {claim: {zone: bin, child: succeed}}]",
        },
    )
    assert cells.table(2)[-1] == "R R R - | R R - -"
    cells.remove("arm1")
    assert cells.table(3) == ["R R - -", "R F R -", "S - S S"]
    assert cells.failures() == [
        ("arm2", "PARTNER_GONE", "arm1 was removed at 2.00 s; 'there' had been waited for 2.00 s")
    ]


def test_arm_in_step_fails_when_its_partner_is_removed(tmp_path: Path) -> None:
    cells = Cells(
        tmp_path,
        SIGNAL,
        {
            "arm1": "in_step: {with: arm2, child: {act: {script: RRRR}}}",
            "arm2": "in_step: {with: arm1, child: {act: {script: RRRR}}}",
        },
    )
    assert cells.table(2) == ["R - | R -", "R R | R R"]
    cells.remove("arm2")
    assert cells.table(2) == ["R R", "F -"]
    assert cells.failures() == [("arm1", "PARTNER_GONE", "arm2 was removed at 2.00 s")]


def test_arm_does_not_wait_for_a_partner_in_step_that_has_ended(tmp_path: Path) -> None:
    cells = Cells(
        tmp_path,
        SIGNAL,
        {
            "arm1": "in_step: {with: arm2, child: succeed}",
            "arm2": "sequence: [{act: {script: RF}}, {in_step: {with: arm1, child: succeed}}]",
        },
    )
    cells.table(3)
    (failure,) = [one for one in cells.failures() if one[0] == "arm1"]
    assert failure[1] == "PARTNER_GONE"
    assert "arm2 has ended with FAILURE at 1.00 s" in failure[2]


def test_arm_that_is_spawned_again_can_be_met(tmp_path: Path) -> None:
    cells = Cells(
        tmp_path,
        MEETING,
        {"arm1": "meet: there", "arm2": "retry: {times: 5, child: {meet: there}}"},
    )
    cells.remove("arm1")
    assert cells.table(3) == ["R R", "R F", "R R"]
    cells.spawn("arm1")
    assert cells.tick() == "R F | R"  # it was still gone when arm2 came
    assert cells.table(2) == ["R R | R", "S S | S"]


# A selector hides the node from the static check, so that the deadlock is found at run time.
HIDDEN = "selector: [{act: {script: F}}, %s]"
REFUSED = {
    "two meetings in another order": (
        "rendezvous: {one: [arm1, arm2], two: [arm1, arm2]}",
        {
            "arm1": "sequence: [meet: one, meet: two]",
            "arm2": "sequence: [meet: two, meet: one]",
        },
        "arm1 waits for the meeting 'one'",
    ),
    "a meeting too many": (
        MEETING,
        {"arm1": "sequence: [meet: there, meet: there]", "arm2": "meet: there"},
        "of arm2, whose tree is over by then",
    ),
    "signals that wait for each other": (
        "signals: {one: {type: boolean, written_by: [arm1]}, two: {type: boolean, "
        "written_by: [arm2]}}",
        {
            "arm1": "sequence: [await: two, signal: one]",
            "arm2": "sequence: [await: one, signal: two]",
        },
        "arm1 waits for the signal 'two'",
    ),
    "a ring of three": (
        "rendezvous: {one: [arm1, arm2], two: [arm2, arm3], three: [arm3, arm1]}",
        {
            "arm1": "sequence: [meet: one, meet: three]",
            "arm2": "sequence: [meet: two, meet: one]",
            "arm3": "sequence: [meet: three, meet: two]",
        },
        "arm3 waits for the meeting 'three'",
    ),
    "a meeting within claims of the same": (
        f"{MEETING}\n{BIN}",
        {
            "arm1": "claim: {zone: bin, child: {meet: there}}",
            "arm2": "claim: {zone: bin, child: {meet: there}}",
        },
        "arm1 and arm2 both hold zone bin when meeting at 'there'",
    ),
    "a claim of what the arm has claimed": (
        BIN,
        {
            "arm1": "claim: {zone: bin, child: {claim: {zone: bin, child: succeed}}}",
            "arm2": "succeed",
        },
        "arm1 waits here for 'zone bin', which it has claimed",
    ),
    "a step with an arm that has none": (
        SIGNAL,
        {"arm1": "in_step: {with: arm2, child: succeed}", "arm2": "succeed"},
        "arm2 never goes in step with arm1",
    ),
    "a step with itself": (
        SIGNAL,
        {"arm1": "in_step: {with: arm1, child: succeed}", "arm2": "succeed"},
        "arm1 cannot go in step with itself",
    ),
    "a step too many": (
        SIGNAL,
        {
            "arm1": "sequence: [{in_step: {with: arm2, child: succeed}}, "
            "{in_step: {with: arm2, child: succeed}}]",
            "arm2": "in_step: {with: arm1, child: succeed}",
        },
        "arm1 waits for the step with arm2",
    ),
    "a step that waits for what follows the other one": (
        SIGNAL,
        {
            "arm1": "sequence: [{in_step: {with: arm2, child: succeed}}, signal: ready]",
            "arm2": "in_step: {with: arm1, child: {await: ready}}",
        },
        "arm1 waits for the step with arm2",
    ),
    "nobody comes": (
        MEETING,
        {"arm1": "meet: there", "arm2": "succeed"},
        "arm2 never reaches 'there'",
    ),
    "nobody writes": (
        SIGNAL,
        {"arm1": "succeed", "arm2": "await: ready"},
        "no tree writes 'ready'",
    ),
    "another writer": (
        SIGNAL,
        {"arm1": "signal: ready", "arm2": "signal: ready"},
        "'ready' is not written by arm2",
    ),
    "another type": (
        COUNT,
        {"arm1": "signal: {signal: count, value: high}", "arm2": "await: {signal: count, to: 1}"},
        "signal: value: ",
    ),
    "no participant": (
        MEETING,
        {"arm1": "meet: there", "arm2": "meet: there", "arm3": "meet: there"},
        "arm3 is not a participant of 'there'",
    ),
    "nothing": (BIN, {"arm1": "claim: {child: succeed}", "arm2": "succeed"}, "claims nothing"),
    "an unknown zone": (
        BIN,
        {"arm1": "claim: {zone: [bin, bon], child: succeed}", "arm2": "succeed"},
        "there is no zone 'bon'",
    ),
    "an unknown arm": (
        "rendezvous: {there: [arm1, arm9]}",
        {"arm1": "meet: there", "arm2": "succeed"},
        "there is no arm 'arm9'",
    ),
    "an initial value of another type": (
        "signals: {ready: {type: boolean, written_by: [arm1], initial: 3}}",
        {"arm1": "signal: ready", "arm2": "await: ready"},
        "initial: expected true or false, not 3",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_mistake_that_the_file_shows_is_refused_before_the_run(name: str, tmp_path: Path) -> None:
    cell, trees, message = REFUSED[name]
    with pytest.raises(SpecError) as error:
        Cells(tmp_path, cell, trees)
    assert message in str(error.value)


@pytest.mark.parametrize("order", list(permutations(("arm1", "arm2"))))
def test_meetings_in_branches_that_cross_are_a_deadlock(
    order: tuple[str, ...], tmp_path: Path
) -> None:
    """Only the run shows which branch is taken. One arm yields, and the other is notified."""
    trees = {
        "arm1": f"sequence: [{HIDDEN % '{meet: one}'}, meet: two]",
        "arm2": f"sequence: [{HIDDEN % '{meet: two}'}, meet: one]",
    }
    cell = "rendezvous: {one: [arm1, arm2], two: [arm1, arm2]}"
    cells = Cells(tmp_path, cell, {arm: trees[arm] for arm in order})
    cells.table(4)
    failures = [one for one in cells.failures() if one[1] != "SCRIPTED"]
    assert [(arm, code) for arm, code, _ in failures] == [
        ("arm2", "DEADLOCK"),
        ("arm1", "PARTNER_GONE"),
    ]
    assert failures[0][2] == (
        "these arms wait for each other indefinitely: arm1 waits at 'one' for arm2 since 0.00 s; "
        "arm2 waits at 'two' for arm1 since 0.00 s; arm2 yields, as it began to wait last"
    )


@pytest.mark.parametrize("order", list(permutations(("arm1", "arm2", "arm3"))))
def test_arm_that_yields_may_try_again(order: tuple[str, ...], tmp_path: Path) -> None:
    """Two arms claim a zone each and wait for a signal of the third before they go on."""
    trees = {
        "arm1": "claim: {zone: a, child: {sequence: [{await: go}, "
        "{claim: {zone: b, child: succeed}}]}}",
        "arm2": "retry: {times: 3, child: {claim: {zone: b, child: {sequence: [{await: go}, "
        "{meet: there}]}}}}",
        "arm3": "sequence: [{act: {script: RRS}}, signal: go, {claim: {zone: a, child: succeed}}, "
        "meet: there]",
    }
    cell = (
        f"{TWO_ZONES}\nsignals: {{go: {{type: boolean, written_by: [arm3]}}}}\n"
        "rendezvous: {there: [arm2, arm3]}"
    )
    cells = Cells(tmp_path, cell, {arm: trees[arm] for arm in order})
    for _ in range(12):
        cells.tick()
    assert {arm: tree.status for arm, tree in cells.trees.items()} == dict.fromkeys(
        sorted(trees), "SUCCESS"
    )
    assert [(arm, code) for arm, code, _ in cells.failures()][:1] == [("arm2", "DEADLOCK")]


def test_wait_with_a_timeout_is_no_deadlock(tmp_path: Path) -> None:
    trees = {
        "arm1": f"sequence: [{HIDDEN % '{meet: {at: one, timeout: 3}}'}, meet: two]",
        "arm2": f"sequence: [{HIDDEN % '{meet: two}'}, meet: one]",
    }
    cells = Cells(tmp_path, "rendezvous: {one: [arm1, arm2], two: [arm1, arm2]}", trees)
    cells.table(6)
    codes = [code for _, code, _ in cells.failures() if code != "SCRIPTED"]
    assert codes == ["TIMEOUT", "PARTNER_GONE"]


def test_view_shows_which_arm_a_node_waits_for(tmp_path: Path) -> None:
    trees = {"arm1": "sequence: [{act: {script: RRRS}}, meet: there]", "arm2": "meet: there"}
    cells = Cells(tmp_path, MEETING, trees)
    cells.tick()
    assert cells.trees["arm2"].view().waiting == "waits at 'there' for arm1 since 0.00 s"
    assert cells.trees["arm1"].view().waiting == ""
    cells.table(4)
    assert cells.trees["arm2"].view().waiting == ""


def test_claims_that_block_each_other_are_refused_before_the_run(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="can deadlock") as error:
        Cells(
            tmp_path,
            TWO_ZONES,
            {
                "arm1": "claim: {zone: a, child: {claim: {zone: b, child: succeed}}}",
                "arm2": "claim: {zone: b, child: {claim: {zone: a, child: succeed}}}",
            },
        )
    message = str(error.value)
    assert "arm1 holds zone a (" in message
    assert "and claims zone b (" in message
    assert "arm2 holds zone b (" in message


@pytest.mark.parametrize("leaf", ["meet: '{name}'", "await: '{name}'", "signal: '{name}'"])
def test_names_of_the_cell_cannot_come_from_the_blackboard(leaf: str, tmp_path: Path) -> None:
    tree = f"sequence: [{{set: {{key: name, value: there}}}}, {leaf}]"
    with pytest.raises(SpecError, match="cannot come from the blackboard"):
        Cells(tmp_path, MEETING, {"arm1": tree, "arm2": "meet: there"})
