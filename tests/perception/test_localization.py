from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull, Delaunay

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.perception.detection import Detection
from bt_dualarm.perception.localization import (
    PIXEL_SIGMA,
    FacingCubeLocalizer,
    LocalizationError,
    PlaneLocalizer,
    PlaneOfSizeLocalizer,
    SizeLocalizer,
)
from bt_dualarm.sim.frame import Frame

FOV_RAD = math.radians(50.0)
SIDE_M = 0.05


def frame_from(pose: Pose) -> Frame:
    return Frame(2.0, np.zeros((240, 320, 3), np.uint8), pose, FOV_RAD, (0, 0, 320, 240))


def seen(frame: Frame, point: Vector, touches_border: bool = False) -> Detection:
    """A face of SIDE_M at ``point``, square to the camera, as that camera would see it."""
    x, y, depth = frame.pose.inverse.apply(point)
    scale = frame.focal_px / depth
    pixel = (160.0 + scale * x, 120.0 + scale * y)
    area = (scale * SIDE_M) ** 2
    return Detection(
        2.0, (pixel[0] / 160 - 1, pixel[1] / 120 - 1), pixel, area, math.sqrt(area) / 240,
        (0, 0, 0, 0), 1.0, touches_border,
    )  # fmt: skip


poses = st.builds(
    lambda x, y, z, roll, pitch, yaw: Pose.from_rpy((x, y, z), (roll, pitch, yaw)),
    *[st.floats(-1.0, 1.0)] * 3,
    *[st.floats(-3.0, 3.0)] * 3,
)
ahead = st.builds(
    lambda x, y, z: np.array([x, y, z]),
    st.floats(-0.1, 0.1),
    st.floats(-0.1, 0.1),
    st.floats(0.2, 1.0),
)


@given(pose=poses, local=ahead, tilt=st.floats(-0.7, 0.7))
def test_a_point_on_the_plane_is_found_again(pose: Pose, local: Vector, tilt: float) -> None:
    """Localizing is the inverse of the projection, for any camera and any plane it can see."""
    frame = frame_from(pose)
    point = pose.apply(local)
    normal = pose.rotation.apply((0.0, math.sin(tilt), math.cos(tilt)))
    sighting = PlaneLocalizer(point, normal).locate(seen(frame, point), frame)
    assert sighting.stamp == 2.0
    assert sighting.point == pytest.approx(point, abs=1e-9)
    assert sighting.side == pytest.approx(SIDE_M, rel=1e-9)


@given(poses)
def test_right_is_the_unit_x_axis_of_the_camera(pose: Pose) -> None:
    right = frame_from(pose).right
    assert right == pytest.approx(pose.rotation_matrix[:, 0], abs=1e-12)
    assert right @ right == pytest.approx(1.0, abs=1e-12)


@given(pose=poses, local=ahead)
def test_a_known_size_determines_the_depth(pose: Pose, local: Vector) -> None:
    frame = frame_from(pose)
    point = pose.apply(local)
    sighting = SizeLocalizer(SIDE_M).locate(seen(frame, point), frame)
    assert sighting.point == pytest.approx(point, abs=1e-9)


@given(pose=poses, across=st.floats(-0.04, 0.04), depth=st.floats(0.2, 0.8))
def test_a_cube_that_faces_the_camera_is_located_at_any_depth(
    pose: Pose, across: float, depth: float
) -> None:
    """Off the camera's axis, its outline includes a flank."""
    frame = frame_from(pose)
    normal = pose.turn(np.array((0.0, 0.0, 1.0)))
    point = pose.apply(np.array((across, 0.0, depth)))
    localizer = FacingCubeLocalizer(normal, SIDE_M)
    corners = frame.world_in_camera.apply(localizer.corners(point, frame))
    pixels = frame.focal_px * corners[:, :2] / corners[:, 2:] + (160.0, 120.0)
    hull = ConvexHull(pixels)
    triangles = Delaunay(pixels[hull.vertices])
    parts = pixels[hull.vertices][triangles.simplices]
    sides = parts[:, 1:] - parts[:, :1]
    areas = 0.5 * np.abs(np.linalg.det(sides))
    middle = areas @ parts.mean(axis=1) / areas.sum()
    relative = (middle[0] / 160 - 1, middle[1] / 120 - 1)
    box = (*np.floor(pixels.min(axis=0)), *np.ceil(pixels.max(axis=0)))
    area = float(areas.sum())
    outline = Detection(2.0, relative, tuple(middle), area, math.sqrt(area) / 240, box, 1.0, False)
    found = localizer.locate(outline, frame).point
    assert found == pytest.approx(point, abs=2e-3)
    assert localizer.doubt(point, frame) < 0.2


