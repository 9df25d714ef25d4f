"""The world: spawning and removal do not affect the rest, and divergence is detected."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bt_dualarm.core.errors import AbsentError, CatalogError, DivergenceError, WorldError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import CameraSpec, LimitShares, ObjectSpec, TreeFile
from bt_dualarm.spec.values import PoseSpec
from tests.sim.worlds import arm, box, file_of

State = dict[str, tuple[Vector, Vector]]


def state_of(world: World) -> State:
    """Position and velocity of each joint, by name."""
    found = {}
    for j in range(world.model.njnt):
        joint = world.data.joint(j)
        found[str(joint.name)] = joint.qpos.copy(), joint.qvel.copy()
    return found


def assert_equal(state: State, other: State) -> None:
    """Assert equality bit for bit, for every joint of the first state."""
    for name, parts in state.items():
        for part, same in zip(parts, other[name], strict=True):
            assert part.tobytes() == same.tobytes(), name


def assert_close(state: State, other: State) -> None:
    """Assert equality within rounding for every joint, as the solver adds up in another order."""
    assert state.keys() == other.keys()
    for name, parts in state.items():
        for part, same in zip(parts, other[name], strict=True):
            assert part == pytest.approx(same, rel=0, abs=1e-12), name


def steps(world: World, count: int) -> None:
    for _ in range(count):
        world.step()


def four() -> TreeFile:
    """Two UR5s and a Panda, two of them spawned later; a cube on the ground, a ball in the air."""
    ball = ObjectSpec(
        shape="sphere", size=(0.03,), mass=0.1, pose=PoseSpec(xyz=(0.5, 0.6, 2.0)), spawned=False
    )
    return file_of(
        {
            "arm1": arm("ur5"),
            "arm2": arm("ur5", (-1.5, 0.0, 0.4), 30.0, spawned=False),
            "arm3": arm("panda", (1.6, 0.0, 0.0), 180.0, spawned=False),
        },
        {"cube": box((0.5, 0.4, 0.025)), "ball": ball},
    )


def test_spawning_and_removal_preserve_other_states_bit_for_bit() -> None:
    """Arms without a controller swing, and the cube rests, so that states differ."""
    world = World(four())
    world.data.ctrl[:] = np.arange(6.0)
    changes: list[tuple[Callable[[str], None], str]] = [
        (world.spawn_arm, "arm2"),
        (world.spawn_object, "ball"),
        (world.spawn_arm, "arm3"),
        (world.remove_arm, "arm2"),
        (world.remove_object, "cube"),
        (world.spawn_object, "cube"),
        (world.spawn_arm, "arm2"),
        (world.remove_arm, "arm1"),
        (world.remove_object, "ball"),
        (world.remove_arm, "arm3"),
    ]
    for change, name in changes:
        steps(world, 5)
        before = state_of(world)
        time = world.time
        generation = world.generation
        change(name)
        after = state_of(world)
        assert world.time == time
        assert world.generation == generation + 1
        remaining = {joint for joint in before if joint.split("/")[0] != name}
        assert_equal({joint: before[joint] for joint in remaining}, after)
        assert any(joint.split("/")[0] == name for joint in after) == (
            name in world.arms or name in world.objects
        )
    assert set(world.arms) == {"arm2"}
    assert set(world.objects) == {"cube"}


def test_torques_are_kept_when_other_arms_are_spawned() -> None:
    world = World(four())
    world.data.ctrl[:] = np.arange(1.0, 7.0)
    world.spawn_arm("arm3")
    arm1 = world.arms["arm1"]
    assert (world.data.ctrl[arm1.actuator_ids] == np.arange(1.0, 7.0)).all()
    assert (world.data.ctrl[world.arms["arm3"].actuator_ids] == 0).all()


def test_order_of_spawning_does_not_matter() -> None:
    """After some steps, joint states are equal for any order."""
    states = []
    for order in itertools.permutations(("arm2", "arm3")):
        world = World(four())
        for name in order:
            world.spawn_arm(name)
        steps(world, 20)
        states.append(state_of(world))
    for state in states:
        assert_close(states[0], state)


def test_initial_state_does_not_depend_on_the_time_of_spawning() -> None:
    early = four()
    late = early.arms["arm3"]
    whole = early.model_copy(
        update={"arms": early.arms | {"arm3": late.model_copy(update={"spawned": True})}}
    )
    first = World(whole)
    second = World(early)
    second.spawn_arm("arm3")
    for part in ("q", "v"):
        assert (getattr(first.arms["arm3"], part) == getattr(second.arms["arm3"], part)).all()
    expected = first.arms["arm3"].tool_pose
    assert second.arms["arm3"].tool_pose.distance(expected) < 1e-12
    assert first.model.ngeom == second.model.ngeom
    assert first.model.nexclude == second.model.nexclude


def test_removal_leaves_nothing_behind() -> None:
    """After ten cycles of spawning and removal, the model has as many parts as before."""
    world = World(four())
    parts = ("nbody", "ngeom", "njnt", "nu", "nexclude", "nmesh", "nsite", "neq", "ncam", "nnames")
    before = [getattr(world.model, part) for part in parts]
    for _ in range(10):
        world.spawn_arm("arm3")
        world.spawn_object("ball")
        world.remove_arm("arm3")
        world.remove_object("ball")
    assert [getattr(world.model, part) for part in parts] == before


def test_two_arms_of_one_type_have_separate_names_and_indices() -> None:
    world = World(four())
    world.spawn_arm("arm2")
    one = world.arms["arm1"]
    two = world.arms["arm2"]
    for ids in ("qpos_ids", "dof_ids", "actuator_ids"):
        assert not set(getattr(one, ids)) & set(getattr(two, ids))
    assert not one.geom_ids & two.geom_ids
    assert one.tool_geom_ids < one.geom_ids
    assert world.model.body("arm2/forearm_link").id != world.model.body("arm1/forearm_link").id
    relative = one.base.inverse @ one.tool_pose
    assert relative.distance(two.base.inverse @ two.tool_pose) < 1e-9


def test_limits_of_an_arm_are_scaled_by_its_shares() -> None:
    """Another arm of the same type keeps the full limits."""
    some = LimitShares(velocity=0.5, jerk=0.25)
    world = World(file_of({"arm1": arm("panda", limits=some), "arm2": arm("panda", (2, 0, 0.4))}))
    derated, whole = (world.robots[name].limits for name in ("arm1", "arm2"))
    assert (derated.velocity == 0.5 * whole.velocity).all()
    assert (derated.acceleration == whole.acceleration).all()
    assert (derated.jerk == 0.25 * whole.jerk).all()
    assert (derated.effort == whole.effort).all()
    assert (whole.jerk == load_robot("panda").limits.jerk).all()


def test_arm_stands_at_its_base(file: TreeFile) -> None:
    world = World(file)
    world.spawn_arm("arm2")
    for name, body in world.arms.items():
        link = world.data.body(f"{name}/{body.robot.base_link}")
        assert link.xpos == pytest.approx(body.base.position)
        assert Pose(link.xpos, link.xquat).angle(body.base) < 1e-9


NOT_FINITE = [(what, value) for what in ("qpos", "qvel", "ctrl") for value in (np.nan, np.inf)]
ABSURD = [("qvel", 1e6), ("qfrc_applied", 1e12)]  # a finite torque of a motor is limited


@pytest.mark.parametrize(("what", "value"), NOT_FINITE + ABSURD)
def test_divergence_is_caught_within_one_step(what: str, value: float, file: TreeFile) -> None:
    """If one number is not finite or absurd, the next step raises an error that names the joint."""
    world = World(file)
    index = {"qpos": 7 + 2, "qvel": 6 + 2, "ctrl": 2, "qfrc_applied": 6 + 2}[what]
    getattr(world.data, what)[index] = value
    with pytest.raises(DivergenceError, match=r"diverged at 0\.00. s: joint 'arm1/"):
        world.step()


def test_divergence_writes_no_file_to_the_current_folder(
    file: TreeFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MuJoCo would write MUJOCO_LOG.TXT there."""
    monkeypatch.chdir(tmp_path)
    for what in ("qvel", "qpos", "ctrl"):
        world = World(file)
        getattr(world.data, what)[-1] = np.nan
        with pytest.raises(DivergenceError):
            steps(world, 3)
    assert list(tmp_path.iterdir()) == []


