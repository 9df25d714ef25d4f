"""Passengers of a held object rest on it or on each other, and on nothing else."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest

from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.control.controller import JointController
from bt_dualarm.core.pose import Pose
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.sim.world import World
from bt_dualarm.skill.left_standing import stands_without
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.values import PoseSpec
from tests.sim.worlds import arm, box, file_of

if TYPE_CHECKING:
    from bt_dualarm.arm.arm import Arm

TABLE = box((0.5, 0.0, 0.2), fixed=True).model_copy(update={"size": (0.8, 0.8, 0.4)})
TOP = 0.4
FLOOR = TOP + 0.003


def tray() -> ObjectSpec:
    place = PoseSpec(xyz=(0.5, 0.0, TOP + 0.015))
    return ObjectSpec(shape="tray", size=(0.3, 0.2, 0.03), mass=0.5, pose=place)


def settled(objects: dict[str, ObjectSpec], steps: int = 100) -> World:
    world = World(file_of({"arm1": arm("ur5", (0.0, 0.0, 0.4))}, {"table": TABLE} | objects))
    for _ in range(steps):
        world.step()
    return world


def riders(world: World, obj: str = "tray") -> set[str]:
    return {one.object for one in world.passengers_of(obj)}


STANDING = {
    "tray": tray(),
    "cube": box((0.45, 0.0, FLOOR + 0.02), 0.04),
    "upper": box((0.45, 0.0, FLOOR + 0.055), 0.03),
    "beside": box((0.75, 0.0, TOP + 0.025), 0.05),
}


@pytest.mark.parametrize("steps", [0, 100])
def test_objects_that_rest_on_it_are_passengers(steps: int) -> None:
    """Even at the start of a run, when objects do not touch yet, but are about to fall."""
    lifted = {name: one.model_copy() for name, one in STANDING.items()}
    for name, gap in (("cube", 0.0005), ("upper", 0.001)):
        x, y, z = lifted[name].pose.xyz or (0.0, 0.0, 0.0)
        lifted[name] = lifted[name].model_copy(update={"pose": PoseSpec(xyz=(x, y, z + gap))})
    world = settled(lifted, steps)
    assert riders(world) == {"cube", "upper"}
    assert riders(world, "cube") == {"upper"}
    assert riders(world, "upper") == riders(world, "beside") == set()
    assert riders(world, "table") == set()  # fixed, so it is not lifted
    assert world.loaded_mass("tray") == pytest.approx(0.5 + 0.1 + 0.1)


def test_object_with_another_support_is_no_passenger() -> None:
    """A board lies across the tray's rim and a block on the table, with a cube on the board."""
    rim = TOP + 0.03
    across = box((0.72, 0.0, rim + 0.005)).model_copy(update={"size": (0.30, 0.05, 0.01)})
    world = settled(
        {
            "tray": tray(),
            "block": box((0.84, 0.0, TOP + 0.015), 0.03),
            "board": across,
            "cube": box((0.72, 0.0, rim + 0.01 + 0.02), 0.04),
        }
    )
    assert riders(world) == set()
    assert riders(world, "board") == {"cube"}


def test_object_in_the_air_above_it_is_no_passenger() -> None:
    world = settled({"tray": tray(), "high": box((0.5, 0.0, FLOOR + 0.06), 0.03)}, 0)
    assert riders(world) == set()


@pytest.mark.parametrize(("shape", "size"), [("bin", (0.2, 0.2, 0.1)), ("tube", (0.05, 0.1))])
def test_container_is_no_passenger_of_what_is_in_it(shape: str, size: tuple[float, ...]) -> None:
    """At the start of a run, neither touches anything: the bin counted as falling onto the cube."""
    pose = PoseSpec(xyz=(0.5, 0.0, TOP + 0.05 + 1e-6))
    container = ObjectSpec.model_validate(
        {"shape": shape, "size": size, "wall": 0.01, "mass": 1.0, "pose": pose}
    )
    floor = TOP + (0.011 if shape == "bin" else 0.001)
    world = settled({"container": container, "cube": box((0.5, 0.0, floor + 0.02), 0.04)}, 0)
    assert riders(world, "cube") == set()
    assert world.loaded_mass("cube") == pytest.approx(0.1)


def test_bouncing_passenger_is_kept_and_fallen_one_lost() -> None:
    world = settled({"tray": tray(), "cube": box((0.45, 0.0, FLOOR + 0.02), 0.04)})
    world.attach("arm1", "tray")
    assert [one.object for one in world.passengers_of("tray")] == ["cube"]
    assert set(world.carried_by("arm1")) == {"tray", "cube"}
    assert set(world.object_geoms("cube")) < world.payload_geoms("tray")
    address = world.pose_address("cube")
    held = world.object_pose("tray")

    def move_cube(to: Pose) -> None:
        world.data.qpos[address : address + 7] = (*to.position, *to.quaternion)
        world.step()
        world.data.time += 0.1  # a second update within that time does nothing
        world.look_for_passengers()

    move_cube(held @ Pose.from_rpy((-0.05, 0.0, 0.035)))  # 5 cm above its floor
    assert riders(world) == {"cube"}
    generation = world.generation
    move_cube(held @ Pose.from_rpy((-0.05, 0.0, 0.034)))
    assert world.generation == generation  # no change, so no recompilation
    move_cube(Pose.from_rpy((0.75, 0.0, TOP + 0.02)))
    assert riders(world) == set()
    assert world.generation > generation
    move_cube(held @ Pose.from_rpy((-0.05, 0.0, 0.006)))  # another arm puts it back
    assert riders(world) == {"cube"}
    world.remove_object("cube")
    assert riders(world) == set()


