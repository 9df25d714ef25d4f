"""Reset and rendering: a reset run equals a new run of its file; rendering does not change it."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.core.errors import RunError
from bt_dualarm.runtime.arm_runtime import IdleObserver

TREE = """\
bt_dualarm: 1
name: short
world: {scene: empty, reality: lab, time_limit: 20}
objects:
  cube:
    {shape: box, size: [0.05, 0.05, 0.05], mass: 1, color: red, pose: {xyz: [0.5, 0, 0.2]},
     fixed: true}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.4]}
    posture: present
    tree: {reach_to_pose: {offset: {xyz: [0, 0.03, 0]}}}
  arm2:
    robot: panda
    base: {xyz: [1.2, 0, 0], rpy: [0, 0, 180]}
    camera: {mount: wrist, resolution: [64, 48], fov: 90, noise: 2, latency: 0.1}
    tree: {wait: {seconds: 0.1}}
"""


@pytest.fixture(scope="module")
def fresh() -> dict[int, str]:
    """Hashes of new runs, by seed."""
    return {seed: bt.run(TREE, seed=seed).state_sha256 for seed in (3, 4)}


def test_a_reset_run_equals_a_new_run(fresh: dict[int, str]) -> None:
    """Whenever it is reset, with the given seed or else with its last one."""
    assert fresh[3] != fresh[4], "the seed matters"
    with bt.open(TREE, seed=4) as run:
        arm = run.arms["arm1"]
        tree = run.trees["arm1"]
        start = arm.q
        run.step(0.1)
        for seed in (3, None):
            run.reset(seed)
            assert (run.time, run.done, run.seed) == (0.0, False, 3)
            assert str(tree.status) == "INVALID"
            assert np.array_equal(arm.q, start), "handles show the new run"
            assert run.finish().state_sha256 == fresh[3]
            assert str(tree.status) == "SUCCESS"
        run.reset(4)
        run.stop()
        assert run.finish().ending is bt.Ending.STOPPED
        run.reset()
        assert run.finish().state_sha256 == fresh[4], "the stop was for the run before"


class Count(IdleObserver):
    """Counts steps."""

    steps = 0

    def after_step(self, time: float) -> None:
        self.steps += 1


def test_observers_stay_and_nothing_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    """Thousands of resets must not fill a log with runs that were cut short."""
    count = Count()
    with caplog.at_level(logging.WARNING), bt.open(TREE) as run:
        run.watch(count)
        run.step(0.1)
        assert run.arms["arm1"].v.any(), "it is cut short in motion"
        run.reset()
        run.step(0.1)
        assert count.steps == 100
        assert caplog.records == []


@pytest.mark.usefixtures("without_plots")
def test_an_impossible_reset_is_refused_with_its_reason(tmp_path: Path) -> None:
    with (
        bt.open(TREE, record=tmp_path / "out") as run,
        pytest.raises(RunError, match="a run with a record cannot be reset"),
    ):
        run.reset()
    with bt.open(TREE) as run:
        run.step(0.1)
        for seed in (-1, 2**32, 0.5, "3"):
            with pytest.raises(RunError, match=r"^seed: .* is not a whole number from 0"):
                run.reset(seed)  # type: ignore[arg-type]  # what a user may try
        assert run.time == pytest.approx(0.1), "a refused reset changes nothing"
    with pytest.raises(RunError, match="the run is closed"):
        run.reset()


def test_rendering_does_not_change_a_run(fresh: dict[int, str]) -> None:
    with bt.open(TREE, seed=3) as run:
        while not run.done:
            run.step(0.2)
            run.render("arm2")
            run.render(size=(32, 24))
        assert run.result.state_sha256 == fresh[3]


def red(image: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Columns and rows of red pixels, of shape (n, 2)."""
    colors = image.astype(int)
    rows, columns = np.nonzero(colors[..., 0] > 100 + np.maximum(colors[..., 1], colors[..., 2]))
    return np.column_stack([columns, rows])


def test_images_show_the_world() -> None:
    with bt.open(TREE) as run:
        assert run.render().shape == (480, 640, 3)
        assert run.render("arm2").shape == (48, 64, 3), "the size of the camera's images"
        assert run.render("arm2", size=(32, 16)).shape == (16, 32, 3)
        viewer = {"eye": [0.5, -1.0, 0.2], "look_at": [0.5, 0.0, 0.2], "size": (80, 60)}
        middle = red(run.render(**viewer))  # type: ignore[arg-type]  # as above
        # 0.05 m at 0.975 m through a lens of 45° on 60 rows: 3.7 pixels wide, in the middle.
        assert 9 <= len(middle) <= 20
        assert np.abs(middle.mean(axis=0) + 0.5 - [40, 30]).max() < 1.0
        wide = red(run.render(**viewer, fov=90))  # type: ignore[arg-type]  # as above
        assert 1 <= len(wide) < len(middle)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"camera": "arm22"}, "there is no camera 'arm22'; did you mean 'arm2'"),
        ({"camera": "arm1"}, "there is no camera 'arm1'"),
        ({"size": (0, 4)}, r"size: \(0, 4\) is not two whole numbers from 1 to 4096"),
        ({"size": 4}, "size: 4 is not two whole numbers"),
        ({"eye": [0, 1]}, r"eye: \[0, 1\] is not a point"),
        ({"eye": [0, 1, 2]}, "look_at: None is not a point"),
        ({"eye": [0, 0, 2], "look_at": [0, 0, 1]}, "straight above"),
        ({"eye": [0, 0, 2], "look_at": [1, 0, 1], "fov": 0}, "fov: 0 is not from 1 to 170"),
        ({"eye": [0, 0, 2], "look_at": [1, 0, 1], "fov": "wide"}, "fov: 'wide' is not from"),
        ({"camera": "arm2", "eye": [0, 0, 2]}, "give either a camera, or eye"),
    ],
)
def test_a_wrong_argument_is_named(given: dict[str, Any], message: str) -> None:
    with bt.open(TREE) as run, pytest.raises(RunError, match=message):
        run.render(**given)


def test_an_observer_without_its_methods_is_refused() -> None:
    with bt.open(TREE) as run, pytest.raises(RunError, match="watch: 5 is not an observer"):
        run.watch(5)  # type: ignore[arg-type]