@pytest.mark.parametrize("edge", ["bottom", "right"])
@pytest.mark.parametrize("share", [0.05, 0.2, 0.5, 0.9])
def test_a_target_cut_off_by_the_image_is_not_located_farther_away(edge: str, share: float) -> None:
    """A strip shows the target's full width: the depth is right, with an uncertainty of 30 %."""
    frame = frame_from(Pose.identity())
    edge_px = frame.focal_px * SIDE_M / 0.4
    wide, high = (edge_px, share * edge_px) if edge == "bottom" else (share * edge_px, edge_px)
    right, bottom = (180, 240) if edge == "bottom" else (320, 130)
    box = (round(right - wide), round(bottom - high), right, bottom)
    middle = ((box[0] + box[2]) / 2, (box[1] + box[3]) / 2)
    area = (box[2] - box[0]) * (box[3] - box[1])
    relative = (middle[0] / 160 - 1, middle[1] / 120 - 1)
    strip = Detection(2.0, relative, middle, area, math.sqrt(area) / 240, box, 1.0, True)
    sighting = SizeLocalizer(SIDE_M).locate(strip, frame)
    assert sighting.point[2] == pytest.approx(0.4, rel=0.03)
    assert sighting.sigma[2] == pytest.approx(0.3 * 0.4, rel=0.2)


def test_depth_is_the_least_certain() -> None:
    """Looking along +x at 0.35 m: pixel noise across, and its share of a side of 37 px along."""
    pose = Pose.from_rpy((0, 0, 0), (-math.pi / 2, 0, -math.pi / 2))
    frame = frame_from(pose)
    sigma = SizeLocalizer(SIDE_M).locate(seen(frame, np.array([0.35, 0.0, 0.0])), frame).sigma
    pixel = 0.35 / frame.focal_px
    assert sigma[1:] == pytest.approx(PIXEL_SIGMA * pixel)
    assert sigma[0] == pytest.approx(PIXEL_SIGMA * pixel * 0.35 / SIDE_M)


def test_a_plane_determines_the_position_along_its_normal() -> None:
    frame = frame_from(Pose.identity())
    point = np.array([0.0, 0.0, 0.5])
    sigma = PlaneLocalizer(point, np.array([0.0, 0.0, 1.0])).locate(seen(frame, point), frame).sigma
    assert sigma[2] < 0.2 * sigma[0]
    assert sigma[0] == pytest.approx(PIXEL_SIGMA * 0.5 / frame.focal_px)


def test_a_plane_without_intersection_is_refused() -> None:
    frame = frame_from(Pose.identity())
    target = seen(frame, np.array([0.0, 0.0, 0.5]))
    with pytest.raises(LocalizationError, match="along"):
        PlaneLocalizer(np.array([0.1, 0.0, 0.5]), np.array([1.0, 0.0, 0.0])).locate(target, frame)
    with pytest.raises(LocalizationError, match="behind"):
        PlaneLocalizer(np.array([0.0, 0.0, -0.5]), np.array([0.0, 0.0, 1.0])).locate(target, frame)


def test_the_depth_of_a_plane_is_averaged() -> None:
    """4 % of noise in the area changes the depth by 2 % in one image, much less in the mean."""
    frame = frame_from(Pose.identity())
    point = np.array([0.02, 0.0, 0.5])
    localizer = PlaneOfSizeLocalizer(np.array([0.0, 0.0, 1.0]), SIDE_M)
    rng = np.random.default_rng(3)
    depths = []
    for _ in range(90):
        exact = seen(frame, point)
        noisy = Detection(
            **{**vars(exact), "area_px": exact.area_px * (1.0 + rng.normal(0.0, 0.04))}
        )
        localizer.learn(noisy, frame)
        depths.append(localizer.locate(noisy, frame).point[2])
    assert np.std(depths[30:]) < 0.2 * 0.02 * 0.5
    assert np.mean(depths[30:]) == pytest.approx(0.5, rel=0.005)


def test_a_target_that_is_cut_off_does_not_change_the_plane() -> None:
    frame = frame_from(Pose.identity())
    point = np.array([0.0, 0.0, 0.5])
    localizer = PlaneOfSizeLocalizer(np.array([0.0, 0.0, 1.0]), SIDE_M)
    localizer.learn(seen(frame, point), frame)
    closer = seen(frame, np.array([0.0, 0.0, 0.3]), touches_border=True)
    localizer.learn(closer, frame)
    assert localizer.locate(closer, frame).point[2] == pytest.approx(0.5)


def test_locating_another_object_does_not_change_the_plane() -> None:
    """Candidates are located to be compared; only the target is learned from."""
    point = np.array([0.0, 0.0, 0.5])
    frame = frame_from(Pose.identity())
    localizer = PlaneOfSizeLocalizer(np.array([0.0, 0.0, 1.0]), SIDE_M)
    localizer.learn(seen(frame, point), frame)
    localizer.locate(seen(frame, np.array([0.05, 0.0, 1.5])), frame)
    assert localizer.locate(seen(frame, point), frame).point == pytest.approx(point, abs=1e-9)


def test_earlier_sightings_are_relocated_on_the_updated_plane() -> None:
    """A second image of equal weight moves the plane, and the first sighting, half way."""
    frame = frame_from(Pose.identity())
    point = np.array([0.04, -0.02, 0.5])
    localizer = PlaneOfSizeLocalizer(np.array([0.0, 0.0, 1.0]), SIDE_M)
    first = localizer.locate(seen(frame, point * 1.04), frame)
    assert not localizer.learn(seen(frame, point * 1.04), frame)
    assert localizer.learn(seen(frame, point), frame)
    again = localizer.relocate(first)
    assert again.point == pytest.approx(1.02 * point, rel=1e-3)
    assert again.side == pytest.approx(first.side * again.point[2] / first.point[2])
    assert not localizer.learn(seen(frame, again.point), frame)