def test_load_of_an_arm_includes_passengers_of_known_mass() -> None:
    world = settled(STANDING)
    alone = World(file_of({"arm1": arm("ur5", (0.0, 0.0, 0.4))}, {"tray": tray()}))
    for one in (world, alone):
        one.attach("arm1", "tray")
    load, empty = (one.nominal["arm1"].loads[0] for one in (world, alone))
    assert empty.mass == pytest.approx(0.5)
    assert load.mass == pytest.approx(0.7)
    center = world.arms["arm1"].tool_link_pose.apply(load.pose.position)
    expected = (0.5 * 0.5 + 0.45 * 0.2) / 0.7
    assert center[0] == pytest.approx(expected, abs=1e-3)


def test_object_held_by_another_arm_is_no_passenger() -> None:
    file = file_of(
        {"arm1": arm("ur5", (0.0, 0.0, 0.4)), "arm2": arm("panda", (1.3, 0.0, 0.4), 180.0)},
        {"table": TABLE, **STANDING},
    )
    world = World(file)
    for _ in range(100):
        world.step()
    world.attach("arm1", "tray")
    assert riders(world) == {"cube", "upper"}
    world.attach("arm2", "upper")
    assert riders(world) == {"cube"}
    world.attachments.detach("arm2", "upper")
    assert riders(world) == {"cube", "upper"}


def test_passenger_does_not_count_as_a_support() -> None:
    """A plate in the air with a heavier block on it: their contact was taken for a support."""
    plate = box((0, 0, 0), spawned=False).model_copy(update={"size": (0.16, 0.16, 0.02)})
    file = file_of(
        {"arm1": arm("ur5", (0.0, 0.0, 0.4))},
        {"plate": plate, "block": box((0, 0, 0), 0.03, mass=0.5, spawned=False)},
    )
    world = World(file)
    controller = JointController(world, "arm1", world.timestep, Reservations())
    x, y, z = world.arms["arm1"].tool_pose.position
    world.spawn_object("plate", Pose.from_rpy((x, y, z - 0.015)))
    world.attach("arm1", "plate")
    world.spawn_object("block", Pose.from_rpy((x, y + 0.06, z + 0.0105)))
    for _ in range(100):
        controller.update(world.time)
        world.step()
    world.look_for_passengers()
    assert riders(world, "plate") == {"block"}
    assert not stands_without(cast("Arm", SimpleNamespace(world=world, name="arm1")), "plate")


def test_support_of_an_object_that_rocks_is_felt_in_each_step() -> None:
    """Forces of other contacts were read where contacts had come or gone in the last step."""
    place = PoseSpec(xyz=(0.285, -0.107, TOP + 0.0445))
    can = ObjectSpec(shape="cylinder", size=(0.025, 0.088), mass=0.187, pose=place)
    world = settled({"can": can}, steps=60)
    stood = []
    for _ in range(150):
        world.step()
        stood.append(stands_without(cast("Arm", SimpleNamespace(world=world, name="arm1")), "can"))
    assert all(stood), stood.count(False)


def test_object_taken_from_a_held_tray_may_be_near_it() -> None:
    file = file_of(
        {"arm1": arm("ur5", (0.0, 0.0, 0.4)), "arm2": arm("panda", (1.3, 0.0, 0.4), 180.0)},
        {"table": TABLE, **STANDING},
    )
    world = World(file)
    for _ in range(100):
        world.step()
    world.attach("arm2", "beside")
    world.attach("arm1", "tray")
    world.attach("arm2", "upper")
    assert world.attachments.on_carriers("arm1") == [("upper", "tray")]
    assert world.attachments.on_carriers("arm2") == [("upper", "tray")]
    kept = {"arm1": 0.03, "arm2": 0.03}
    for name, other in (("arm1", "arm2"), ("arm2", "arm1")):
        checker = CollisionChecker(world, name, kept)
        tray, upper, beside = (world.object_geom(one) for one in ("tray", "upper", "beside"))
        assert checker.least[tray, upper] <= 0.0
        assert checker.least[tray, beside] == kept[other]
    world.attachments.place_on("arm2", "upper", "")
    assert world.attachments.on_carriers("arm1") == []
    checker = CollisionChecker(world, "arm2", kept)
    upper, tray = world.object_geom("upper"), world.object_geom("tray")
    assert checker.least[upper, tray] == kept["arm1"]
    world.attachments.place_on("arm2", "upper", "tray")
    assert CollisionChecker(world, "arm2", kept).least[upper, tray] <= 0.0
    world.attachments.detach("arm2", "upper")
    assert world.attachments.on_carriers("arm1") == []


def test_object_taken_from_a_held_tray_outlives_the_tray() -> None:
    """Whatever asked what the object may touch failed: the removed tray is not in the world."""
    arms = {"arm1": arm("ur5", (0.0, 0.0, 0.4)), "arm2": arm("panda", (1.3, 0.0, 0.4), 180.0)}
    world = World(file_of(arms, {"table": TABLE, **STANDING}))
    for _ in range(100):
        world.step()
    world.attach("arm1", "tray")
    world.attach("arm2", "upper")
    world.remove_object("tray")
    assert world.attachments.on_carriers("arm2") == []
    CollisionChecker(world, "arm2", {"arm1": 0.03})
    world.spawn_object("tray")
    assert world.attachments.on_carriers("arm2") == []  # it is not the tray of before
