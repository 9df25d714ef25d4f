"""Runner: order of actions, endings, faults, and arms that are spawned and removed."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from bt_dualarm.behaviors.report import StatusChange
from bt_dualarm.runtime.arm_runtime import MOST_LIVES, RunView
from bt_dualarm.runtime.outcome import Ending, Leniency, Outcome
from bt_dualarm.runtime.runner import Limit
from tests.runtime.fakes import FakeCamera, FakeController, Stage, ticks


def raising(after: int) -> Iterator[object]:
    for _ in range(after):
        yield None
    raise RuntimeError("boom")


def test_the_order_within_a_step_is_fixed() -> None:
    stage = Stage({"arm1": ticks(1), "arm2": ticks(1)})
    stage.cameras["arm2"] = FakeCamera("arm2", stage.world)
    stage.run()
    # tick every 2 steps, control every step, an image every 2 steps delivered one step later
    assert stage.log[:14] == [
        "0 capture arm2",
        "0 tick arm1",
        "0 tick arm2",
        "0 control arm1",
        "0 control arm2",
        "0 step",
        "1 deliver arm2",
        "1 control arm1",
        "1 control arm2",
        "1 step",
        "2 capture arm2",
        "2 tick arm1",
        "2 tick arm2",
        "2 control arm1",
    ]


def test_a_run_ends_when_every_tree_has_succeeded_and_the_arms_rest() -> None:
    stage = Stage({"arm1": ticks(1), "arm2": ticks(4)})
    result = stage.run()
    assert result.ending is Ending.FINISHED
    assert result.outcome is Outcome.SUCCESS
    assert [(arm.name, arm.outcome, arm.ended_s) for arm in result.arms.values()] == [
        ("arm1", Outcome.SUCCESS, 0.02),
        ("arm2", Outcome.SUCCESS, 0.08),
    ]
    assert result.at_rest
    assert all(controller.at_rest for controller in stage.controllers.values())
    assert not [line for line in stage.log if line == "4 tick arm1"], "ended trees are not ticked"
    assert result.arms["arm1"].clipped_setpoints == 7
    assert (result.wall_time_s, result.real_time_factor) == (2, result.sim_time_s / 2)


def test_one_failed_tree_does_not_stop_the_other() -> None:
    result = Stage({"arm1": ticks(1, "FAILURE"), "arm2": ticks(5)}).run()
    assert [arm.outcome for arm in result.arms.values()] == [Outcome.FAILURE, Outcome.SUCCESS]
    assert result.outcome is Outcome.FAILURE


@pytest.mark.parametrize("after", [0, 1, 2])
def test_an_exception_in_a_tick_fails_that_arm_alone(
    after: int, caplog: pytest.LogCaptureFixture
) -> None:
    stage = Stage({"arm1": raising(after), "arm2": ticks(5)})
    result = stage.run()
    first, second = result.arms.values()
    assert first.outcome is Outcome.FAILURE
    assert first.fault == "tree raised RuntimeError: boom"
    assert stage.controllers["arm1"].stops >= 1
    assert stage.trees["arm1"].halts == 1
    assert second.outcome is Outcome.SUCCESS
    assert "RuntimeError: boom" in caplog.text


def test_an_exception_in_a_frame_callback_fails_that_arm_alone() -> None:
    def broken() -> None:
        raise ValueError("in the callback")

    stage = Stage({"arm1": ticks(9), "arm2": ticks(5)})
    camera = stage.cameras["arm1"] = FakeCamera("arm1", stage.world)
    camera.on_frame = broken
    first, second = stage.run().arms.values()
    assert first.fault == "camera raised ValueError: in the callback"
    assert (first.outcome, second.outcome) == (Outcome.FAILURE, Outcome.SUCCESS)


def test_the_limit_ends_the_run_unfinished() -> None:
    stage = Stage({"arm1": ticks(1000)})
    stage.limit = Limit(0.1, Ending.DURATION)
    result = stage.run()
    assert (result.ending, result.outcome) == (Ending.DURATION, Outcome.UNFINISHED)
    assert stage.log.count("10 step") == 1
    assert "10 tick arm1" not in stage.log
    assert stage.recorder.changes == ["0.00 arm1 INVALID>RUNNING", "0.10 arm1 RUNNING>INVALID"]
    assert result.arms["arm1"].ended_s is None
    assert result.at_rest


def test_a_stop_request_halts_the_trees_and_stops_the_arms() -> None:
    stage = Stage({"arm1": ticks(1000)})

    def script() -> Iterator[object]:
        yield None
        stage.stop.receive(2)
        while True:
            yield None

    stage.scripts["arm1"] = script()
    result = stage.run()
    assert (result.ending, result.outcome) == (Ending.STOPPED, Outcome.UNFINISHED)
    assert result.at_rest
    assert stage.stop.exit_code == 130


def test_a_second_request_does_not_wait_for_the_arms() -> None:
    stage = Stage({"arm1": ticks(1000)})
    stage.stop.receive(15)
    stage.stop.receive(2)
    result = stage.run()
    assert stage.log == []
    assert not result.at_rest
    assert stage.stop.exit_code == 143


def test_arms_that_never_rest_do_not_delay_the_end() -> None:
    stage = Stage({"arm1": ticks(1)})
    stage.controllers["arm1"] = FakeController("arm1", stage.world, updates_to_stop=10**9)
    result = stage.run()
    assert not result.at_rest
    assert result.outcome is Outcome.SUCCESS
    assert result.sim_time_s < 6.0


def test_a_divergence_ends_the_run_with_its_error() -> None:
    stage = Stage({"arm1": ticks(1000)})
    stage.world.diverges_at = 7
    result = stage.run()
    assert result.ending is Ending.DIVERGED
    assert result.error == "the simulation diverged at 0.070 s"
    assert stage.log[-1] == "7 step", "no step after the divergence"
    assert not result.at_rest
    assert stage.recorder.changes[-1] == "0.07 arm1 RUNNING>INVALID"


def test_a_controller_that_raises_ends_the_run_in_order() -> None:
    stage = Stage({"arm1": ticks(1000)})
    controller = FakeController("arm1", stage.world)
    controller.breaks_at = 3
    stage.controllers["arm1"] = controller
    result = stage.run()
    assert (result.ending, result.outcome) == (Ending.ERROR, Outcome.UNFINISHED)
    assert result.error == "ZeroDivisionError: in the controller"


def test_an_arm_spawned_by_a_leaf_begins_its_own_tree() -> None:
    stage = Stage({"late": ticks(2), "early": iter(())}, present=("early",))

    def spawn() -> Iterator[object]:
        yield None
        stage.world.arms["late"] = None
        yield "SUCCESS"

    stage.scripts["early"] = spawn()
    result = stage.run()
    assert [arm.outcome for arm in result.arms.values()] == [Outcome.SUCCESS, Outcome.SUCCESS]
    assert stage.log.index("2 control late") < stage.log.index("2 step"), "held from the start"
    assert [line for line in stage.log if "tick late" in line] == [
        "3 tick late",
        "5 tick late",
        "7 tick late",
    ]


@pytest.mark.parametrize(
    ("leniency", "outcome"),
    [(Leniency(), Outcome.UNFINISHED), (Leniency(removable=True), Outcome.SUCCESS)],
)
def test_an_arm_that_is_removed_before_its_tree_has_ended_keeps_the_run_from_success(
    leniency: Leniency, outcome: Outcome
) -> None:
    """Unless the file declares the arm removable."""
    stage = Stage({"arm1": iter(()), "arm2": ticks(1000)})
    stage.leniency["arm2"] = leniency

    def remove() -> Iterator[object]:
        yield None
        stage.world.remove_arm("arm2")
        yield "SUCCESS"

    stage.scripts["arm1"] = remove()
    result = stage.run()
    assert [arm.outcome for arm in result.arms.values()] == [Outcome.SUCCESS, Outcome.REMOVED]
    assert result.outcome is outcome
    assert "0.02 arm2 RUNNING>INVALID" in stage.recorder.changes
    assert not [line for line in stage.log if line == "2 control arm2"]


def test_an_arm_that_is_spawned_again_keeps_its_earlier_runs() -> None:
    stage = Stage({"arm1": iter(()), "arm2": ticks(1)})

    def replace() -> Iterator[object]:
        yield None
        yield None
        stage.world.remove_arm("arm2")
        yield None
        stage.scripts["arm2"] = ticks(1)
        stage.world.arms["arm2"] = None
        yield "SUCCESS"

    stage.scripts["arm1"] = replace()
    second = stage.run().arms["arm2"]
    assert second.outcome is Outcome.SUCCESS
    assert [life.outcome for life in second.lives] == [Outcome.SUCCESS, Outcome.SUCCESS]
    assert len(second.runs) == 2
    assert second.clipped_setpoints == 14


@pytest.mark.parametrize("lenient", [False, True])
@pytest.mark.parametrize("first", ["SUCCESS", "FAILURE", "RUNNING", "raises"])
def test_an_unsuccessful_life_counts_after_the_arm_is_spawned_again(
    first: str, lenient: bool
) -> None:
    """It failed, was cut short or raised: a successful next life does not make up for it, unless
    the file lets the last life count."""
    scripts = {"raises": raising(0), "RUNNING": ticks(1000)}
    script = scripts.get(first) or ticks(0, first)
    stage = Stage({"arm1": iter(()), "arm2": script})
    stage.leniency["arm2"] = Leniency(last_life_counts=lenient)

    def replace() -> Iterator[object]:
        yield None
        yield None
        stage.world.remove_arm("arm2")
        yield None
        stage.scripts["arm2"] = ticks(1)
        stage.world.arms["arm2"] = None
        yield "SUCCESS"

    stage.scripts["arm1"] = replace()
    result = stage.run()
    earlier, last = result.arms["arm2"].lives
    expected = {"raises": "FAILURE", "RUNNING": "REMOVED"}.get(first, first)
    assert (earlier.outcome, last.outcome) == (expected, "SUCCESS")
    good = lenient or first == "SUCCESS"
    assert (result.outcome is Outcome.SUCCESS) == good
    assert result.arms["arm2"].outcome == ("SUCCESS" if good else expected)
    assert result.arms["arm2"].fault == ("tree raised RuntimeError: boom" * (first == "raises"))


@pytest.mark.parametrize("bad", [None, 3, 60])
def test_every_life_counts_however_many_there_are(bad: int | None) -> None:
    """Of those in the middle, only the outcomes are kept."""
    count = 2 * MOST_LIVES + 30
    stage = Stage({"arm1": iter(()), "arm2": ticks(0)})

    def replace() -> Iterator[object]:
        for life in range(count):
            stage.scripts["arm2"] = ticks(0, "FAILURE" if life == bad else "SUCCESS")
            stage.world.arms["arm2"] = None
            yield None
            yield None
            stage.world.remove_arm("arm2")
            yield None
        stage.world.arms["arm2"] = None
        stage.scripts["arm2"] = ticks(0)
        yield "SUCCESS"

    stage.scripts["arm1"] = replace()
    arm = stage.run().arms["arm2"]
    assert arm.outcome == ("SUCCESS" if bad is None else "FAILURE")
    assert len(arm.lives) == 2 * MOST_LIVES + 1
    assert len(arm.lives) + arm.lives_left_out >= count
    assert len(arm.runs) == len(arm.lives)
    assert arm.runs_left_out == arm.lives_left_out


def test_an_arm_that_was_never_spawned_is_no_failure() -> None:
    result = Stage({"arm1": ticks(1), "spare": ticks(1)}, present=("arm1",)).run()
    assert [arm.outcome for arm in result.arms.values()] == [Outcome.SUCCESS, Outcome.NOT_SPAWNED]
    assert result.outcome is Outcome.SUCCESS


def test_a_run_without_arms_is_no_success() -> None:
    assert Stage({"spare": ticks(1)}, present=()).run().outcome is Outcome.UNFINISHED


def test_an_observer_that_raises_is_dropped(caplog: pytest.LogCaptureFixture) -> None:
    class Broken:
        def on_event(self, change: StatusChange) -> None:
            raise BrokenPipeError

        def after_ticks(self, run: RunView) -> None:
            raise AssertionError("dropped before")

        def after_step(self, time: float) -> None:
            raise AssertionError("dropped before")

    stage = Stage({"arm1": ticks(3)})
    stage.observers.insert(0, Broken())
    assert stage.run().outcome is Outcome.SUCCESS
    assert stage.recorder.changes == ["0.00 arm1 INVALID>RUNNING", "0.06 arm1 RUNNING>SUCCESS"]
    assert "observer Broken was dropped" in caplog.text
