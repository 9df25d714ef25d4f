"""Every shipped tree succeeds with the command that a user types."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest

from bt_dualarm.core.share import share_dir
from tests import glossary
from tests.commands import BtRun, Ran
from tests.families import some
from tests.no_plots import no_plots

TREES = sorted(path.stem for path in share_dir("trees").glob("*.yaml"))
MAIN_JOB = "pick_and_track"
DRAWN = {*some(TREES, 5), MAIN_JOB}
"""Trees whose plots are drawn, too."""

RUN_FIELDS = {
    "outcome": str,
    "ending": str,
    "error": str,
    "at_rest": bool,
    "sim_time_s": float,
    "wall_time_s": float,
    "real_time_factor": float,
    "seed": int,
    "state_sha256": str,
    "processor": dict,
    "versions": dict,
    "attachments": list,
    "arms": dict,
}
ARM_FIELDS = {
    "outcome": str,
    "robot": str,
    "fault": str,
    "clipped_setpoints": int,
    "guard": dict,
    "leaves": list,
}
LEAF_FIELDS = {
    "path": str,
    "skill": str,
    "status": str,
    "started_s": float,
    "ended_s": float,
    "code": str,
    "reason": str,
    "metrics": dict,
}
METRICS = {
    "circle": {"path_rms_m", "path_max_m", "duration_s", "shortest_s"},
    "lissajous": {"path_rms_m", "path_max_m", "duration_s", "shortest_s"},
    "track": {"yz_rms_m", "yz_max_m", "lag_s", "lost_count", "frames"},
}

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", TREES)
def test_shipped_tree_succeeds(
    name: str, bt_run_here: BtRun, request: pytest.FixtureRequest
) -> None:
    """Exit code 0, every tree SUCCESS, a complete record, and no clipped set-point."""
    if name == MAIN_JOB:
        ran = request.getfixturevalue("main_job")
    else:
        with nullcontext() if name in DRAWN else no_plots():
            ran = bt_run_here(f"trees/{name}.yaml")
    assert ran.code == 0, ran.err
    assert ran.summary["outcome"] == "SUCCESS"
    check_summary(ran)
    assert {arm["clipped_setpoints"] for arm in ran.summary["arms"].values()} == {0}
    check_events(ran)
    plots = [*ran.folder.glob("*.png")]
    assert bool(plots) == (name in DRAWN)
    for plot in plots:
        assert plot.read_bytes()[1:4] == b"PNG"
    if name in CHECKS:
        CHECKS[name](ran)


def check_summary(ran: Ran) -> None:
    """Check the types of all fields, and the metrics of each skill."""
    check_types(ran.summary, RUN_FIELDS)
    assert ran.summary["renderer"] in ("ray", None)
    assert len(ran.summary["state_sha256"]) == 64
    for arm in ran.summary["arms"].values():
        check_types(arm, ARM_FIELDS)
        assert arm["outcome"] == "SUCCESS"
        for leaf in arm["leaves"]:
            check_types(leaf, LEAF_FIELDS)
            assert METRICS.get(leaf["skill"], set()) <= leaf["metrics"].keys()
            assert leaf["metrics"].keys() <= glossary.METRICS
            assert leaf["started_s"] <= leaf["ended_s"] <= ran.summary["sim_time_s"]


def check_types(item: dict[str, Any], fields: dict[str, type]) -> None:
    for name, kind in fields.items():
        allowed = (int, float) if kind is float else kind
        assert isinstance(item[name], allowed), f"{name}: {item[name]!r}"


def check_events(ran: Ran) -> None:
    """Check that each node's changes form a chain from INVALID, in order of time."""
    times = [event["time_s"] for event in ran.events]
    assert times == sorted(times)
    last: dict[tuple[str, str], str] = {}
    for event in ran.events:
        node = event["arm"], event["path"]
        assert event["old"] == last.get(node, "INVALID")
        last[node] = event["new"]
    assert {arm for arm, _ in last} == set(ran.summary["arms"])


def check_pick_and_track(ran: Ran) -> None:
    """Check that the cube was grasped, lifted, carried by friction, and tracked on both curves."""
    check_job(ran)
    assert not ran.leaves("arm1", "approach_and_attach")
    (taken,) = ran.leaves("arm1", "grasp")
    assert lift(ran, "cube", taken["ended_s"]) >= 0.2
    carried = [leaf for leaf in ran.summary["arms"]["arm1"]["leaves"] if leaf["skill"] in CARRYING]
    assert len(carried) == 4
    assert max(leaf["metrics"]["slid_m"] for leaf in carried) < 1e-4  # by friction alone


def check_job(ran: Ran) -> None:
    """Check that the cube is held from the pick to the end, and tracked on both curves."""
    (held,) = ran.summary["attachments"]
    assert (held["arm"], held["object"], held["released_s"]) == ("arm1", "cube", None)
    assert held["lifted_m"] >= 0.2
    check_both_curves(ran)
    assert lift(ran, "cube", held["attached_s"]) >= 0.2


