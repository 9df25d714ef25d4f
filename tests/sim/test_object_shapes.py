"""Objects of every shape: inertia, contacts, images, distances, supports and collision checks."""

from __future__ import annotations

import re
from typing import Any

import mujoco
import numpy as np
import pytest
from pydantic import ValidationError

import bt_dualarm as bt
from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.collision.support import support_below
from bt_dualarm.collision.swept import swept_arm
from bt_dualarm.core.pose import Pose
from bt_dualarm.export.mcap import drawn_shapes
from bt_dualarm.sim.frame import Exposure
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.sim.renderers import RayRenderer, shapes_of
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import CameraSpec, ObjectSpec
from bt_dualarm.spec.values import PoseSpec
from bt_dualarm.spec.yaml_reader import with_tuples
from bt_dualarm.viewer.signals import visual_meshes
from tests.families import some
from tests.sim.worlds import arm, file_of

MUG: dict[str, Any] = {
    "shape": "compound",
    "parts": {
        "body": {"shape": "cup", "size": [0.04, 0.09], "wall": 0.004},
        "handle": {
            "shape": "box",
            "size": [0.008, 0.03, 0.06],
            "pose": {"xyz": [0.055, 0, 0], "rpy": [0, 0, 90]},
            "density": 3.0,
            "color": "blue",
        },
    },
}

SHAPES: dict[str, dict[str, Any]] = {
    "egg": {"shape": "ellipsoid", "size": [0.06, 0.05, 0.08]},
    "nut": {"shape": "prism", "size": [0.03, 0.04]},
    "wedge": {"shape": "prism", "size": [0.03, 0.04], "sides": 3},
    "bin": {"shape": "bin", "size": [0.2, 0.15, 0.1]},
    "tray": {"shape": "tray", "size": [0.2, 0.15, 0.03], "wall": 0.005},
    "tube": {"shape": "tube", "size": [0.04, 0.1]},
    "cup": {"shape": "cup", "size": [0.04, 0.1], "wall": 0.002},
    "bowl": {"shape": "bowl", "size": [0.08, 0.05]},
    "mug": MUG,
}

HOLLOW = ("bin", "tray", "tube", "cup", "bowl", "mug")


def object_of(shape: str, xyz: tuple[float, float, float] = (0, 0, 0.5), **more: Any) -> ObjectSpec:
    data = SHAPES[shape] | {"mass": 0.3, "pose": {"xyz": [*xyz], "rpy": [0, 0, 0]}} | more
    return ObjectSpec.model_validate(with_tuples(data))


def world_of(reality: str = "ideal", seed: int = 0, **objects: ObjectSpec) -> World:
    far = arm("ur3", xyz=(5.0, 0.0, 0.0), spawned=False)
    return World(file_of({"arm1": far}, objects, reality=reality), seed)


def standing(shape: str, **more: Any) -> ObjectSpec:
    """An object of this shape on the floor."""
    low = body_of(object_of(shape)).corners[:, 2].min()
    return object_of(shape, (0.0, 0.0, -float(low)), **more)


def after(world: World, seconds: float, name: str) -> Pose:
    for _ in range(round(seconds / world.timestep)):
        world.step()
    return world.object_pose(name)


@pytest.mark.parametrize("shape", SHAPES)
def test_mass_center_and_inertia_agree_with_mujoco(shape: str) -> None:
    body = body_of(object_of(shape))
    model = world_of(thing=object_of(shape)).model
    index = model.body("thing").id
    assert model.body_mass[index] == pytest.approx(0.3)
    assert model.body_ipos[index] == pytest.approx(body.center, abs=1e-7)
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, model.body_iquat[index])
    turn = axes.reshape(3, 3)
    inertia = turn @ np.diag(model.body_inertia[index]) @ turn.T
    # MuJoCo stores mesh vertices as 32-bit numbers.
    assert inertia == pytest.approx(0.3 * body.inertia, abs=1e-6 * np.trace(inertia))