def test_restored_state_evolves_identically() -> None:
    """Including contacts and warm starts, bit for bit."""
    world = World(four())
    world.spawn_object("ball", Pose.from_rpy((0.5, 0.4, 0.12)))
    steps(world, 40)
    state = world.state()
    trajectories = []
    for _ in range(2):
        world.restore(state)
        assert world.state().tobytes() == state.tobytes()
        trajectory = []
        for _ in range(100):
            world.step()
            trajectory.append(world.state().tobytes())
        trajectories.append(trajectory)
    assert trajectories[0] == trajectories[1]


def test_world_with_visual_meshes_has_the_same_state(file: TreeFile) -> None:
    """Visual meshes add shapes, but no joints, masses or contacts: states can be transferred."""
    plain = World(file)
    visual = World(file, visuals=True)
    for world in (plain, visual):
        world.spawn_arm("arm2")
    assert visual.model.ngeom > plain.model.ngeom
    assert visual.model.body_mass == pytest.approx(plain.model.body_mass)
    visual.restore(plain.state())
    assert_equal(state_of(plain), state_of(visual))
    steps(plain, 20)
    steps(visual, 20)
    assert_close(state_of(plain), state_of(visual))


REFUSED: dict[str, tuple[Callable[[World], object], str]] = {
    "spawn what is there": (lambda w: w.spawn_arm("arm1"), "arm 'arm1' is already present"),
    "spawn an object that is there": (
        lambda w: w.spawn_object("cube"),
        "'cube' is already present",
    ),
    "spawn the unknown": (lambda w: w.spawn_arm("amr1"), "did you mean 'arm1'"),
    "spawn an unknown object": (lambda w: w.spawn_object("bal"), "did you mean 'ball'"),
    "remove the absent": (
        lambda w: w.remove_arm("arm2"),
        r"no arm 'arm2' in the world \(there are: arm1\)",  # not: did you mean 'arm1'?
    ),
    "remove an absent object": (lambda w: w.remove_object("ball"), "no object 'ball' in the world"),
    "attach to the absent": (lambda w: w.attach("arm2", "cube"), "no arm 'arm2'"),
    "attach the absent": (lambda w: w.attach("arm1", "ball"), "no object 'ball'"),
    "look for the absent": (lambda w: w.object_pose("ball"), "no object 'ball'"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_refused_change_has_no_effect(what: str, file: TreeFile) -> None:
    action, message = REFUSED[what]
    world = World(file)
    model = world.model
    state = world.state()
    with pytest.raises(WorldError, match=message):
        action(world)
    assert world.model is model
    assert world.state().tobytes() == state.tobytes()


def test_declarations_are_checked_before_anything_runs() -> None:
    """Including those of arms and objects that are spawned later."""
    with pytest.raises(WorldError, match=r"no posture 'hom' of robot 'ur5'.*did you mean 'home'"):
        World(file_of({"arm1": arm("ur5", posture="hom", spawned=False)}))
    with pytest.raises(WorldError, match=r"no camera mount 'head'.*there are: wrist"):
        World(file_of({"arm1": arm("ur5", camera=CameraSpec(mount="head"), spawned=False)}))
    with pytest.raises(WorldError, match="'floor' is the name of a part of the scene 'empty'"):
        World(file_of({"arm1": arm("ur5")}, {"floor": box((0, 0, 1), spawned=False)}))
    with pytest.raises(CatalogError, match=r"no robot 'ur50'.*did you mean 'ur5'"):
        World(file_of({"arm1": arm("ur50", spawned=False)}))
    with pytest.raises(CatalogError, match=r"no scene 'tabel'.*did you mean 'table'"):
        World(file_of({"arm1": arm("ur5")}, scene="tabel"))


def test_falling_object_accelerates_with_gravity(file: TreeFile) -> None:
    world = World(file)
    world.spawn_object("ball", Pose.from_rpy((0.5, 0.6, 2.0)))
    steps(world, 100)
    assert world.object_velocity("ball")[5] == pytest.approx(-9.81 * 0.2, rel=1e-6)


def test_camera_is_spawned_and_removed_with_its_arm(file: TreeFile) -> None:
    world = World(file)
    assert world.arms["arm1"].camera_id == -1
    world.spawn_arm("arm2")
    camera = world.arms["arm2"].camera_id
    assert world.model.camera(camera).name == "arm2/camera"
    assert world.model.cam_fovy[camera] == 50.0
    world.remove_arm("arm2")
    assert world.model.ncam == 0


def test_fixed_camera_is_removed_with_its_arm() -> None:
    fixed = CameraSpec(mount=PoseSpec(xyz=(1.0, 0.0, 1.0), look_at=(0.0, 0.0, 0.5)))
    world = World(file_of({"arm1": arm("ur5", camera=fixed)}))
    assert world.model.ncam == 1
    world.remove_arm("arm1")
    assert world.model.ncam == 0
    world.spawn_arm("arm1")
    assert world.model.ncam == 1


def test_access_to_an_absent_arm_or_object_raises_a_failure() -> None:
    arms = {"arm1": arm("ur5"), "arm2": arm("ur3", (0.0, 3.0, 0.4))}
    boxes = {name: box((0.5, y, 0.025)) for name, y in (("cube", 0.0), ("other", 0.5))}
    world = World(file_of(arms, boxes))
    world.remove_object("cube")
    world.remove_arm("arm2")
    accesses: dict[str, tuple[Callable[[], object], ...]] = {
        "NOT_THERE": (lambda: world.objects["cube"], lambda: world.object_pose("cube")),
        "PARTNER_GONE": (
            lambda: world.arms["arm2"],
            lambda: world.hardware["arm2"],
            lambda: world.nominal["arm2"],
        ),
    }
    for code, functions in accesses.items():
        for access in functions:
            with pytest.raises(AbsentError, match=r"in the world.*\(there are: \w+\)") as caught:
                access()
            assert caught.value.code == code
    assert world.objects.get("cube") is None
