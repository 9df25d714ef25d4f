"""Runs: how a tree file and options are combined."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import pytest

import bt_dualarm as bt
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.runtime.assembly import control_period
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.outcome import Ending, Outcome
from bt_dualarm.runtime.run import Run
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import TreeFile

FILE = """\
bt_dualarm: 1
name: two
world: {scene: empty, seed: 4, time_limit: 0.3}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.4]}
    tree:
      sequence:
        - wait: {seconds: 0.1}
        - spawn: {arm: arm2}
        - wait: {seconds: %s}
  arm2:
    robot: ur3
    base: {xyz: [1.5, 0, 0.4]}
    spawned: false
    tree: {wait: {seconds: 0.1}}
"""


@pytest.fixture(scope="module")
def registry() -> Registry:
    return Registry.load()


def loaded(folder: Path, registry: Registry, seconds: float) -> TreeFile:
    path = folder / "two.yaml"
    path.write_text(FILE % seconds)
    return load_tree_file(path, registry.kinds)


def test_arms_are_spawned_in_the_order_of_the_file() -> None:
    """`--dry-run` named another one of two arms that overlap each time."""
    arms = {
        name: {"robot": "ur3", "base": {"xyz": [i, 0, 0]}, "spawned": i == 0, "tree": {"wait": 1}}
        for i, name in enumerate("gecafdb")
    }
    with bt.open({"bt_dualarm": 1, "world": {"scene": "empty"}, "arms": arms}) as run:
        run.spawn_all()
        assert list(run.world.arms) == list(arms)


def test_an_arm_spawned_by_a_leaf_runs_its_own_tree(tmp_path: Path, registry: Registry) -> None:
    with Run(loaded(tmp_path, registry, 0.1), registry) as opened:
        result = opened.finish()
    assert result.outcome is Outcome.SUCCESS
    first, second = result.arms.values()
    assert second.runs[0].started_s == pytest.approx(first.runs[1].ended_s, abs=0.021)
    assert second.ended_s == pytest.approx(0.22, abs=0.021)


@pytest.mark.parametrize(
    ("duration", "ending", "ends_s"),
    [(None, Ending.TIME_LIMIT, 0.3), (0.2, Ending.DURATION, 0.2), (9.0, Ending.TIME_LIMIT, 0.3)],
)
def test_the_earlier_of_two_limits_counts(
    duration: float | None, ending: Ending, ends_s: float, tmp_path: Path, registry: Registry
) -> None:
    file = loaded(tmp_path, registry, 60.0)
    with Run(file, registry, RunOptions(duration=duration)) as opened:
        result = opened.finish()
    assert result.ending is ending
    assert result.sim_time_s == pytest.approx(ends_s, abs=0.05), "with the time to come to rest"
    assert result.at_rest


def test_the_seed_of_the_command_line_counts(tmp_path: Path, registry: Registry) -> None:
    file = loaded(tmp_path, registry, 1.0)
    for options, seed in ((None, 4), (RunOptions(seed=0), 0)):
        with Run(file, registry, options) as opened:
            assert opened.seed == seed


@pytest.mark.parametrize(
    ("timestep", "period"),
    [
        (0.002, Fraction(1, 250)),
        (0.001, Fraction(1, 250)),
        (0.0005, Fraction(1, 250)),
        (0.0015, Fraction(3, 1000)),
        (0.004, Fraction(1, 250)),
    ],
)
def test_set_points_come_250_times_a_second_or_somewhat_more_often(
    timestep: float, period: Fraction
) -> None:
    assert control_period(timestep) == period
