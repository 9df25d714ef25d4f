"""Fault injection runs a tree with each fault to find which of them it handles."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.behaviors.load import load
from bt_dualarm.cli import faults
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.sweeps.engine import Engine
from bt_dualarm.sweeps.faults import (
    inject_faults,
    lines_of,
    sample_lines,
    sampled_hardware,
    summary_of,
)
from bt_dualarm.sweeps.job import Row
from bt_dualarm.sweeps.manifest import SweepError, TrialSpec
from bt_dualarm.sweeps.trial import TrialJob
from tests.behaviors.test_faults import TREE
from tests.sweeps.synthetic import InstantEngine, row_of


class HereEngine(InstantEngine):
    """Runs trials in this process."""

    def __init__(self) -> None:
        super().__init__(self.run_here)

    def run_here(self, trial: TrialSpec) -> Row:
        return self.job.run()

    def completed(self, timeout: float):  # type: ignore[no-untyped-def]
        if self.queue:
            assert isinstance(self.queue[-1].job, TrialJob)
            self.job = self.queue[-1].job
        return super().completed(timeout)


def engine() -> Engine:
    return HereEngine()


@pytest.mark.slow
def test_every_fault_is_injected_into_every_leaf(tmp_path: Path) -> None:
    world = TREE["world"] | {"time_limit": 1.0}  # the duration of runs that hang
    tree = TREE | {"world": world, "arms": {"arm1": TREE["arms"]["arm1"]}}
    campaign = inject_faults(tree, tmp_path, engine)
    marks = {line.split()[0]: line.split("  ", 1)[1] for line in lines_of(campaign) if "✔" in line}
    text = "\n".join(lines_of(campaign))
    assert "wait" in marks
    # A retry handles single failures and exceptions, a fallback also permanent ones; neither
    # handles a leaf that hangs.
    assert text.count("fail ✔✔✔✘  raise ✔✔✔  hang ✘✘✘") == 1
    assert text.count("fail ✔✔✔✔  raise ✔✔✔  hang ✘✘✘") == 1
    assert text.count("fail ✔✔✔✔  raise ✔✔✔  hang ✔✔✔") == 1
    # The fallback ran because of another fault, and got its own faults in addition.
    assert "log                                    fail ✘·✘✘  raise ✘·✘  hang ✘·✘" in text
    assert campaign.coverage == 1.0
    assert "0 break a rule" in summary_of(campaign)
    page = (tmp_path / "faults.html").read_text()
    assert page.count("<td class") >= 37
    again = inject_faults(tree, tmp_path, lambda: pytest.fail("nothing is left to run"))
    assert again.faults == campaign.faults


def test_tree_that_fails_without_faults_is_refused(tmp_path: Path) -> None:
    tree = TREE | {"arms": {"arm1": TREE["arms"]["arm1"] | {"tree": {"fail": "on purpose"}}}}
    with pytest.raises(SweepError, match="does not succeed without faults"):
        inject_faults(tree, tmp_path, engine)


def test_tree_with_its_own_faults_is_refused(tmp_path: Path) -> None:
    own = {"f": {"arm": "arm2", "leaf": "wait"}}
    with pytest.raises(SweepError, match="faults of its own"):
        inject_faults(TREE | {"faults": own}, tmp_path, engine)


def test_missing_file_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert faults(["circel", "--out", str(tmp_path)]) == 2
    assert "no such file" in capsys.readouterr().err


@pytest.mark.slow
def test_broken_rules_are_reported_with_the_record(tmp_path: Path) -> None:
    """Even in successful runs."""

    def touch(trial: TrialSpec) -> Row:
        row = {
            **row_of(trial),
            "broken_rule": "arm1 and arm2 touch at 1.000 s"
            if trial.params["injected_effect"] == "raise"
            else "",
        }
        (tmp_path / "records" / trial.identity).mkdir(parents=True, exist_ok=True)
        return row

    tree = TREE | {"arms": {"arm2": TREE["arms"]["arm2"]}}
    campaign = inject_faults(tree, tmp_path, lambda: InstantEngine(touch))
    assert "wait                                       fail ✔✔✔✔  raise ⚠⚠⚠  hang ✔✔✔" in (
        "\n".join(lines_of(campaign))
    )
    assert summary_of(campaign).startswith("7 of 10 faults are handled (70 %), 3 break a rule")
    page = (tmp_path / "faults.html").read_text()
    assert page.count("arm1 and arm2 touch at 1.000 s</li>") == 3
    assert page.count('<a href="records/') == 10


@pytest.mark.slow
def test_stop_request_keeps_finished_results(tmp_path: Path) -> None:
    """Even before the first of the sampled faults."""
    stop = StopRequest()

    def end_early(trial: TrialSpec) -> Row:
        if trial.params["injected_phase"] == "end":
            stop.ask()
        return row_of(trial)

    tree = TREE | {"arms": {"arm2": TREE["arms"]["arm2"]}}
    made = inject_faults(tree, tmp_path, lambda: InstantEngine(end_early), pairs=2, stop=stop)
    assert 0 < len(made.faults) < 10
    none = replace(made, faults=())
    assert "not tried yet" in "\n".join(lines_of(none))
    assert not made.pairs
    assert (tmp_path / "faults.html").exists()
    later = StopRequest()

    class Ending(InstantEngine):
        def completed(self, timeout: float):  # type: ignore[no-untyped-def]
            job = self.queue[-1].job
            if isinstance(job, TrialJob) and "injected_first_arm" in job.trial.params:
                later.ask()
                return []
            return super().completed(timeout)

    two = tree | {"arms": {"arm2": TREE["arms"]["arm2"] | {"tree": {"sequence": [
        {"wait": 0.1}, {"log": "done"}]}}}}  # fmt: skip
    made = inject_faults(two, tmp_path, lambda: Ending(row_of), pairs=2, stop=later)
    assert len(made.faults) == 17
    assert not made.pairs


@pytest.mark.slow
def test_single_leaf_has_no_pairs(tmp_path: Path) -> None:
    tree = TREE | {"arms": {"arm2": TREE["arms"]["arm2"]}}
    made = inject_faults(tree, tmp_path, lambda: InstantEngine(row_of), pairs=2)
    assert len(made.trials) == 10


@pytest.mark.slow
def test_tree_in_another_folder_may_include_files_beside_it(tmp_path: Path) -> None:
    (tmp_path / "library.yaml").write_text(
        "bt_dualarm: 1\nsubtrees: {pause: {tree: {wait: 0.1}}}\n"
    )
    file = tmp_path / "tree.yaml"
    file.write_text(
        "bt_dualarm: 1\nname: t\ninclude: [library.yaml]\nworld: {scene: empty, time_limit: 1}\n"
        "arms: {arm1: {robot: ur5, tree: {subtree: {use: pause}}}}\n"
    )
    campaign = inject_faults(file, tmp_path / "out", engine)
    assert len(campaign.faults) == 10
    assert not any(one.is_breach for one in campaign.faults)


HARDWARE_TREE = {
    "bt_dualarm": 1,
    "name": "short",
    "world": {"scene": "empty", "time_limit": 1.0},
    "objects": {
        "cube": {
            "shape": "box",
            "size": [0.05, 0.05, 0.05],
            "mass": 0.1,
            "pose": {"xyz": [1, 1, 0.025]},
        }
    },
    "arms": {"arm1": {"robot": "ur5", "tree": {"sequence": [{"wait": 0.1}, {"log": "done"}]}}},
}


@pytest.mark.slow
def test_pairs_and_hardware_are_sampled_by_seed(tmp_path: Path) -> None:
    campaign = inject_faults(HARDWARE_TREE, tmp_path, engine, pairs=2, hardware=10)
    assert len(campaign.pairs) == 2
    assert all(" + " in one.sentence for one in campaign.pairs)
    assert len(campaign.hardware) == 10
    # Ten kinds apply, without a camera or objects to swap. Only its absence affects a tree that
    # just waits.
    lost = [one.sentence for one in campaign.hardware if not one.is_handled]
    assert [sentence.partition(",")[0] for sentence in lost] == ["the tree of arm1 does not tick"]
    lines = "\n".join(sample_lines(campaign))
    assert "hardware and world: 9 of 10 are handled" in lines
    assert "cube is taken away" in lines
    page = (tmp_path / "faults.html").read_text()
    assert "<h2>Hardware and world</h2>" in page
    again = inject_faults(
        HARDWARE_TREE, tmp_path, lambda: pytest.fail("nothing is left"), pairs=2, hardware=10
    )
    assert again.trials == campaign.trials


def test_sampled_faults_are_valid_for_the_file() -> None:
    """Every kind is sampled equally often, and the check of the file accepts all."""
    file = bt.open(HARDWARE_TREE).assembly  # its joints
    loaded = load(HARDWARE_TREE).file
    assert loaded is not None
    joints = {"arm1": file.world.robots["arm1"].joints}
    sampled = sampled_hardware(loaded, joints, 2.0, 20, np.random.default_rng(3))
    assert set(Counter(one["kind"] for one in sampled.values()).values()) == {2}
    assert not load(HARDWARE_TREE | {"faults": sampled}).wrong
