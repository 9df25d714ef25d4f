"""Injected faults change the simulated world as declared, only while active, and repeatably."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.pose import Vector
from bt_dualarm.diagnosis.story import stories
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.rerun import Changed, check_record, resumed
from bt_dualarm.runtime.api import registry_of
from bt_dualarm.runtime.run import Run
from bt_dualarm.viewer.events import log_of

JOINT = "shoulder_pan_joint"
TREE: dict[str, Any] = {
    "bt_dualarm": 1,
    "name": "impaired",
    "world": {"scene": "empty", "time_limit": 8.0},
    "objects": {
        "cube": {
            "shape": "box",
            "size": [0.06, 0.06, 0.06],
            "mass": 0.2,
            "pose": {"xyz": [1.0, 1.0, 0.03]},
        },
        "can": {
            "shape": "cylinder",
            "size": [0.03, 0.1],
            "mass": 0.2,
            "pose": {"xyz": [1.0, -1.0, 0.05]},
        },
    },
    "arms": {
        "arm1": {
            "robot": "ur5",
            "base": {"xyz": [0, 0, 0.2]},
            "tree": {
                "sequence": [
                    {"move_joints": {"to": {JOINT: 60}}},
                    {"move_joints": {"to": {JOINT: 0}}},
                ]
            },
        }
    },
}


def fault(kind: str, begin: float = 0.5, until: float = 1.0, **ports: Any) -> dict[str, Any]:
    """The only fault of a run, named ``x``."""
    return {"x": {"kind": kind, "begin": begin, "until": until, **ports}}


def of_joint(kind: str, **ports: Any) -> dict[str, Any]:
    """A fault of the joint that the tree moves."""
    return fault(kind, arm="arm1", joint=JOINT, **ports)


def opened(faults: dict[str, Any], at: float) -> Run:
    """A run with a fault, advanced to a time in s."""
    run = bt.open(TREE, faults=faults)
    run.step(at)
    return run


def pan(run: Run) -> float:
    """True position of the joint, rad."""
    return float(run.arms["arm1"].q[0])


def test_frozen_joint_does_not_move_until_the_fault_ends() -> None:
    with opened(of_joint("frozen_joint", until=0.8), 0.52) as run:
        held = pan(run)
        run.step(0.26)
        assert pan(run) == pytest.approx(held, abs=1e-4)
        result = run.finish()
    assert result.arms["arm1"].leaves["sequence/move_joints"].code == "TRACKING_ERROR"
    assert [(event.name, event.is_active) for event in result.faults] == [("x", True), ("x", False)]
    assert [round(event.time, 3) for event in result.faults] == [0.5, 0.8]


def test_frozen_joint_moves_again_afterwards() -> None:
    """No change of the model remains: friction loss and solver parameters."""
    with opened(of_joint("frozen_joint", begin=0.1, until=0.104), 0.2) as run:
        model = run.world.model
        dof = int(run.world.arms["arm1"].dof_ids[0])
        assert float(model.dof_frictionloss[dof]) == 0.0
        with bt.open(TREE) as sound:
            assert np.array_equal(model.dof_solref, sound.world.model.dof_solref)
            assert np.array_equal(model.dof_solimp, sound.world.model.dof_solimp)


@pytest.mark.parametrize(
    ("kind", "port", "value", "fraction"),
    [("weak_joint", "strength", 0.3, 0.3), ("saturated_drive", "limit", 0.01, None)],
)
def test_faulty_drive_delivers_less_torque(
    kind: str, port: str, value: float, fraction: float | None
) -> None:
    with opened(of_joint(kind, begin=0.01, **{port: value}), 0.05) as run:
        arm = run.world.arms["arm1"]
        effort = float(run.world.robots["arm1"].limits.effort[0])
        motor = int(arm.actuator_ids[0])
        commanded = float(run.world.data.ctrl[motor])
        run.world.data.ctrl[motor] = 0.5 * effort
        run.world.step()
        applied = float(run.world.data.actuator_force[motor])
        expected = 0.5 * fraction if fraction is not None else value
        assert applied == pytest.approx(expected * effort)
        assert commanded != 0.0
        run.step(1.2)
        assert float(run.world.model.actuator_gainprm[motor, 0]) == 1.0
        assert not run.world.model.actuator_forcelimited[motor]


def readings(run: Run) -> Vector:
    """Position and velocity of the joint by its encoder, rad and rad/s."""
    hardware = run.world.hardware["arm1"]
    return np.array((hardware.q[0], hardware.v[0]))


def test_stuck_encoder_repeats_its_reading() -> None:
    with opened(of_joint("stuck_encoder", until=0.6), 0.502) as run:
        held = readings(run)
        run.step(0.03)
        assert readings(run)[0] == held[0]
        assert readings(run)[1] == 0.0
        assert abs(pan(run) - held[0]) > 1e-3
        run.step(0.2)
        assert readings(run)[0] == pytest.approx(pan(run))


def test_arm_that_is_spawned_after_its_fault_has_ended_has_sound_encoders() -> None:
    """The fault begins before the arm is removed, and ends before the arm is spawned again."""
    waits = {"wait": {"seconds": 0.6}}
    other = {"robot": "ur5", "base": {"xyz": [0, 2, 0.2]}}
    comes_and_goes = [waits, {"remove": {"arm": "arm1"}}, waits, {"spawn": {"arm": "arm1"}}]
    other["tree"] = {"sequence": comes_and_goes}
    tree = TREE | {"arms": TREE["arms"] | {"arm2": other}}
    result = bt.run(tree, faults=of_joint("stuck_encoder"))
    assert [(event.name, event.is_active) for event in result.faults] == [("x", True), ("x", False)]
    assert [run.status for run in result.arms["arm1"].runs][-2:] == ["SUCCESS", "SUCCESS"]


def test_encoder_with_backlash_lags_by_half_of_it() -> None:
    with opened(of_joint("loose_joint", begin=0.0, until=0.5, play=2.0), 0.45) as run:
        assert pan(run) - readings(run)[0] == pytest.approx(np.radians(1.0), abs=1e-6)


def test_overlapping_faults_are_undone_independently() -> None:
    """The first to begin ends first: neither restores the value set by the other."""
    both = {
        "one": of_joint("weak_joint", begin=0.1, until=0.3, strength=0.5)["x"],
        "other": of_joint("weak_joint", begin=0.2, until=0.4, strength=0.5)["x"],
    }
    with opened(both, 0.25) as run:
        motor = int(run.world.arms["arm1"].actuator_ids[0])
        gains = []
        for _ in range(3):
            gains.append(float(run.world.model.actuator_gainprm[motor, 0]))
            run.step(0.1)
        assert gains == [0.25, 0.5, 1.0]


def test_fault_survives_a_recompilation() -> None:
    with opened(of_joint("weak_joint", begin=0.1, strength=0.5), 0.2) as run:
        generation = run.world.generation
        run.world.remove_object("can")
        run.step(0.004)
        motor = int(run.world.arms["arm1"].actuator_ids[0])
        assert run.world.generation > generation
        assert float(run.world.model.actuator_gainprm[motor, 0]) == 0.5
        run.step(1.0)
        assert float(run.world.model.actuator_gainprm[motor, 0]) == 1.0


def test_pushed_object_accelerates_and_slides_to_rest() -> None:
    push = fault("pushed_object", until=0.7, object="cube", force=[3.0, 0.0, 0.0])
    with opened(push, 0.5) as run:
        start = run.world.object_pose("cube").position
        run.step(0.1)
        moved = run.world.object_pose("cube").position - start
        # a = F/m - mu g, with the cube's friction of 0.8 on the floor
        most = 0.5 * (3.0 / 0.2) * 0.1**2
        assert 0.01 < moved[0] < most
        run.step(1.5)
        assert np.linalg.norm(run.world.object_velocity("cube")) < 1e-3
        assert not run.world.data.xfrc_applied.any()


def test_swapped_objects_exchange_their_positions() -> None:
    swap = fault("swapped_object", object="cube", other="can")
    with opened(swap, 0.6) as run:
        cube = run.world.object_pose("cube").position
        can = run.world.object_pose("can").position
        assert cube == pytest.approx((1.0, -1.0, 0.03), abs=2e-3)
        assert can == pytest.approx((1.0, 1.0, 0.05), abs=2e-3)
        run.step(0.6)
        assert run.world.object_pose("cube").position == pytest.approx((1, 1, 0.03), abs=2e-3)


def test_removed_object_disappears_and_returns() -> None:
    with opened(fault("removed_object", object="cube"), 0.7) as run:
        assert run.world.object_pose("cube").position[2] > 10.0
        assert np.abs(run.world.object_velocity("cube")).max() < 0.1  # it does not fall
        run.step(0.5)
        assert run.world.object_pose("cube").position == pytest.approx((1, 1, 0.03), abs=2e-3)


def test_slippery_object_slides_farther() -> None:
    push = {"push": fault("pushed_object", 0.1, 0.2, object="cube", force=[4.0, 0, 0])["x"]}
    slip = {"slip": fault("reduced_friction", 0.0, 5.0, object="cube", friction=0.05)["x"]}
    reached = []
    for faults in (push, push | slip):
        with opened(faults, 1.0) as run:
            reached.append(float(run.world.object_pose("cube").position[0]))
    assert reached[1] - 1.0 > 3 * (reached[0] - 1.0)


def test_no_plan_fails_with_its_code_and_names_the_fault() -> None:
    reach = {"reach_to_pose": {"posture": "up"}}
    tree = TREE | {"arms": {"arm1": TREE["arms"]["arm1"] | {"tree": reach}}}
    found = bt.run(tree, faults=fault("no_plan", 0.0, 5.0, arm="arm1"))
    leaf = found.arms["arm1"].leaves["reach_to_pose"]
    assert (leaf.code, "the fault 'x'" in leaf.reason) == ("NO_PLAN", True)


def test_tree_of_an_absent_partner_does_not_tick() -> None:
    late = bt.run(TREE, faults=fault("absent_partner", 0.0, 2.0, arm="arm1"))
    usual = bt.run(TREE)
    assert late.outcome == usual.outcome == "SUCCESS"
    assert late.arms["arm1"].runs[0].started_s == pytest.approx(2.0, abs=0.021)
    assert usual.arms["arm1"].runs[0].started_s == 0.0
    never = bt.run(TREE, faults=fault("absent_partner", 0.0, 9.0, arm="arm1"), duration=1.0)
    assert never.outcome == "UNFINISHED"


def test_probability_is_sampled_by_seed_and_name() -> None:
    rare = fault("absent_partner", 0.0, 0.1, arm="arm1", probability=0.4)

    def happened(seed: int) -> bool:
        with bt.open(TREE, faults=rare, seed=seed) as run:
            run.step(0.002)
            return not run.assembly.faults.is_idle

    outcomes = [happened(seed) for seed in range(12)]
    assert outcomes == [happened(seed) for seed in range(12)]
    assert 0 < sum(outcomes) < 12


def test_fault_that_never_begins_changes_nothing() -> None:
    late = of_joint("frozen_joint", begin=100.0, until=200.0)
    assert bt.run(TREE, faults=late).state_sha256 == bt.run(TREE).state_sha256


def test_faults_given_as_an_argument_equal_those_in_the_file() -> None:
    faults = of_joint("weak_joint", strength=0.5)
    inside = bt.run(TREE | {"faults": faults})
    assert bt.run(TREE, faults=faults).state_sha256 == inside.state_sha256
    with pytest.raises(DualArmError, match="a fault 'x' of its own"):
        bt.open(TREE | {"faults": faults}, faults=faults)


def test_unknown_names_in_a_fault_file_are_located(tmp_path: Path) -> None:
    file = tmp_path / "f.yaml"
    file.write_text("faults:\n  x: {kind: weak_joint, arm: arm1, joint: shoulder_pan}\n")
    with pytest.raises(DualArmError, match=r"f\.yaml:2:43: error: there is no joint of arm1"):
        bt.open(TREE, faults=file)


@pytest.mark.usefixtures("without_plots")
def test_record_of_faults_can_be_replayed_resumed_and_explained(tmp_path: Path) -> None:
    faults = of_joint("frozen_joint", begin=0.5, until=3.0)
    result = bt.run(TREE, faults=faults, record=tmp_path / "r")
    assert result.outcome == "FAILURE"
    record = Record.read(tmp_path / "r")
    registry = registry_of()
    agreement = check_record(record, registry)
    assert (agreement.agrees, agreement.hash_agrees) == (True, True)
    with resumed(record, 0.8, registry, Changed()) as again:
        assert again.finish().state_sha256 == result.state_sha256
    cause = stories(record)[0].causes[0]
    assert cause.kind == "INJECTED"
    assert f"{JOINT} of arm1 is frozen" in cause.sentence
    lines = [line for line in log_of(record)["lines"] if line["level"] == "FAULT"]
    assert [line["text"] for line in lines] == [f"fault 'x' injected: {JOINT} of arm1 is frozen"]
    assert record.summary is not None
    assert record.summary["faults"][0]["kind"] == "frozen_joint"


@pytest.mark.usefixtures("without_plots")
def test_unrelated_fault_is_not_reported_as_a_cause(tmp_path: Path) -> None:
    """An active fault of an uninvolved object explains nothing."""
    tree = TREE | {"arms": {"arm1": TREE["arms"]["arm1"] | {"tree": {"fail": "on purpose"}}}}
    bt.run(tree, faults=fault("removed_object", 0.0, 5.0, object="can"), record=tmp_path / "r")
    causes = stories(Record.read(tmp_path / "r"))[0].causes
    assert [cause.kind for cause in causes] == ["SAID_SO"]


@pytest.mark.parametrize("pushed", ["can", "other"])
@pytest.mark.usefixtures("without_plots")
def test_push_that_is_over_explains_why_its_object_is_not_found(
    pushed: str, tmp_path: Path
) -> None:
    """It is far from where the camera looks; a push of another object explains nothing."""
    can = {"shape": "box", "size": [0.04] * 3, "mass": 0.1, "color": "red"}
    tree = {
        "bt_dualarm": 1,
        "objects": {
            "can": can | {"pose": {"xyz": [0.4, -0.4, 0.42]}},
            "other": can | {"color": "blue", "pose": {"xyz": [0.2, -0.6, 0.42]}},
            "gone": can | {"color": "green", "spawned": False},
        },
        "arms": {
            "arm1": {
                "robot": "panda",
                "base": {"xyz": [0, 0, 0.4]},
                "camera": {},
                "tree": {
                    "sequence": [
                        {"look_at": {"at": {"xyz": [0.4, -0.4, 0.42]}, "distance": 0.35}},
                        {"look_at": {"at": {"xyz": [0.42, -0.4, 0.42]}, "distance": 0.35}},
                        {"locate": {"object": "can" if pushed == "can" else "gone"}},
                    ]
                },
            }
        },
    }
    push = fault("pushed_object", 0.1, 0.4, object=pushed, force=[3.0, 0.0, 0.0])
    assert bt.run(tree, faults=push, record=tmp_path / "r").outcome == "FAILURE"
    causes = [cause.kind for cause in stories(Record.read(tmp_path / "r"))[0].causes]
    assert (causes[0] == "INJECTED") == (pushed == "can")
