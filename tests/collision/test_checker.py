from __future__ import annotations

import pickle

import mujoco
import numpy as np
import pytest

from bt_dualarm.collision.checker import CollisionChecker, interpolated
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.robot_description import robot_names
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ObjectSpec
from tests.grippers.fingers import FINGERED, opened
from tests.sim.worlds import arm, box, file_of, world_with

DOWN = (np.pi, 0.0, 0.0)


def pick_world(**more: ObjectSpec) -> World:
    """A UR5, a floating cube in its workspace, and a Panda that is not in its way."""
    return World(
        file_of(
            {"arm1": arm("ur5"), "arm2": arm("panda", (1.6, 0.0, 0.4), 180.0)},
            {"cube": box((0.45, 0.1, 0.6), fixed=False), **more},
        )
    )


def above(world: World, height: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """A configuration of arm1 whose tool is ``height`` above the cube's upper side."""
    body = world.arms["arm1"]
    kinematics = Kinematics(body.robot, body.base)
    cube = world.object_pose("cube").position
    target = Pose.from_rpy((cube[0], cube[1], cube[2] + 0.025 + height), DOWN)
    return kinematics.solve(target, body.robot.postures["home"])


@pytest.mark.parametrize("name", robot_names())
def test_postures_of_the_catalog_are_free_of_contacts(name: str) -> None:
    world = world_with(name)
    checker = CollisionChecker(world, "arm1")
    for posture in world.arms["arm1"].robot.postures.values():
        assert checker.contact(posture) is None


def test_contact_names_both_bodies_and_the_depth() -> None:
    world = pick_world()
    contact = CollisionChecker(world, "arm1").contact(above(world, -0.01))
    assert contact is not None
    assert contact.first.startswith("arm1/")
    assert contact.second == "cube"
    assert contact.depth == pytest.approx(0.01, abs=1e-3)
    failure = contact.failure()
    assert failure.code == "IN_COLLISION"
    assert "cube" in failure.reason


def test_position_just_above_an_object_is_free_and_ignored_objects_do_not_count() -> None:
    world = pick_world()
    assert CollisionChecker(world, "arm1").free(above(world, 0.01))
    assert CollisionChecker(world, "arm1", ignore=frozenset({"cube"})).free(above(world, -0.01))


def test_keep_clear_applies_to_bodies_that_are_not_near_now() -> None:
    world = pick_world()
    q = world.hardware["arm1"].q
    checker = CollisionChecker(world, "arm1")
    checker.keep_clear(0.02)
    assert checker.free(q.copy()), "its base stands on its pedestal"
    contact = checker.contact(above(world, 0.01))
    assert contact is not None
    assert contact.second == "cube"
    assert checker.free(above(world, 0.03))
    q[:] = above(world, 0.01)
    near = CollisionChecker(world, "arm1")
    near.keep_clear(0.02)
    assert near.free(above(world, 0.01)), "it is as near now"


def test_keep_clear_applies_to_the_arm_itself_if_requested() -> None:
    """The forearm of this UR5 is 1 mm above its pedestal, and its wrist 1 mm beside its arm."""
    world = pick_world()
    folded = np.radians((48.9, 178.9, 163.5, 126.3, 12.5, -145.9))
    checker = CollisionChecker(world, "arm1")
    checker.keep_clear(0.003)
    assert checker.free(folded)
    checker.keep_clear(0.003, itself=True)
    assert not checker.free(folded)


def test_check_does_not_change_the_world() -> None:
    world = pick_world()
    before = world.state()
    margins = world.model.geom_margin.copy()
    CollisionChecker(world, "arm1", margin=0.1).contact(above(world, -0.01))
    np.testing.assert_array_equal(world.state(), before)
    np.testing.assert_array_equal(world.model.geom_margin, margins)


def test_held_object_moves_with_the_arm() -> None:
    """An arm with a cube at its tool touches the floor 5 cm higher than without."""
    world = pick_world()
    body = world.arms["arm1"]
    kinematics = Kinematics(body.robot, body.base)
    grasp = above(world, 0.0)
    world.data.qpos[body.qpos_ids] = grasp
    mujoco.mj_forward(world.model, world.data)
    world.sense()
    low = kinematics.solve(Pose.from_rpy((0.45, 0.1, 0.03), DOWN), grasp)
    assert CollisionChecker(world, "arm1").free(low)
    world.attach("arm1", "cube")
    checker = CollisionChecker(world, "arm1")
    assert checker.free(grasp)
    contact = checker.contact(low)
    assert contact is not None
    assert (contact.first, contact.second) == ("cube", "floor")
    assert contact.depth == pytest.approx(0.02, abs=1e-3)


def test_margin_applies_to_other_arms_only() -> None:
    world = pick_world()
    q = world.arms["arm1"].q
    assert CollisionChecker(world, "arm1", margin=0.02).free(q)
    contact = CollisionChecker(world, "arm1", margin=2.0).contact(q)
    assert contact is not None
    assert contact.second.startswith("arm2/")
    assert contact.depth < 0.0
    assert "too close" in contact.failure().reason


def test_held_object_may_stay_as_deep_in_its_support_as_it_is() -> None:
    """An arm that presses a cube on the floor can lift it but not press it deeper."""
    world = pick_world()
    body = world.arms["arm1"]
    kinematics = Kinematics(body.robot, body.base)
    grasp = above(world, 0.0)

    def at(height: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return kinematics.solve(Pose.from_rpy((0.45, 0.1, height), DOWN), grasp)

    world.data.qpos[body.qpos_ids] = grasp
    mujoco.mj_forward(world.model, world.data)
    world.sense()
    world.attach("arm1", "cube")
    world.data.qpos[world.arms["arm1"].qpos_ids] = at(0.049)  # the cube is 1 mm in the floor
    world.sense()
    checker = CollisionChecker(world, "arm1")
    assert checker.free(at(0.049))
    assert checker.free(at(0.1))
    assert not checker.free(at(0.047))


@pytest.mark.parametrize(
    ("gap", "sides", "found"),
    [
        (0.001, "both", ("cube", "left", "right")),
        (0.001, "left", None),
        (0.003, "both", None),
    ],
)
def test_held_object_between_two_things_is_enclosed(
    gap: float, sides: str, found: tuple[str, str, str] | None
) -> None:
    """No plan leads out of a hole, and its refusal did not say that the peg is in one."""
    beside = 0.05 + gap
    walls = {"left": box((0.45, 0.1 - beside, 0.6)), "right": box((0.45, 0.1 + beside, 0.6))}
    if sides == "left":
        del walls["right"]
    world = pick_world(**walls)
    grasp = above(world, 0.0)
    world.data.qpos[world.arms["arm1"].qpos_ids] = grasp
    mujoco.mj_forward(world.model, world.data)
    world.sense()
    world.attach("arm1", "cube")
    named = CollisionChecker(world, "arm1").enclosing(grasp)
    assert (named and (named[0], *sorted(named[1:]))) == found


def test_first_contact_of_several_configurations_has_its_index() -> None:
    world = pick_world()
    rows = np.array([above(world, height) for height in (0.03, 0.02, -0.005, -0.01)])
    found = CollisionChecker(world, "arm1").first_contact(rows)
    assert found is not None
    assert found[0] == 2
    assert CollisionChecker(world, "arm1").first_contact(rows[:2]) is None


def test_no_point_of_an_arm_moves_farther_than_the_sweep_radii_allow() -> None:
    world = world_with("ur5")
    radii = CollisionChecker(world, "arm1").radii
    body = world.arms["arm1"]
    rng = np.random.default_rng(0)
    geoms = sorted(body.geom_ids)
    for _ in range(50):
        before = rng.uniform(-np.pi, np.pi, 6)
        step = rng.uniform(-0.05, 0.05, 6)
        places = []
        for q in (before, before + step):
            world.data.qpos[body.qpos_ids] = q
            mujoco.mj_kinematics(world.model, world.data)
            places.append(world.data.geom_xpos[geoms].copy())
        moved = np.linalg.norm(places[1] - places[0], axis=1).max()
        assert moved <= np.abs(step) @ radii


@pytest.mark.parametrize(("holding", "reach"), [(False, 0.2), (True, 0.35)])
def test_sweep_radius_of_the_last_joint_includes_the_held_object(
    holding: bool, reach: float
) -> None:
    """The last joint of a UR5 turns a tool of 10 cm and a held cube, but not the whole arm."""
    world = World(
        file_of({"arm1": arm("ur5")}, {"cube": box((0.45, 0.1, 0.6), fixed=False, spawned=False)})
    )
    below = world.arms["arm1"].tool_pose @ Pose.from_rpy((0.0, 0.0, 0.1), (0.0, 0.0, 0.0))
    world.spawn_object("cube", below)
    if holding:
        world.attach("arm1", "cube")
    last = CollisionChecker(world, "arm1").radii[-1]
    assert last < reach
    assert (last > 0.2) == holding


def test_pickled_checker_finds_the_same_contacts() -> None:
    world = pick_world()
    here = CollisionChecker(world, "arm1", margin=0.04)
    there = pickle.loads(pickle.dumps(here))  # noqa: S301 - own data
    rng = np.random.default_rng(3)
    home = world.arms["arm1"].robot.postures["home"]
    found = [(here.contact(q), there.contact(q)) for q in home + rng.uniform(-2, 2, (200, 6))]
    assert all(one == other for one, other in found)
    assert 20 < sum(one is not None for one, _ in found) < 180
    np.testing.assert_array_equal(here.radii, there.radii)


def test_pickled_checker_keeps_what_was_moved_in_it() -> None:
    """Plans are searched in another process: it took fingers and objects for where they were."""
    world = pick_world()
    here = CollisionChecker(world, "arm1")
    home = world.arms["arm1"].robot.postures["home"]
    tool = world.nominal["arm1"].tool_pose_at(home)
    here.move_object("cube", tool)
    contact = here.contact(home)
    assert contact is not None
    assert contact.second == "cube"
    there = pickle.loads(pickle.dumps(here))  # noqa: S301 - own data
    assert there.contact(home) == contact


def test_interpolation_includes_its_ends_and_limits_its_step() -> None:
    radii = np.array((1.0, 0.5))
    rows = interpolated(np.zeros(2), np.ones(2), radii, 0.1)
    np.testing.assert_array_equal(rows[[0, -1]], [[0, 0], [1, 1]])
    assert (np.abs(np.diff(rows, axis=0)) @ radii).max() <= 0.1 + 1e-12


def test_payload_of_another_arm_keeps_the_margin_unless_a_hand_may_take_it() -> None:
    """The guard, which has the same rule, would stop a plan that comes nearer."""
    world = pick_world(brick=box((0.45, 0.1, 0.66), fixed=False))
    world.attach("arm2", "cube")
    world.data.qpos[world.arms["arm1"].qpos_ids] = above(world, 0.06)
    mujoco.mj_forward(world.model, world.data)
    world.sense()
    near = above(world, 0.02)
    assert CollisionChecker(world, "arm1", 0.045, frozenset({"brick"})).free(near)
    world.attach("arm1", "brick")
    below = above(world, 0.05 + 0.02)  # the brick is between the tool and the cube
    assert CollisionChecker(world, "arm1", 0.015).free(below)
    contact = CollisionChecker(world, "arm1", 0.045).contact(below)
    assert contact is not None
    assert (contact.first, contact.second) == ("brick", "cube")
    assert world.arm_of(contact.second) == "arm2"
    assert [world.arm_of(name) for name in ("brick", "arm2/hand", "floor")] == [
        "arm1",
        "arm2",
        "floor",
    ]


def test_contacts_that_exist_at_no_end_of_a_path_are_not_allowed() -> None:
    """A contact that is barely tolerated at a sample may be deeper between two samples."""
    world = pick_world(brick=box((0.45, 0.1, 0.66), fixed=False))
    apart = above(world, 0.06)
    world.data.qpos[world.arms["arm1"].qpos_ids] = apart
    mujoco.mj_forward(world.model, world.data)
    world.sense()
    world.attach("arm1", "brick")
    checker = CollisionChecker(world, "arm1")
    touching = above(world, 0.05 - 0.0003)
    assert checker.free(touching)
    assert not checker.without_new_contacts([apart]).free(touching)
    assert checker.without_new_contacts([apart, touching]).free(touching)
    assert not checker.without_new_contacts([touching]).free(above(world, 0.04))


def test_empty_tool_may_not_touch_an_object_even_slightly() -> None:
    world = pick_world()
    checker = CollisionChecker(world, "arm1")
    assert checker.free(above(world, 0.0003))
    assert not checker.free(above(world, -0.0003))


@pytest.mark.parametrize("gripper", FINGERED)
@pytest.mark.parametrize("robot", ["ur5", "panda", "xarm7"])
def test_tool_that_touches_an_object_may_graze_it_with_its_other_finger(
    robot: str, gripper: str
) -> None:
    """With one fingertip on a block and the other just above it, the hand must be able to leave."""
    block = box((0.45, 0.1, 0.3), edge=0.2)
    post = box((0.45, 0.3, 0.3), edge=0.2)
    world = World(file_of({"arm1": arm(robot, gripper=gripper)}, {"cube": block, "post": post}))
    body = world.arms["arm1"]
    kinematics = Kinematics(body.robot, body.base)

    opened(world, 0.07)

    def hand(height: float, tilt: float = 0.0, y: float = 0.1) -> Vector:
        tool = Pose.from_rpy((0.45, y, height), DOWN) @ Pose.from_rpy((0, 0, 0), (tilt, 0, 0))
        return kinematics.solve(tool, body.robot.postures["home"])

    def standing(q: Vector) -> CollisionChecker:
        world.data.qpos[body.qpos_ids] = q
        opened(world, 0.07)
        return CollisionChecker(world, "arm1")

    checker = standing(hand(0.4))
    top = 0.4 - float(
        checker.data.contact.dist.min()
    )  # height of the tool with its tips on the block
    free = hand(top + 0.001)
    flat = hand(top - 0.0003)
    assert not standing(free).free(flat)  # there is no contact yet
    leaning = hand(top, tilt=np.deg2rad(0.3))
    checker = standing(leaning)
    assert checker.free(flat)
    assert checker.without_new_contacts([leaning, free]).free(flat)
    assert not checker.free(hand(top - 0.001))
    assert not checker.free(hand(top - 0.0003, y=0.3))  # another object


def test_each_other_arm_has_its_own_margin() -> None:
    arms = {"arm1": arm("ur5"), "arm2": arm("panda", (1.6, 0.0, 0.4), 180.0)}
    world = World(file_of({**arms, "arm3": arm("ur3", (-1.6, 0.0, 0.4))}))
    q = world.arms["arm1"].q
    for near in ("arm2", "arm3"):
        contact = CollisionChecker(world, "arm1", margin={near: 2.0}).contact(q)
        assert contact is not None
        assert contact.second.startswith(f"{near}/")
    assert CollisionChecker(world, "arm1", margin={"arm2": 0.02}).free(q)


@pytest.mark.parametrize("gripper", ["robotiq_2f85", "panda_hand"])
def test_boxes_beyond_the_clearance_are_free(gripper: str) -> None:
    """MuJoCo may report contacts between two boxes that are nearer than the boxes are."""
    world = World(
        file_of({"arm1": arm("ur5", gripper=gripper)}, {"cube": box((1.5, 1.5, 0.5), 0.06)})
    )
    checker = CollisionChecker(world, "arm1")
    keep = 0.045
    checker.keep_clear(keep)
    hand = np.flatnonzero(checker.moving)
    cube = world.object_geom("cube")
    q = checker.present
    tool = world.arms["arm1"].tool_pose.position
    rng = np.random.default_rng(3)
    refused = 0
    for _ in range(400):
        place = (tool + rng.uniform(-0.15, 0.15, 3)).tolist()
        checker.move_object("cube", Pose.from_rpy(place, rng.uniform(-np.pi, np.pi, 3).tolist()))
        if checker.free(q):
            continue
        refused += 1
        gaps = [
            mujoco.mj_geomDistance(checker.model, checker.data, int(one), cube, 1.0, None)
            for one in hand
        ]
        assert min(gaps) < keep + 1e-6
    assert refused > 50
