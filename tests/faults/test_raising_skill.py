"""A skill that raises, wherever it does, fails its own leaf; the other arm's tree succeeds."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bt_dualarm import cli

SKILL = '''\
"""A skill with a bug in the phase that its port names."""
from typing import Literal
from bt_dualarm import PortModel, Skill, port

class Buggy(Skill):
    """Raises in one of its phases while the arm is moving."""

    class Ports(PortModel):
        phase: Literal["making", "first", "moving", "stream", "cleaning", "exit"] = port(
            "first", "where it raises"
        )

    def __init__(self, ports, context, write):
        super().__init__(ports, context, write)
        self.raise_in("making")

    def run(self):
        self.raise_in("first")
        goal = self.arm.setpoint.q + 0.3
        motion = self.arm.follow(self.arm.plan_to(goal, 0.5))
        try:
            for tick, self.progress in enumerate(motion):
                if tick == 10:
                    self.raise_in("moving")
                    self.raise_in("exit")
                    if self.ports.phase == "stream":
                        self.arm.stream(self.broken)
                        yield
                        yield
                if tick == 20:
                    return
                yield
        finally:
            self.raise_in("cleaning")

    def broken(self, time):
        raise RuntimeError("boom")

    def raise_in(self, phase):
        if self.ports.phase == phase:
            raise SystemExit("boom") if phase == "exit" else RuntimeError("boom")
'''

TREE = """\
bt_dualarm: 1
name: raising
world: {scene: empty}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.4]}
    tree: {sequence: [buggy: {phase: %s}, circle: {}]}
  arm2:
    robot: panda
    base: {xyz: [2, 0, 0]}
    tree: {wait: {seconds: 1.5}}
"""


@pytest.mark.parametrize("phase", ["making", "first", "moving", "stream", "cleaning", "exit"])
def test_the_other_arm_succeeds(
    phase: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "skills").mkdir()
    (tmp_path / "skills" / "buggy.py").write_text(SKILL)
    (tmp_path / "tree.yaml").write_text(TREE % phase)
    out = tmp_path / "out"
    command = [str(tmp_path / "tree.yaml"), "--skills", str(tmp_path / "skills")]
    assert cli.run([*command, "--record", str(out)]) == 1
    arms = json.loads((out / "summary.json").read_text())["arms"]
    assert [arm["outcome"] for arm in arms.values()] == ["FAILURE", "SUCCESS"]
    (leaf,) = arms["arm1"]["leaves"]
    assert (leaf["status"], leaf["code"]) == ("FAILURE", "EXCEPTION")
    assert "boom" in leaf["reason"]
    assert "Traceback" in (out / "run.log").read_text()
    assert "boom" in capsys.readouterr().out, "the reason is in the report"