def check_both_curves(ran: Ran) -> None:
    """Check that the Panda tracked the cube on both curves and never lost it."""
    (track,) = ran.leaves("arm2", "track")
    assert track["metrics"]["yz_rms_m"] <= 0.005
    assert track["metrics"]["lost_count"] == 0
    for skill in ("circle", "lissajous"):
        (curve,) = ran.leaves("arm1", skill)
        assert track["started_s"] < curve["started_s"] < curve["ended_s"] < track["ended_s"]
        assert curve["metrics"]["path_rms_m"] < 0.001
        assert tracking_error(ran, curve["started_s"] + 1.0, curve["ended_s"]) <= 0.005


def test_main_job_succeeds_with_a_weld(bt_run_here: BtRun) -> None:
    """A magnetic tool works, too; then the arm has no gripper."""
    with no_plots():
        ran = bt_run_here(
            "trees/pick_and_track.yaml", "--param", "grasp=attach", "--param", "speed=1.0"
        )
    assert ran.code == 0, ran.err
    check_summary(ran)
    check_job(ran)
    assert not ran.leaves("arm1", "grasp")
    assert len(ran.leaves("arm1", "approach_and_attach")) == 1


CARRYING = ("transport", "circle", "lissajous")


def lift(ran: Ran, obj: str, since: float) -> float:
    """Rise of an object after a time in m, from the record."""
    heights = ran.samples[f"object_{obj}"][ran.samples["time"] >= since, 2]
    return float(np.nanmax(heights) - heights[0])


def tracking_error(ran: Ran, begin: float, end: float) -> float:
    """RMS error of the Panda's tool to the cube in the YZ plane without the mean offset, m."""
    during = (ran.samples["time"] >= begin) & (ran.samples["time"] <= end)
    offsets = (ran.samples["tool_arm2"] - ran.samples["object_cube"])[during, 1:]
    return float(np.sqrt(np.mean(((offsets - offsets.mean(axis=0)) ** 2).sum(axis=1))))


def check_visual_tracking(ran: Ran) -> None:
    (track,) = ran.leaves("arm2", "track")
    assert track["metrics"]["yz_rms_m"] <= 0.005
    assert track["metrics"]["lost_count"] == 0


def check_pick_and_transport(ran: Ran) -> None:
    """Check that the cube was carried across the table and rests at its goal."""
    (held,) = ran.summary["attachments"]
    assert held["released_s"] is not None
    end = ran.samples["object_cube"][-1]
    np.testing.assert_allclose(end, (0.20, -0.50, 0.425), atol=0.003)


def check_spawn_and_command(ran: Ran) -> None:
    """Check that spawned arms are recorded from their start on, and the ball is gone at the end."""
    assert {arm["robot"] for arm in ran.summary["arms"].values()} == {
        "ur5",
        "panda",
        "xarm7",
        "ur10",
    }
    assert np.isnan(ran.samples["tool_arm4"][0]).all()
    assert np.isfinite(ran.samples["tool_arm4"][-1]).all()
    assert np.isnan(ran.samples["object_ball"][-1]).all()


def check_peg_in_hole(ran: Ran) -> None:
    """Check that the search found the hole away from its declared position, at low forces."""
    (leaf,) = ran.leaves("arm1", "insert")
    assert leaf["metrics"]["search_places"] > 1
    assert 3e-4 < leaf["metrics"]["inserted_error_m"] < 1.1e-3, "the error of the declared position"
    assert leaf["metrics"]["push_n"] < 25.0
    assert leaf["ended_s"] - leaf["started_s"] < 12.0


def check_assembly(ran: Ran) -> None:
    """Check that the bar rested while the peg was inserted, and that both end at their goals."""
    (hold,) = ran.leaves("holder", "hold_still")
    assert hold["metrics"]["held_moved_m"] < 1e-3
    (insert,) = ran.leaves("inserter", "insert")
    assert insert["metrics"]["inserted_error_m"] < 2e-3
    during = (ran.samples["time"] >= hold["started_s"]) & (ran.samples["time"] <= hold["ended_s"])
    assert np.ptp(ran.samples["object_bar"][during, :3], axis=0).max() < 2e-3
    np.testing.assert_allclose(ran.samples["object_bar"][-1, :2], (0.40, -0.72), atol=0.004)
    np.testing.assert_allclose(ran.samples["object_peg"][-1, :2], (0.3005, -0.4795), atol=0.002)


CHECKS = {
    "assembly": check_assembly,
    "peg_in_hole": check_peg_in_hole,
    "pick_and_track": check_pick_and_track,
    "visual_tracking": check_visual_tracking,
    "pick_and_transport": check_pick_and_transport,
    "spawn_and_command": check_spawn_and_command,
}


@pytest.mark.usefixtures("without_plots")
def test_runs_are_determined_by_the_seed(bt_run: BtRun, bt_run_here: BtRun) -> None:
    """With one seed, a fresh process and one that has run others reach the same state, bit for bit.

    Another seed gives another state.
    """
    runs = [
        how("trees/pick_and_track.yaml", "--duration", "2", "--seed", str(seed))
        for how, seed in ((bt_run, 3), (bt_run_here, 3), (bt_run_here, 4))
    ]
    assert [run.code for run in runs] == [1, 1, 1]  # the duration ends it before the trees
    hashes = [run.summary["state_sha256"] for run in runs]
    assert hashes[0] == hashes[1] != hashes[2]
