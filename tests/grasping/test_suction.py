from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings

from bt_dualarm.grasping.candidates import cup_grasps
from bt_dualarm.grasping.grasp import (
    CupMeasures,
    Load,
    Solid,
    solid_of,
    suction_force,
    suction_forces,
)
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.spec.document import ObjectSpec
from tests.grasping.families import CUP, loads, primitives

DOWN = np.array([0.0, 0.0, -9.81])
UP = np.array([0.0, 0.0, 1.0])


@settings(
    max_examples=8,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
    phases=[Phase.generate],
)
@given(primitives(), loads())
def test_cup_is_perpendicular_to_the_surface(solid: Solid, load: Load) -> None:
    """The tool is on the surface, and its force is within the cup's limit."""
    for grasp in cup_grasps(solid, CUP, load)[::5]:
        place = grasp.tool.position
        into = grasp.tool.rotation_matrix[:, 2]
        assert abs(float(solid.distance(place[None])[0])) < 1e-6
        assert float(solid.distance((place - 0.01 * into)[None])[0]) == pytest.approx(0.01)
        assert grasp.force <= CUP.most_force


def test_cup_seals_only_on_faces_larger_than_its_rim() -> None:
    load = Load(0.2, DOWN, 8.0, np.zeros(3))
    assert len(cup_grasps(solid_of("box", (0.05, 0.05, 0.05)), CUP, load)) == 6 * 4
    flat = cup_grasps(solid_of("box", (0.05, 0.05, 0.02)), CUP, load)
    assert len(flat) == 2 * 4
    assert cup_grasps(solid_of("box", (0.03, 0.03, 0.03)), CUP, load) == ()
    assert cup_grasps(solid_of("sphere", (0.015,)), CUP, load) == ()


STIFF = CupMeasures(radius=0.02, bends=1e-3, most_force=60.0, friction=0.5)
"""A cup that adapts to less than the thickness of a container's floor."""


@pytest.mark.parametrize(
    ("shape", "size", "has_floor"),
    [
        ("bin", (0.12, 0.10, 0.06), True),
        ("tray", (0.20, 0.15, 0.03), True),
        ("cup", (0.06, 0.05), True),
        ("tube", (0.06, 0.05), False),
    ],
)
def test_opening_is_not_grasped(shape: str, size: tuple[float, ...], has_floor: bool) -> None:
    """From above, the cup is placed on the floor inside, if there is one."""
    obj = ObjectSpec(shape=shape, size=size, wall=0.003, mass=0.2)  # type: ignore[arg-type]
    load = Load(0.2, DOWN, 8.0, np.zeros(3))
    found = cup_grasps(body_of(obj).solid, STIFF, load)
    above = [one for one in found if one.tool.rotation_matrix[2, 2] < -0.9]
    heights = {round(float(one.tool.position[2]), 4) for one in above}
    assert heights == ({round(0.003 - 0.5 * size[-1], 4)} if has_floor else set())


def test_floor_below_a_narrow_opening_is_out_of_reach() -> None:
    """The wrist behind the cup does not fit."""
    obj = ObjectSpec(shape="cup", size=(0.03, 0.12), wall=0.003, mass=0.2)
    found = cup_grasps(body_of(obj).solid, STIFF, Load(0.2, DOWN, 8.0, np.zeros(3)))
    assert not [one for one in found if one.tool.rotation_matrix[2, 2] < -0.9]


@pytest.mark.parametrize("sides", [4, 5, 6])
def test_a_face_little_wider_than_the_cup_is_found(sides: int) -> None:
    """Sampled spots of a prism's face were all too near to its edge: there was no grasp."""
    inner = 0.022  # of the circle within the face
    size = (inner / math.cos(math.pi / sides), 0.08)
    prism = body_of(ObjectSpec(shape="prism", size=size, sides=sides, mass=0.2))
    found = cup_grasps(prism.solid, STIFF, Load(0.2, DOWN, 8.0, np.zeros(3)))
    tops = [one for one in found if one.tool.position[2] > 0.039]
    assert tops
    assert all(float(np.linalg.norm(one.tool.position[:2])) < 2e-3 for one in tops)


def test_a_long_tube_reaches_deeper_between_walls() -> None:
    """A cup of 20 mm radius at the end of a tube of 0.13 m reaches the floor of a bin of 0.1 m."""
    size = (0.12, 0.10, 0.10)
    spec = ObjectSpec(shape="bin", size=size, mass=0.2)
    load = Load(0.2, DOWN, 8.0, np.zeros(3))
    slender = replace(STIFF, length=0.14)

    def on_floor(cup: CupMeasures) -> int:
        found = cup_grasps(body_of(spec).solid, cup, load)
        axes = [(one.tool.position[2], one.tool.rotation_matrix[2, 2]) for one in found]
        return sum(z < 0.0 and down < -0.9 for z, down in axes)

    assert on_floor(STIFF) == 0
    assert on_floor(slender) > 0


def test_cup_seals_on_curvature_within_the_bend_of_its_rim() -> None:
    """A ball of radius r recedes by r - sqrt(r² - c²) at a rim of radius c."""
    load = Load(0.2, DOWN, 0.0, np.zeros(3))
    radius = 0.06
    sag = radius - math.sqrt(radius**2 - CUP.radius**2)
    for bends, seals in ((sag * 1.05, True), (sag * 0.95, False)):
        cup = CupMeasures(CUP.radius, bends, CUP.most_force, CUP.friction)
        assert bool(cup_grasps(solid_of("sphere", (radius,)), cup, load)) == seals


def test_force_bears_the_weight_by_suction_or_friction() -> None:
    load = Load(0.5, DOWN, 0.0, np.zeros(3))
    weight = 0.5 * 9.81
    assert suction_force(load, np.zeros(3), UP, CUP) == pytest.approx(weight)
    side = np.array([1.0, 0.0, 0.0])
    assert suction_force(load, np.zeros(3), side, CUP) == pytest.approx(weight / CUP.friction)
    hanging = suction_force(load, np.array([0.0, 0.0, 0.0]) + 0.05 * side, side, CUP)
    assert hanging == pytest.approx(max(weight / CUP.friction, weight * 0.05 / CUP.radius))
    slippery = CupMeasures(0.02, 0.004, 60.0, 0.0)
    assert suction_force(load, np.zeros(3), UP, slippery) == math.inf


def test_moment_loads_a_cup_like_a_force_on_its_lever() -> None:
    """Inertia turns the rim against a rotating tool as weight beside it does."""
    rng = np.random.default_rng(3)
    forces = rng.normal(0.0, 5.0, (9, 3))
    offset = rng.normal(0.0, 0.1, 3)
    beside = suction_forces(forces, offset, UP, CUP)
    moments = np.asarray(np.cross(offset, forces), dtype=float)
    turned = suction_forces(forces, np.zeros(3), UP, CUP, moments)
    assert turned == pytest.approx(beside)
    assert (turned > suction_forces(forces, np.zeros(3), UP, CUP)).all()
