"""Reality in tree files: valid settings, and the errors that result for each arm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.core.errors import RunError
from bt_dualarm.runtime.options import checked_reality
from bt_dualarm.spec.document import (
    REALITY_NAMES,
    REALITY_SETS,
    RealityErrors,
    RealitySpec,
    resolved,
)
from bt_dualarm.spec.problems import SpecError
from bt_dualarm.spec.values import Uncertainty

FILE = """\
bt_dualarm: 1
world: {{scene: empty, reality: {world}}}
arms:
  arm1: {{robot: ur5, reality: {arm}, tree: succeed}}
  arm2: {{robot: ur5, base: {{xyz: [2, 0, 0]}}, tree: succeed}}
"""


def errors_of(world: str, arm: str = "ideal") -> tuple[RealityErrors, RealityErrors]:
    """Errors of an arm with a reality of its own, and of one without."""
    file = load_tree_file(FILE.format(world=world, arm=arm), folder=Path())
    one, other = (
        resolved(file.world.reality, each.reality, REALITY_SETS) for each in file.arms.values()
    )
    return one, other


def complaint(reality: str) -> str:
    with pytest.raises(SpecError) as caught:
        load_tree_file(FILE.format(world=reality, arm="ideal"), folder=Path())
    return str(caught.value)


@pytest.mark.parametrize("name", REALITY_NAMES)
def test_the_set_of_the_world_is_for_arms_without_one(name: str) -> None:
    assert errors_of(name) == (REALITY_SETS["ideal"], REALITY_SETS[name])


def test_fields_not_given_are_those_of_the_set() -> None:
    one, other = errors_of("lab", "{set: rough, drive: {delay: 2 ms}}")
    assert other == REALITY_SETS["lab"]
    assert one.drive.delay == 0.002
    assert one.drive.bandwidth == REALITY_SETS["rough"].drive.bandwidth
    assert one.links == REALITY_SETS["rough"].links


def test_an_arm_without_a_set_changes_fields_of_the_world() -> None:
    one, _ = errors_of("{set: lab, encoder: {noise: 0.01}}", "{friction: {present: false}}")
    assert not one.friction.present
    assert one.encoder.noise == 0.01
    assert one.links == REALITY_SETS["lab"].links


def test_a_number_is_uniform_and_a_mapping_names_the_distribution() -> None:
    one, _ = errors_of("ideal", "{links: {mass: 0.1, inertia: {normal: 0.02}}}")
    assert one.links.mass == Uncertainty(uniform=0.1)
    assert one.links.inertia == Uncertainty(normal=0.02)


@pytest.mark.parametrize(
    ("reality", "words"),
    [
        ("labb", "lab"),
        ("{drive: {dealy: 1 ms}}", "delay"),
        ("{drive: {delay: 100 ms}}", "at most 0.05"),
        ("{links: {mass: 1.5}}", "at most 0.9"),
        ("{links: {mass: {normal: 0.5}}}", "at most 0.9"),
        ("{links: {mass: {uniform: 0.1, normal: 0.1}}}", "not both"),
        ("{links: {mass: -0.1}}", "at least 0"),
        ("{camera: {rotation: 30}}", "at most 20 deg"),
    ],
)
def test_invalid_settings_are_refused_at_their_line(reality: str, words: str) -> None:
    message = complaint(reality)
    assert ":2:" in message
    assert words in message


@pytest.mark.parametrize(
    "spread", [Uncertainty(), Uncertainty(uniform=0.2), Uncertainty(normal=0.2)]
)
def test_one_sample_equals_the_first_of_several(spread: Uncertainty) -> None:
    one = np.random.default_rng(7)
    several = np.random.default_rng(7)
    for _ in range(500):
        assert spread.draw_one(one) == spread.draw(several, 1)[0]


@pytest.mark.parametrize("spread", [Uncertainty(uniform=0.2), Uncertainty(normal=0.2)])
def test_samples_are_centered_and_bounded(spread: Uncertainty) -> None:
    samples = spread.draw(np.random.default_rng(0), 20_000)
    assert abs(samples.mean()) < 0.005
    assert 0.95 * spread.most < np.abs(samples).max() <= spread.most
    deviation = 0.2 / np.sqrt(3) if spread.uniform else 0.2
    assert samples.std() == pytest.approx(deviation, rel=0.03)


def test_each_set_is_farther_from_the_model_than_the_one_before() -> None:
    """Numbers of the sets may change, but rough must stay rougher than lab."""
    lab, rough = (REALITY_SETS[name] for name in ("lab", "rough"))
    assert REALITY_SETS["ideal"] == RealityErrors()
    for group in RealityErrors.model_fields:
        for name in type(getattr(lab, group)).model_fields:
            less, more = (getattr(getattr(one, group), name) for one in (lab, rough))
            if isinstance(less, Uncertainty):
                assert 0 < less.most <= more.most, name
    assert 0 < lab.drive.delay < rough.drive.delay
    assert lab.drive.bandwidth > rough.drive.bandwidth > 0


def test_a_reality_from_python_is_checked() -> None:
    assert checked_reality("lab") == "lab"
    assert checked_reality({"set": "lab"}) == RealitySpec(set="lab")
    with pytest.raises(RunError, match="no reality 'lob'; did you mean 'lab'"):
        checked_reality("lob")
    with pytest.raises(RunError, match=r"reality\.drive\.delay.*at most 0\.05"):
        checked_reality({"drive": {"delay": 1.0}})
    with pytest.raises(RunError, match="not int"):
        checked_reality(3)
