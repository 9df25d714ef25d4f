"""What a session makes of file and wishes."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import pytest

from bt_dualarm.registry import Registry
from bt_dualarm.run.assembly import control_period
from bt_dualarm.run.outcome import Ending, Outcome
from bt_dualarm.run.session import Session, Wishes
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.load import load_tree_file

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


def test_an_arm_spawned_by_a_leaf_runs_its_own_tree(tmp_path: Path, registry: Registry) -> None:
    with Session(loaded(tmp_path, registry, 0.1), registry) as session:
        result = session.run([], iter(range(100)).__next__)
    assert result.outcome is Outcome.SUCCESS
    first, second = result.arms
    assert second.leaves[0].started_s == pytest.approx(first.leaves[1].ended_s, abs=0.021)
    assert second.ended_s == pytest.approx(0.22, abs=0.021)


@pytest.mark.parametrize(
    ("duration", "ending", "ends_s"),
    [(None, Ending.TIME_LIMIT, 0.3), (0.2, Ending.DURATION, 0.2), (9.0, Ending.TIME_LIMIT, 0.3)],
)
def test_the_earlier_of_two_limits_counts(
    duration: float | None, ending: Ending, ends_s: float, tmp_path: Path, registry: Registry
) -> None:
    file = loaded(tmp_path, registry, 60.0)
    with Session(file, registry, Wishes(duration=duration)) as session:
        result = session.run([], iter(range(100)).__next__)
    assert result.ending is ending
    assert result.sim_time_s == pytest.approx(ends_s, abs=0.05), "with the time to come to rest"
    assert result.at_rest


def test_the_seed_of_the_command_line_counts(tmp_path: Path, registry: Registry) -> None:
    file = loaded(tmp_path, registry, 1.0)
    assert Session(file, registry).assembly.seed == 4
    assert Session(file, registry, Wishes(seed=0)).assembly.seed == 0


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
def test_set_points_come_250_times_a_second_or_a_little_more_often(
    timestep: float, period: Fraction
) -> None:
    assert control_period(timestep) == period
