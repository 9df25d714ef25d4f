from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st

from bt_dualarm.grasping.candidates import (
    CLEAR,
    antipodal_pairs,
    finger_points,
    jaw_grasps,
    least_width,
)
from bt_dualarm.grasping.grasp import (
    JawMeasures,
    Load,
    MeshSolid,
    Solid,
    held,
    pinching_force,
    solid_of,
)
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.spec.document import ObjectSpec
from tests.grasping.families import JAW, JAWS, hulls, loads, mesh_box, primitives

FEW = settings(
    max_examples=8,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
    phases=[Phase.explicit, Phase.reuse, Phase.generate],  # shrinking takes minutes
)
SHAPES = st.one_of(primitives(), primitives(), hulls())


def _pads(jaw: JawMeasures, opening: float) -> np.ndarray:
    """Points on both pads, of shape (n, 3), m, in the tool frame."""
    x, z = np.meshgrid(
        np.linspace(-0.5, 0.5, 9) * jaw.pad_width,
        np.linspace(-0.5, 0.5, 9) * jaw.pad_length + jaw.pad_center,
    )
    one = np.column_stack((x.ravel(), np.full(x.size, 0.5 * opening), z.ravel()))
    return np.vstack((one, one * [1, -1, 1]))


@FEW
@given(SHAPES, JAWS, loads())
def test_open_fingers_are_clear_and_closed_pads_touch(
    solid: Solid, jaw: JawMeasures, load: Load
) -> None:
    """Open fingers and the palm are outside the solid; at the grasp's width the pads touch it."""
    for grasp in jaw_grasps(solid, jaw, load, 0.8)[::7]:
        fingers = grasp.tool.apply(finger_points(jaw, jaw.widest_opening))
        assert solid.distance(fingers).min() >= 0.9 * CLEAR
        approach = grasp.tool.rotation_matrix[:, 2]
        assert solid.reach(-approach) <= jaw.palm - approach @ grasp.tool.position - CLEAR + 1e-9
        gap = solid.distance(grasp.tool.apply(_pads(jaw, grasp.width)))
        apart = (
            0.5 * math.hypot(jaw.pad_width, jaw.pad_length) / 6
        )  # largest distance of a spot from the points
        assert -apart <= gap.min() <= apart + 1e-4


@FEW
@given(SHAPES, JAWS, loads())
def test_solid_that_fits_between_the_fingers_has_a_grasp(
    solid: Solid, jaw: JawMeasures, load: Load
) -> None:
    """Grasps have the force that bears the load, and those that need least come first."""
    assume(least_width(solid) <= jaw.widest_opening - 2 * CLEAR - 1e-6)
    found = jaw_grasps(solid, jaw, load, 0.8)
    assert found
    forces = [grasp.force for grasp in found]
    assert forces == sorted(forces)
    assert all(grasp.margin == pytest.approx(jaw.most_force / grasp.force) for grasp in found)
    assert all(jaw.least_opening < grasp.width <= jaw.widest_opening for grasp in found)


@FEW
@given(primitives(), loads())
def test_same_seed_gives_the_same_grasps(solid: Solid, load: Load) -> None:
    once = jaw_grasps(solid, JAW, load, 0.8)
    again = jaw_grasps(solid, JAW, load, 0.8)
    assert [g.force for g in once] == [g.force for g in again]
    assert all(
        np.array_equal(a.tool.matrix, b.tool.matrix) for a, b in zip(once, again, strict=True)
    )


def test_solid_that_is_too_wide_has_no_grasp() -> None:
    load = Load(0.2, np.array([0.0, 0.0, -9.81]), 8.0, np.zeros(3))
    wide = solid_of("box", (0.09, 0.09, 0.09))
    assert least_width(wide) == pytest.approx(0.09)
    assert jaw_grasps(wide, JAW, load, 0.8) == ()
    plate = solid_of("box", (0.2, 0.2, 0.02))
    assert least_width(plate) == pytest.approx(0.02)
    assert all(grasp.width == pytest.approx(0.02) for grasp in jaw_grasps(plate, JAW, load, 0.8))


def test_solid_that_is_too_heavy_has_no_grasp() -> None:
    cube = solid_of("box", (0.05, 0.05, 0.05))
    heavy = Load(40.0, np.array([0.0, 0.0, -9.81]), 8.0, np.zeros(3))
    assert jaw_grasps(cube, JAW, heavy, 0.8) == ()


def test_force_for_a_point_mass_agrees_with_statics() -> None:
    """At rest between two pads, each bears m g / 2 by friction: N = m g / (2 μ)."""
    down = np.array([0.0, 0.0, -9.81])
    load = Load(1.0, down, 0.0, np.zeros(3))
    y = np.array([0.0, 1.0, 0.0])
    force = pinching_force(load, np.zeros(3), y, 0.05, 0.008, 0.8)
    assert force == pytest.approx(9.81 / 1.6)
    beside = replace(load, center=np.array([0.02, 0.0, 0.0]))  # a moment about the pads' line
    turned = pinching_force(beside, np.zeros(3), y, 0.05, 0.008, 0.8)
    assert turned == pytest.approx(math.hypot(9.81 / 2, 9.81 * 0.02 / 2 / 0.008) / 0.8)
    across = replace(load, center=np.array([0.0, 0.02, 0.0]))
    tipped = pinching_force(across, np.zeros(3), y, 0.05, 0.008, 0.8)
    assert tipped == pytest.approx((9.81 / 2 + 9.81 * 0.02 / 0.05) / 0.8)
    lying = replace(load, gravity=np.array([0.0, -9.81, 0.0]))  # along the line: half on each
    assert pinching_force(lying, np.zeros(3), y, 0.05, 0.008, 0.8) == pytest.approx(9.81 / 2)
    assert pinching_force(load, np.zeros(3), y, 0.05, 0.008, 0.0) == math.inf
    assert pinching_force(beside, np.zeros(3), y, 0.05, 0.0, 0.8) == math.inf


