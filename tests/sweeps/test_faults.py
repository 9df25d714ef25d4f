"""Which faults a tree handles is found by running it with each of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_dualarm.cli import faults
from bt_dualarm.sweeps.engine import Engine
from bt_dualarm.sweeps.faults import inject_faults, lines_of, summary_of
from bt_dualarm.sweeps.manifest import SweepError, TrialSpec
from bt_dualarm.sweeps.trial import Job, Row, run_trial
from tests.behaviors.test_faults import TREE
from tests.sweeps.made_up import InstantEngine


class HereEngine(InstantEngine):
    """Runs trials in this process."""

    def __init__(self) -> None:
        super().__init__(self.run_here)

    def run_here(self, trial: TrialSpec) -> Row:
        return run_trial(self.job)

    def completed(self, timeout: float):  # type: ignore[no-untyped-def]
        if self.queue:
            self.job: Job = self.queue[-1].job
        return super().completed(timeout)


def engine() -> Engine:
    return HereEngine()


@pytest.mark.slow
def test_every_leaf_gets_every_fault(tmp_path: Path) -> None:
    tree = TREE | {"arms": {"arm1": TREE["arms"]["arm1"]}}
    campaign = inject_faults(tree, tmp_path, engine)
    marks = {line.split()[0]: line.split("  ", 1)[1] for line in lines_of(campaign) if "✔" in line}
    text = "\n".join(lines_of(campaign))
    assert "wait" in marks
    # A retry and a fallback handle failures and exceptions, but not a leaf that hangs.
    assert text.count("fail ✔✔✔  raise ✔✔✔  hang ✘✘✘") == 2
    assert text.count("fail ✔✔✔  raise ✔✔✔  hang ✔✔✔") == 1
    assert "log" in text
    assert "did not run" in text
    assert campaign.coverage == 1.0  # the fallback ran in some trial
    assert "0 break a rule" in summary_of(campaign)
    page = (tmp_path / "faults.html").read_text()
    assert page.count("<td class") >= 27
    again = inject_faults(tree, tmp_path, lambda: pytest.fail("nothing is left to run"))
    assert again.faults == campaign.faults


def test_a_tree_that_fails_anyway_is_refused(tmp_path: Path) -> None:
    tree = TREE | {"arms": {"arm1": TREE["arms"]["arm1"] | {"tree": {"fail": "on purpose"}}}}
    with pytest.raises(SweepError, match="does not succeed without faults"):
        inject_faults(tree, tmp_path, engine)


def test_a_tree_with_faults_of_its_own_is_refused(tmp_path: Path) -> None:
    own = {"f": {"arm": "arm2", "leaf": "wait"}}
    with pytest.raises(SweepError, match="faults of its own"):
        inject_faults(TREE | {"faults": own}, tmp_path, engine)


def test_a_missing_file_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert faults(["circel", "--out", str(tmp_path)]) == 2
    assert "no such file" in capsys.readouterr().err
