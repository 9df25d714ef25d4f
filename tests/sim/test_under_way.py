"""Pictures that were taken and not delivered yet: bounded in memory, whatever a file asks for."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from bt_dualarm.behaviors.load import check_file
from bt_dualarm.sim.camera import Camera
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import MOST_UNDER_WAY_MB, CameraSpec
from tests.sim.test_camera import Recorder, world

SIZES = st.tuples(st.integers(16, 1920), st.integers(16, 1920))


@settings(max_examples=200)
@given(SIZES, st.floats(0.1, 1000.0), st.floats(0.0, 10.0))
def test_what_is_accepted_fits_and_what_is_refused_does_not(
    size: tuple[int, int], fps: float, latency: float
) -> None:
    """What the refusal allows is accepted."""
    under_way_mb = latency * fps * size[0] * size[1] * 3e-6
    try:
        CameraSpec(resolution=size, fps=fps, latency=latency)
    except ValidationError as error:
        assert under_way_mb > MOST_UNDER_WAY_MB
        (said,) = error.errors()
        assert said["loc"] == ("latency",)
        allowed = re.search(r"here (\d+) ms", said["msg"])
        assert allowed
        CameraSpec(resolution=size, fps=fps, latency=int(allowed[1]) * 1e-3)
    else:
        assert under_way_mb <= MOST_UNDER_WAY_MB


@pytest.mark.parametrize("fps", [30.0, 333.0, 1000.0])
def test_no_more_is_kept_than_was_counted(fps: float) -> None:
    """One more at most: the picture of the moment itself."""
    spec = CameraSpec(resolution=(16, 16), fps=fps, latency=0.1)
    camera = Camera("arm/camera", spec, Recorder())
    seen = world()
    camera.subscribe(lambda _: None)
    most = 0
    for step in range(400):
        seen.data.time = step * 1e-3
        if camera.due(seen.data.time):
            camera.capture(seen)
        camera.deliver(seen.data.time)
        most = max(most, len(camera._pending))
    assert 0.9 * 0.1 * fps <= most <= 0.1 * fps + 1


def test_the_check_says_where_and_what_is_allowed(tmp_path: Path) -> None:
    file = tmp_path / "fast.yaml"
    file.write_text(
        "bt_dualarm: 1\n"
        "arms:\n"
        "  arm1:\n"
        "    robot: ur5\n"
        "    camera: {fps: 1000, latency: 10 s}\n"
        "    tree: {wait: 1}\n"
    )
    (problem,) = check_file(file, Registry.load().kinds)
    said, allowed = str(problem).splitlines()[0].split("; ")
    assert said.endswith(
        "fast.yaml:5:34: error: latency: 10 s at 1000 Hz keep 10000 images of 320 x 240 px "
        "in transit, 2304 MB"
    )
    assert allowed == "at most 100 MB: here 434 ms"
