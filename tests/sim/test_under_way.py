"""Images in transit are limited in memory, for any camera declaration."""

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
def test_latency_is_refused_exactly_if_its_images_do_not_fit(
    size: tuple[int, int], fps: float, latency: float
) -> None:
    """The latency that the message allows is accepted."""
    in_transit_mb = latency * fps * size[0] * size[1] * 3e-6
    try:
        CameraSpec(resolution=size, fps=fps, latency=latency)
    except ValidationError as error:
        assert in_transit_mb > MOST_UNDER_WAY_MB
        (detail,) = error.errors()
        assert detail["loc"] == ("latency",)
        allowed = re.search(r"here (\d+) ms", detail["msg"])
        assert allowed
        CameraSpec(resolution=size, fps=fps, latency=int(allowed[1]) * 1e-3)
    else:
        assert in_transit_mb <= MOST_UNDER_WAY_MB


@pytest.mark.parametrize("fps", [30.0, 333.0, 1000.0])
def test_number_of_kept_images_agrees_with_the_check(fps: float) -> None:
    """At most one more is kept: the current image."""
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


def test_check_reports_location_and_allowed_latency(tmp_path: Path) -> None:
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
    detail, allowed = str(problem).splitlines()[0].split("; ")
    assert detail.endswith(
        "fast.yaml:5:34: error: latency: 10 s at 1000 Hz keep 10000 images of 320 x 240 px "
        "in transit, 2304 MB"
    )
    assert allowed == "at most 100 MB: here 434 ms"