@pytest.mark.parametrize("shape", SHAPES)
def test_sampled_center_of_mass_shifts_that_of_the_body(shape: str) -> None:
    world = world_of("rough", thing=object_of(shape))
    sampled = world.devices.sampled_object("thing")
    index = world.model.body("thing").id
    shift = np.zeros(3) if shape == "egg" else sampled.shift
    body = body_of(object_of(shape))
    assert world.model.body_ipos[index] == pytest.approx(body.center + shift, abs=1e-7)
    expected = 0.3 * sampled.mass * body.principal[1]
    if shape != "egg":
        assert np.sort(world.model.body_inertia[index]) == pytest.approx(np.sort(expected))


@pytest.mark.parametrize("shape", SHAPES)
def test_standing_object_stays_in_place(shape: str) -> None:
    """An egg on its end balances, but only until it is touched."""
    world = world_of("lab", thing=standing(shape))
    before = world.object_pose("thing")
    assert after(world, 0.6, "thing").distance(before) < 1e-3


@pytest.mark.parametrize("shape", HOLLOW)
def test_ball_falls_into_a_hollow_object(shape: str) -> None:
    """It ends on the inner floor, or on the ground inside of a tube."""
    hollow = standing(shape, fixed=True)
    ball = ObjectSpec(shape="sphere", size=(0.02,), mass=0.05, pose=PoseSpec(xyz=(0.0, 0.0, 0.15)))
    world = world_of(thing=hollow, ball=ball)
    end = after(world, 1.0, "ball").position
    wall = {"tray": 0.005, "cup": 0.002, "mug": 0.004, "tube": 0.0}.get(shape, 0.003)
    assert end[2] == pytest.approx(0.02 + wall, abs=1e-3)
    assert np.hypot(*end[:2]) < 0.03


@pytest.mark.parametrize("shape", ["bin", "tray", "tube", "cup", "mug"])
def test_hole_has_the_declared_width(shape: str) -> None:
    """Rays from the axis hit the inner face of the wall at its radius or half of its edge."""
    body = body_of(object_of(shape))
    size = SHAPES[shape].get("size", [0.04, 0.09])
    wall = {"tray": 0.005, "cup": 0.002, "mug": 0.004}.get(shape, 0.003)
    height = 0.9 * 0.5 * size[-1]
    along = np.array((1.0, 0.0, 0.0))
    inner = size[0] * (0.5 if shape in ("bin", "tray") else 1.0) - wall
    found = body.ray(np.array((0.0, 0.0, height)), along)
    assert found == pytest.approx(inner, abs=1e-9)


def test_camera_sees_through_a_tube() -> None:
    """Seen from above, the center of the tube is the ground; that of a cup is the cup."""
    camera = CameraSpec.model_validate(
        with_tuples(
            {
                "mount": {"xyz": [0, 0, 0.6], "rpy": [180, 0, 0]},
                "resolution": [96, 96],
                "fov": 30,
                "fps": 30,
            }
        )
    )
    shots = {}
    for shape in ("tube", "cup"):
        obj = standing(shape, color="red", fixed=True)
        robot = arm("ur3", xyz=(5.0, 0.0, 0.0), camera=camera)
        world = World(file_of({"arm1": robot}, {"thing": obj}))
        exposure = Exposure(world.arms["arm1"].camera_id, 96, 96)
        image = RayRenderer().render(world.model, world.data, exposure).astype(int)
        shots[shape] = image[..., 0] - image[..., 1] > 60
    assert not shots["tube"][46:50, 46:50].any()
    assert shots["cup"][46:50, 46:50].all()
    assert shots["tube"].sum() > 200  # its rim and the inside of its wall


