"""Joint actions: leaves of several arms meet, exchange messages, and leave.

In each step all trees are ticked, in any order, before the commit.
"""

from __future__ import annotations

import pytest

from bt_dualarm.skill.cell import ActiveNode, Appointment, CellState
from bt_dualarm.spec.cell import CellSpec

LABEL = "the handover of 'cube' from arm1 to arm2"
MEMBERS = ("arm1", "arm2")


class Waiting:
    """A tree with one running leaf."""

    def active(self) -> list[ActiveNode]:
        """The leaf."""
        return [ActiveNode("leaf", False)]


class Cell:
    """A cell with a clock that each step advances."""

    def __init__(self) -> None:
        self.time = 0.0
        self.state = CellState(CellSpec(), lambda: self.time)

    def step(self, *arms: str) -> None:
        """Commits what the trees did."""
        self.state.commit({name: Waiting() for name in arms or MEMBERS})
        self.time += 0.02


def joined(cell: Cell, arm: str, label: str = LABEL) -> Appointment:
    """The arm's part in the action, which it joins."""
    return cell.state.join(arm, "leaf", label, MEMBERS)


@pytest.mark.parametrize("order", [("arm1", "arm2"), ("arm2", "arm1")])
def test_members_meet_in_the_step_in_which_the_last_one_joins(order: tuple[str, str]) -> None:
    cell = Cell()
    first = joined(cell, order[0])
    cell.step()
    assert first.action is None
    assert cell.state.waited_for(first) == (order[1],)
    assert cell.state.waiting(order[0], "leaf") == f"waits for {order[1]} in {LABEL} since 0.00 s"
    second = joined(cell, order[1])
    assert first.action is None  # not before the end of the step
    cell.step()
    assert first.action is not None
    assert first.action is second.action
    assert cell.state.waits() == ()


def test_message_is_visible_in_the_next_step() -> None:
    cell = Cell()
    parts = {arm: joined(cell, arm) for arm in MEMBERS}
    cell.step()
    action = parts["arm1"].action
    assert action is not None
    action.send("arm1", {"arrived": True})
    assert action.messages("arm1") == {}
    cell.step()
    assert action.messages("arm1") == {"arrived": True}


def test_different_actions_do_not_meet() -> None:
    cell = Cell()
    one = joined(cell, "arm1")
    other = joined(cell, "arm2", "the handover of 'cube' from arm2 to arm1")
    cell.step()
    assert one.action is other.action is None
    # They wait for each other indefinitely: the one that came last fails, in the same step.
    failed = [part for part in (one, other) if part.failure is not None]
    assert [part.arm for part in failed] == ["arm2"]
    assert failed[0].failure is not None
    assert failed[0].failure.code == "DEADLOCK"


def test_member_that_leaves_is_reported_to_the_others() -> None:
    cell = Cell()
    parts = {arm: joined(cell, arm) for arm in MEMBERS}
    cell.step()
    action = parts["arm2"].action
    assert action is not None
    cell.state.part(parts["arm1"], "was halted in leaf")
    assert action.left == {}
    cell.step()
    assert action.left == {"arm1": "was halted in leaf"}


def test_removed_arm_is_reported_as_removed() -> None:
    cell = Cell()
    parts = {arm: joined(cell, arm) for arm in MEMBERS}
    cell.step()
    cell.state.part(parts["arm1"], "was halted in leaf")
    cell.state.arm_gone("arm1", "was removed at 0.02 s")
    cell.step("arm2")
    action = parts["arm2"].action
    assert action is not None
    assert action.left == {"arm1": "was removed at 0.02 s"}


def test_wait_for_a_tree_that_has_ended_fails() -> None:
    cell = Cell()
    part = joined(cell, "arm1")
    cell.state.arm_gone("arm2", "has ended with FAILURE at 0.00 s")
    cell.step("arm1")
    assert part.failure is not None
    assert part.failure.code == "PARTNER_GONE"
    assert "arm2 has ended with FAILURE at 0.00 s" in part.failure.reason