@FEW
@given(primitives(), loads(), st.floats(1.1, 4.0))
def test_force_is_proportional_to_the_load(solid: Solid, load: Load, factor: float) -> None:
    light = jaw_grasps(solid, JAW, load, 0.8)
    heavy = jaw_grasps(solid, JAW, replace(load, mass=factor * load.mass), 0.8)
    if heavy:
        assert heavy[0].force == pytest.approx(factor * light[0].force)


def test_pad_touches_a_sphere_where_it_is_widest() -> None:
    """The pad's center may be elsewhere; a pad too small to reach that point touches a slope."""
    y = np.array([0.0, 1.0, 0.0])
    z = np.array([0.0, 0.0, 1.0])
    ball = solid_of("sphere", (0.03,))
    met = held(ball, np.array([0.0, 0.0, 0.01]), y, z, np.array([0.03, 0.02]))
    assert met is not None
    assert met.width == pytest.approx(0.06, abs=1e-4)
    assert met.tilt < 0.1
    beside = held(ball, np.array([0.0, 0.0, 0.01]), y, z, np.array([0.002, 0.002]))
    assert beside is not None
    assert beside.tilt == pytest.approx(math.asin(1 / 3), abs=0.04)
    assert held(ball, np.array([0.0, 0.0, 0.05]), y, z, np.array([0.03, 0.02])) is None


def test_mesh_of_a_box_is_grasped_like_the_box() -> None:
    load = Load(0.5, np.array([0.0, 0.0, -9.81]), 8.0, np.zeros(3))
    mesh = jaw_grasps(mesh_box(0.025), JAW, load, 0.8, seed=3)
    box = jaw_grasps(solid_of("box", (0.05, 0.05, 0.05)), JAW, load, 0.8)
    assert mesh[0].width == pytest.approx(box[0].width, abs=1e-6)
    assert mesh[0].force == pytest.approx(box[0].force, rel=0.1)


@pytest.mark.parametrize("x", [-0.15, -0.05, 0.0, 0.25])
def test_long_mesh_can_be_grasped_at_any_point(x: float) -> None:
    """Sampled lines passed up to 58 mm beside the point of a bar of 0.6 m."""
    point = np.array((x, 0.0, 0.0))
    corners = np.array(list(itertools.product((-0.3, 0.3), (-0.02, 0.02), (-0.02, 0.02))))
    bar = MeshSolid.hull_of(corners)
    load = Load(0.1, np.array((0.0, 0.0, -9.81)), 0.0, point)
    grasps = jaw_grasps(bar, JAW, load, 0.8, point=point)
    closings = [(point - one.tool.position, one.tool.rotation_matrix[:, 1]) for one in grasps]
    off = [float(np.linalg.norm(np.cross(offset, axis))) for offset, axis in closings]
    assert min(off) <= abs(JAW.pad_center) + 1e-9


def test_antipodal_pairs_of_an_unknown_type_are_an_error() -> None:
    with pytest.raises(TypeError, match="no antipodal pairs are known for a str"):
        next(antipodal_pairs("banana", np.zeros(3), np.random.default_rng(0)))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("shape", "size"),
    [("tray", (0.20, 0.15, 0.03)), ("bin", (0.09, 0.07, 0.06)), ("tube", (0.02, 0.05))],
)
def test_fingers_do_not_close_on_an_opening(shape: str, size: tuple[float, ...]) -> None:
    """The bounding box of a tray has six sides, the tray only five."""
    obj = ObjectSpec(shape=shape, size=size, wall=0.003, mass=0.05)  # type: ignore[arg-type]
    load = Load(0.05, np.array([0.0, -9.81, 0.0]), 0.0, np.zeros(3))
    found = jaw_grasps(body_of(obj).solid, JAW, load, 0.8)
    assert found
    solid = body_of(obj).solid
    for one in (one for one in found if one.width > 0.01):  # the others grasp a single wall
        for side in (-0.5, 0.5):
            pad = one.tool.apply(np.array([[0.0, side * one.width, JAW.pad_center]]))
            assert float(solid.distance(pad)[0]) < 0.5 * JAW.pad_length


@pytest.mark.parametrize("height", [0.02, 0.03, 0.06])
def test_fingertips_stay_above_a_thin_floor(height: float) -> None:
    """Points on both sides of a floor of 3 mm count: those of one side let fingertips into it."""
    obj = ObjectSpec(shape="bin", size=(0.16, 0.12, height), mass=0.1)
    load = Load(0.1, np.array([0.0, 0.0, -9.81]), 8.0, np.zeros(3))
    tips = [
        float(one.tool.apply(np.array([0.0, 0.0, JAW.tip]))[2])
        for one in jaw_grasps(body_of(obj).solid, JAW, load, 0.8)
        if one.tool.rotation_matrix[2, 2] < -0.999  # straight down, over a wall
    ]
    assert min(tips) > 0.003 - 0.5 * height - 2e-4
