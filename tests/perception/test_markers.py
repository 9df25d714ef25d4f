"""Markers in images of both renderers: found by number, and located by the square's edges."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.core.errors import RendererError
from bt_dualarm.core.pose import Pose
from bt_dualarm.perception.known_shape import KnownShape
from bt_dualarm.perception.scan import MarkerFitter, SquareCorners, markers_in
from bt_dualarm.sim.camera import Camera
from bt_dualarm.sim.composition import black_parts, marker_height
from bt_dualarm.sim.frame import RendererKind
from bt_dualarm.sim.renderers import choose_renderer
from bt_dualarm.spec.document import CameraSpec, ObjectSpec
from bt_dualarm.spec.values import BITS, MarkerSpec
from tests.families import some

ABOVE = Pose.from_rpy((0.36, -0.48, 0.72), (np.pi, 0, 0))


def file(dictionary: str, **marker: Any) -> dict[str, Any]:
    """A gray block with a marker on the table, below a camera that is fixed in the world."""
    block = {"shape": "box", "size": [0.08, 0.08, 0.04], "mass": 0.1, "color": "gray"}
    block["marker"] = {"dictionary": dictionary, "id": 7, "size": 0.05, **marker}
    block["pose"] = {"xyz": [0.35, -0.5, 0.42], "rpy": [0, 0, 25]}
    mount = {"xyz": ABOVE.position.tolist(), "rpy": [180, 0, 0]}
    arm = {"robot": "ur3", "base": {"xyz": [-1, 0, 0.4]}, "camera": {"mount": mount}}
    return {
        "bt_dualarm": 1,
        "name": "markers",
        "world": {"scene": "table", "time_limit": 1},
        "objects": {"block": block},
        "arms": {"arm1": {**arm, "tree": {"wait": {"seconds": 0.1}}}},
    }


@pytest.mark.parametrize(
    ("kind", "dictionary"), [*product(["ray"], BITS), *product(["gl"], some(BITS, 5))]
)
def test_a_marker_is_found_by_its_number(kind: RendererKind, dictionary: str) -> None:
    """One image from 0.3 m locates it within 2 % of the depth and 3°; no other number is found."""
    try:
        renderer = choose_renderer(kind).create()
    except RendererError as error:
        pytest.skip(str(error))
    with bt.open(file(dictionary), renderer="ray") as run:
        frame = Camera("arm1/camera", CameraSpec(), renderer).capture(run.world)
        obj = run.world.objects["block"]
        truth = run.world.object_pose("block")
    renderer.close()
    marker = obj.marker
    assert marker is not None
    (view,) = markers_in(frame, marker)
    assert markers_in(frame, MarkerSpec(dictionary=marker.dictionary, id=8, size=0.05)) == []
    best = MarkerFitter(SquareCorners("box", (0.05,)), flat=True).first(view)[0]
    pose = best.about(np.array((0.0, 0.0, -marker_height(obj)))).pose
    assert pose.distance(truth) < 0.006
    assert np.degrees(pose.angle(truth)) < 3.0


@pytest.mark.parametrize("dictionary", BITS)
def test_black_parts_stay_within_the_square(dictionary: str) -> None:
    """They cover at least its border, which has more than a third of a marker's cells."""
    marker = MarkerSpec.model_validate({"dictionary": dictionary, "id": 3, "size": 0.04})
    parts = np.array(list(black_parts(marker)))
    assert (np.abs(parts[:, :2]) + parts[:, 2:] / 2 <= 0.02 + 1e-12).all()
    covered = float((parts[:, 2] * parts[:, 3]).sum())
    border = 4 * (marker.cells - 1) / marker.cells**2
    assert border < covered / 0.04**2 < 1.0


def test_a_marker_has_no_mass_and_no_contacts() -> None:
    with bt.open(file("aruco_4x4_50"), renderer="ray") as run:
        model = run.world.model
        body = model.body("block")
        geoms = np.flatnonzero(model.geom_bodyid == body.id)
        assert len(geoms) > 5
        assert float(body.mass[0]) == pytest.approx(0.1)
        solid = (model.geom_contype[geoms] != 0) | (model.geom_conaffinity[geoms] != 0)
        assert [model.geom(geom).name for geom in geoms[solid]] == ["block"]


@pytest.mark.parametrize(
    ("shape", "size", "reason"),
    [
        ("sphere", [0.05], "no face for a marker"),
        ("box", [0.05, 0.08, 0.05], "its top has 50.0 mm"),
        ("cylinder", [0.04, 0.05], "its top has 56.6 mm"),
    ],
)
def test_a_marker_needs_room(shape: str, size: list[float], reason: str) -> None:
    """A marker of 45 mm takes 60 mm with its white margin."""
    marker = MarkerSpec(id=1, size=0.045)
    with pytest.raises(ValueError, match=reason):
        ObjectSpec(shape=shape, size=tuple(size), mass=0.1, marker=marker)  # type: ignore[arg-type]  # one of the three


def test_no_two_rotations_of_a_marker_look_alike() -> None:
    square: KnownShape = SquareCorners("box", (0.05,))
    turned = Pose.from_rpy((0, 0, 0), (0, 0, np.pi / 2))
    assert square.canonical(turned) is turned
    assert square.angle(Pose.identity(), turned) == pytest.approx(np.pi / 2)