def test_wait_during_the_action_is_shown_and_can_deadlock() -> None:
    cell = Cell()
    parts = {arm: joined(cell, arm) for arm in MEMBERS}
    cell.step()
    cell.state.await_members(parts["arm1"], ["arm2"])
    cell.step()
    assert cell.state.waiting("arm1", "leaf").startswith("waits for arm2 in the handover")
    cell.state.await_members(parts["arm2"], ["arm1"])
    cell.step()
    assert parts["arm2"].failure is not None
    assert parts["arm2"].failure.code == "DEADLOCK"
    cell.state.await_members(parts["arm1"], ())
    assert cell.state.waiting("arm1", "leaf") == ""


def blocked_by_a_waiting_arm(asides: int) -> tuple[Cell, Appointment]:
    """A cell in which arm1 waits for arm2, whose motion arm1 blocks, and the part of arm1."""
    cell = Cell()
    waiting = joined(cell, "arm1")
    waiting.asides = asides
    cell.step()
    cell.state.traffic.block("arm2", "leaf", {"arm1"}, why="arm2/hand would touch arm1/hand")
    cell.step()
    return cell, waiting


def try_again(cell: Cell) -> None:
    """The blocked arm tries again and is blocked as before."""
    assert cell.state.traffic.is_called("arm2")
    cell.state.traffic.take_refusal("arm2")
    cell.state.traffic.block("arm2", "leaf", {"arm1"}, why="arm2/hand would touch arm1/hand")
    cell.step()


def test_waiting_arm_is_asked_to_move_aside_as_often_as_it_can() -> None:
    cell, waiting = blocked_by_a_waiting_arm(asides=2)
    for left in (1, 0):
        try_again(cell)
        assert (waiting.asked_by, waiting.asides) == ("arm2", left)
        cell.step()
        assert waiting.failure is None
        cell.state.made_room(waiting, moved=True)
        cell.step()
        assert waiting.asked_by == ""
    try_again(cell)
    refused = cell.state.traffic.take_refusal("arm2")
    assert refused is not None
    assert refused.code == "DEADLOCK"
    assert "arm2 cannot go on: arm2/hand would touch arm1/hand" in refused.reason
    assert "Let arm1 wait elsewhere" in refused.reason
    assert "or come there only when arm2 is done" in refused.reason  # it may hold a door open


def test_arm_that_cannot_move_aside_is_asked_once() -> None:
    cell, waiting = blocked_by_a_waiting_arm(asides=3)
    try_again(cell)
    assert waiting.asked_by == "arm2"
    cell.state.made_room(waiting, moved=False)
    cell.step()
    refused = cell.state.traffic.take_refusal("arm2")
    assert refused is not None
    assert refused.code == "DEADLOCK"


def missed(cell: Cell) -> None:
    """Lets arm1 miss the end of an action that both arms complete."""
    parts = {arm: joined(cell, arm) for arm in MEMBERS}
    cell.step()
    action = parts["arm1"].action
    assert action is not None
    action.completed.add("arm1")
    cell.state.miss_end(parts["arm1"])
    cell.state.part(parts["arm1"], "was halted in leaf")
    cell.step()
    action.completed.add("arm2")
    cell.state.part(parts["arm2"], "has completed leaf")
    cell.step()


def test_arm_that_missed_the_end_of_an_action_does_not_wait_for_it_in_vain() -> None:
    """It was PARTNER_GONE, although nothing was left to be done."""
    cell = Cell()
    missed(cell)
    again = joined(cell, "arm1")
    cell.step()
    assert not again.is_completed  # the other one may begin another such action
    cell.state.arm_gone("arm2", "has ended with SUCCESS at 1.00 s")
    cell.step("arm1")
    assert again.is_completed
    assert again.failure is None
    cell.state.part(again, "has completed leaf")
    third = joined(cell, "arm1")
    cell.step("arm1")
    assert third.failure is not None
    assert third.failure.code == "PARTNER_GONE"


def test_arm_that_missed_the_end_of_an_action_resolves_a_deadlock() -> None:
    cell = Cell()
    missed(cell)
    again = joined(cell, "arm1")
    other = joined(cell, "arm2", "the handover of 'cube' from arm2 to arm1")
    cell.step()
    assert again.is_completed
    assert other.failure is None


def test_arm_that_missed_the_end_of_an_action_joins_the_next_one() -> None:
    cell = Cell()
    missed(cell)
    parts = {arm: joined(cell, arm) for arm in MEMBERS}
    cell.step()
    assert parts["arm1"].action is parts["arm2"].action is not None
    assert not parts["arm1"].is_completed