@pytest.mark.parametrize("shape", SHAPES)
def test_ray_kernels_browser_view_and_exports_include_every_part(shape: str) -> None:
    world = world_of(thing=object_of(shape))
    geoms = [*world.object_geoms("thing")]
    _, others = shapes_of(world.model, geoms)
    assert len(others) == (1 if shape == "egg" else 0)  # an ellipsoid is left to MuJoCo's rays
    exported = [one for one in drawn_shapes(world.model, {}) if one.body == "thing"]
    assert len(exported) == len(geoms)
    view = visual_meshes(world.model, {}).shapes
    sampled = [one for one in view if one["body"] == world.object_body("thing")]
    assert len(sampled) == len(geoms)


def test_part_has_its_own_color() -> None:
    world = world_of(thing=object_of("mug", color="red"))
    colors = world.model.geom_rgba[[*world.object_geoms("thing")]]
    assert colors[0][:3] == pytest.approx((0.8, 0.05, 0.05))
    assert colors[-1][:3] == pytest.approx((0.05, 0.15, 0.8))


def checker_with(obj: ObjectSpec) -> tuple[CollisionChecker, World]:
    """A collision checker of a UR5 in a world with an object."""
    robot = arm("ur5", xyz=(0.0, 0.0, 0.4))
    world = World(file_of({"arm1": robot}, {"thing": obj}))
    return CollisionChecker(world, "arm1"), world


@pytest.mark.parametrize("shape", SHAPES)
def test_compiled_motion_checks_support_every_shape(shape: str) -> None:
    """No `UnknownShapeError`, which would leave planning to the slower OMPL."""
    checker, world = checker_with(object_of(shape, (0.9, 0.4, 0.5), fixed=True))
    arm_with = swept_arm(checker, [checker.present])
    geoms = len(world.object_geoms("thing"))
    assert len(arm_with.shapes.ranges) >= geoms


@pytest.mark.parametrize(
    ("shape", "size", "wall"),
    [
        ("shelf", [0.5, 0.4, 0.71], 0.2),
        ("bin", [0.35, 0.4, 0.5], 0.2),
        ("tube", [0.0333, 0.1], 0.03),
        ("cup", [0.0777, 0.1], 0.0005),
    ],
)
def test_wall_that_a_refusal_allows_is_possible(shape: str, size: list[float], wall: float) -> None:
    """Whatever rounding does to the bound, which follows from the size."""
    data = {"shape": shape, "size": size, "mass": 1}
    data |= {"boards": 7} if shape == "shelf" else {}
    with pytest.raises(ValidationError) as refused:
        ObjectSpec.model_validate(with_tuples(data | {"wall": wall}))
    bound = re.search(r"at (?:most|least) (\S+) mm", str(refused.value))
    assert bound is not None
    ObjectSpec.model_validate(with_tuples(data | {"wall": float(bound[1]) / 1e3}))


def test_inside_of_a_bin_is_free() -> None:
    """A ball rests on the floor of a bin, not on its convex hull."""
    ball = ObjectSpec(shape="sphere", size=(0.02,), mass=0.05, pose=PoseSpec(xyz=(1, 1, 1)))
    world = world_of(thing=standing("bin", fixed=True), ball=ball)
    found = support_below(world, "ball", Pose.from_rpy((0.0, 0.0, 0.025)), 0.0, 0.05)
    assert found is not None
    assert found.below == pytest.approx(0.002, abs=1e-4)
    assert not found.rolls


@pytest.mark.parametrize("shape", ["nut", "bin", "bowl", "mug"])
def test_standing_object_is_flat_on_a_level_support(shape: str) -> None:
    obj = standing(shape)
    world = world_of(thing=obj)
    x, y, z = obj.pose.pose.position.tolist()
    found = support_below(world, "thing", Pose.from_rpy((x, y, z + 0.01)), 0.0, 0.05)
    assert found is not None
    assert found.below == pytest.approx(0.01, abs=1e-4)
    assert found.tilt < 1e-3
    assert not found.rolls


