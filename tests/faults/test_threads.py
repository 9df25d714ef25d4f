"""A leaf may control its arm only during its ticks, in whichever thread ticks it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm import Arm, PortModel, Skill, port
from bt_dualarm.core.errors import SkillError
from bt_dualarm.testing import registry_with
from tests.plays import Stage

ACTIONS: dict[str, Callable[[Arm], Any]] = {
    "begin": lambda arm: arm.begin(arm.straight_to(arm.setpoint.q + 0.3, 0.5)),
    "follow": lambda arm: next(arm.follow(arm.straight_to(arm.setpoint.q + 0.3, 0.5))),
    "stream": lambda arm: arm.stream(lambda _: arm.setpoint),
    "travel": lambda arm: next(arm.travel([arm.posture("home")], 0.5)),
    "plan": lambda arm: next(arm.plan([arm.posture("home")], 0.5)),
    "think": lambda arm: next(arm.think()),
    "relax": lambda arm: next(arm.relax()),
    "halt": lambda arm: next(arm.halt(), None),
    "release": lambda arm: arm.release(),
    "attach": lambda arm: arm.attach("ball"),
    "detach": lambda arm: arm.detach("ball"),
}
"""All actions by which a leaf changes its arm's motion, plan or payload."""

MOVING = ("halt", "release", "detach")
"""Actions that would stop a motion: the arm moves when they are called."""


class Threaded(Skill):
    """Calls an action of its arm from its own thread."""

    class Ports(PortModel):
        action: str = port(..., "what it does")

    example = "threaded: {action: halt}"
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Moves first if the action stops a motion."""
        if self.ports.action in MOVING:
            self.arm.begin(self.arm.straight_to(self.arm.setpoint.q + 0.3, 0.5))
        for _ in range(5):
            yield None
        thread = threading.Thread(target=self._do, name="a thread of its own")
        thread.start()
        thread.join()
        for _ in range(5):
            yield None

    def _do(self) -> None:
        with pytest.raises(SkillError):
            ACTIONS[self.ports.action](self.arm)


FILE = """
world: {scene: empty, time_limit: 5}
objects:
  ball: {shape: sphere, size: [0.03], mass: 0.1, pose: {xyz: [0.5, -0.5, 0.03]}}
arms:
  arm1: {robot: ur5, posture: up, tree: {threaded: {action: ACTION}}}
  arm2: {robot: ur3, base: {xyz: [0, -3, 0]}, tree: {go_home: {}}}
"""


@pytest.fixture
def own(tmp_path: Path) -> Stage:
    return Stage(tmp_path, registry_with(Threaded))


@pytest.mark.parametrize("action", ACTIONS)
def test_leaf_that_controls_its_arm_from_a_thread_fails_with_the_reason(
    action: str, own: Stage
) -> None:
    """The attempt has no effect: the arm goes on as before until the leaf fails."""
    play = own.run(FILE.replace("ACTION", action))
    (leaf,) = play.arm("arm1").runs
    assert (leaf.status, leaf.code) == ("FAILURE", "EXCEPTION")
    assert leaf.reason.startswith("test_threads.py:")
    assert "Threaded" in leaf.reason
    assert "from thread 'a thread of its own'" in leaf.reason
    assert leaf.ended_s == pytest.approx(0.12, abs=0.021), "at the next tick"
    if action not in MOVING:
        assert play.joint_travel["arm1"] < 2e-3
    assert not play.world.attachments
    assert play.arm("arm2").outcome == "SUCCESS"


class Bystander(Skill):
    """Moves by a trajectory, a stream and a plan."""

    example = "bystander"

    def run(self) -> Iterator[float | None]:
        """Moves away, streams, and returns."""
        start = self.arm.setpoint.q
        yield from self.arm.follow(self.arm.straight_to(start + 0.05, 0.5))
        self.arm.stream(lambda _: self.arm.setpoint)
        yield from self.arm.halt()
        yield from self.arm.travel([start], 0.5)


def test_run_may_be_advanced_by_any_thread(tmp_path: Path) -> None:
    """With a new thread for each step, nothing is refused, and the states are the same bits."""
    tree = FILE.replace("threaded: {action: ACTION}", "bystander: {}")
    file = tmp_path / "tree.yaml"
    file.write_text("bt_dualarm: 1\n" + tree, encoding="utf-8")
    hashes = []
    for threaded in (False, True):
        with bt.open(file, skills=[Bystander]) as run:
            while not run.done:
                if threaded:
                    thread = threading.Thread(target=run.step, args=(0.1,))
                    thread.start()
                    thread.join()
                else:
                    run.step(0.1)
            assert run.result.outcome == "SUCCESS"
            assert np.isfinite(run.time)
            hashes.append(run.result.state_sha256)
    assert hashes[0] == hashes[1]