def test_tilted_egg_would_roll() -> None:
    world = world_of(egg=standing("egg"))
    for roll, rolls in ((0.0, False), (0.3, True)):
        pose = Pose.from_rpy((0.0, 0.0, 0.06), (roll, 0.0, 0.0))
        found = support_below(world, "egg", pose, 0.0, 0.1)
        assert found is not None
        assert found.rolls == rolls


def test_removed_object_leaves_no_meshes() -> None:
    world = world_of(thing=object_of("mug"))
    assert world.model.nmesh
    world.remove_object("thing")
    assert world.model.nmesh == 0
    world.spawn_object("thing")
    assert len(world.object_geoms("thing")) == len(body_of(object_of("mug")).parts)


def file_with(tree: list[Any], objects: dict[str, Any], **arm_fields: Any) -> dict[str, Any]:
    return {
        "bt_dualarm": 1,
        "name": "shapes",
        "world": {"scene": "table", "reality": "lab", "time_limit": 90},
        "objects": objects,
        "arms": {
            "arm1": {
                "robot": "ur5",
                "gripper": "robotiq_2f85",
                "base": {"xyz": [0, 0, 0.4]},
                "tree": {"sequence": tree},
            }
            | arm_fields
        },
    }


CAMERA = {"mount": "wrist", "resolution": [320, 240], "fov": 60, "fps": 30}


@pytest.mark.parametrize("shape", some(["cup", "mug"], 2))
def test_hollow_object_is_located_picked_and_placed(shape: str) -> None:
    """The pose comes from its outline alone, in which a cup may be upside down."""
    low = -float(body_of(object_of(shape)).corners[:, 2].min())
    own = SHAPES[shape] | {"mass": 0.2, "color": "yellow"}
    if shape == "mug":
        handle = MUG["parts"]["handle"] | {"color": "yellow"}
        own = own | {"parts": MUG["parts"] | {"handle": handle}}
    start = {"xyz": [0.41, -0.43, 0.4 + low], "rpy": [0, 0, 25]}
    tree: list[Any] = [
        {"scan": {"object": "it", "center": [0.40, -0.45, 0.40], "width": 0.1, "depth": 0.1}},
        {"locate": {"object": "it", "pose": "{pose}", "score": "it"}},
        {"grasp": {"object": "it", "at": "{pose}"}},
        {"transport": {"to": {"xyz": [0.30, -0.45, 0.60]}}},
        {"place": {"at": {"xyz": [0.25, -0.50, 0.4 + low]}}},
    ]
    result = bt.run(file_with(tree, {"it": own | {"pose": start}}, camera=CAMERA))
    leaves = result.arms["arm1"].leaves
    assert result.outcome == "SUCCESS", {n: (one.code, one.reason) for n, one in leaves.items()}
    assert float(leaves["sequence/locate"].metrics["located_error_m"]) < 0.003
    assert float(leaves["sequence/place"].metrics["placed_error_m"]) < 0.005


def test_grasp_of_a_part_uses_that_part() -> None:
    mug = MUG | {"mass": 0.2, "pose": {"xyz": [0.41, -0.43, 0.4455], "rpy": [0, 0, -90]}}
    tree = [{"grasp": {"object": "mug", "part": "handle"}}]
    with bt.open(file_with(tree, {"mug": mug})) as run:
        result = run.finish()
        world = run.world
        tool = world.object_pose("mug").inverse.apply(world.arms["arm1"].tool_pose.position)
    assert result.outcome == "SUCCESS"
    assert tool[0] > 0.04  # beside the cup, which has this radius


def test_unknown_part_is_an_error_with_the_nearest_name() -> None:
    mug = MUG | {"mass": 0.2, "pose": {"xyz": [0.41, -0.43, 0.4455]}}
    tree = [{"grasp": {"object": "mug", "part": "handel"}}]
    (problem,) = bt.check(file_with(tree, {"mug": mug}))
    assert problem.message == "grasp: there is no part of mug 'handel'"
    assert "handle" in problem.hint
