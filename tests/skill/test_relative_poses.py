"""Relative poses are resolved between surfaces, from the arm's knowledge, never from the truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from bt_dualarm.arm.arm import Arm
from bt_dualarm.behaviors.load import check_file
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose
from bt_dualarm.robots.robot_description import robot_names
from bt_dualarm.runtime.file_check import check
from bt_dualarm.skill.registry import Registry
from bt_dualarm.skill.relative_poses import resolve_poses
from bt_dualarm.spec.document import NoiseSpec, ObjectSpec
from bt_dualarm.spec.node_types import PortModel, port, validated
from bt_dualarm.spec.relative_pose import CarriedPose, ObjectPose, PointPose, ToolPose
from bt_dualarm.spec.values import ObjectName, PoseSpec
from bt_dualarm.spec.yaml_reader import Data
from tests.arm.test_arm import Bench
from tests.plays import Stage
from tests.sim import worlds
from tests.sim.test_mesh_objects import box_mesh, write_obj
from tests.sim.worlds import box
from tests.skills.scenarios import Scenario

REGISTRY = Registry.load()


class Ports(PortModel):
    object: ObjectName | None = port(None, "object")
    tool: ToolPose | None = port(None, "tool pose")
    held: CarriedPose | None = port(None, "pose of a held object")
    of: ObjectPose | None = port(None, "pose of an object")
    point: PointPose | None = port(None, "point")
    several: tuple[ToolPose, ...] = port((), "tool poses")


def resolved(arm: Arm, port: str, value: Data, **others: Data) -> PoseSpec:
    """The pose that a skill receives."""
    found = resolve_poses(validated(Ports, {port: value, **others}), arm)
    pose: PoseSpec = getattr(found.ports, port)
    return pose


def turned_box() -> ObjectSpec:
    """A box of 0.2 by 0.1 by 0.04 m, rotated by 90°: its edges along x and y are exchanged."""
    pose = PoseSpec(xyz=(0.5, 0.1, 0.5), rpy=(0.0, 0.0, 90.0))
    return ObjectSpec(shape="box", size=(0.2, 0.1, 0.04), mass=0.1, pose=pose, fixed=True)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"above": "slab", "by": 0.1}, (0.5, 0.1, 0.62)),
        ({"on": "slab"}, (0.5, 0.1, 0.52)),
        ({"on": "slab", "xyz": [0.01, -0.02, 0.03]}, (0.51, 0.08, 0.55)),
        ({"beside": "slab", "side": "+x", "by": 0.03}, (0.58, 0.1, 0.5)),
        ({"beside": "slab", "side": "-y", "by": 0.03}, (0.5, -0.03, 0.5)),
        ({"in_frame": "slab", "xyz": [0.1, 0, 0]}, (0.5, 0.2, 0.5)),
        ({"in_frame": "base", "xyz": [0.3, 0.2, 0.1]}, (0.3, 0.2, 0.5)),
        ({"in_frame": "arm1", "xyz": [0.3, 0.2, 0.1]}, (0.3, 0.2, 0.5)),
    ],
)
@pytest.mark.parametrize("port", ["tool", "point"])
def test_relative_pose_of_a_tool_is_that_of_a_point(
    port: str, given: Data, expected: tuple[float, ...]
) -> None:
    bench = Bench(slab=turned_box())
    pose = resolved(bench.first, port, given)
    assert pose.xyz == pytest.approx(expected, abs=1e-9)
    assert not pose.is_oriented  # the skill keeps the current one


@pytest.mark.parametrize("robot", robot_names())
def test_tool_frame_is_that_of_the_last_set_point(robot: str) -> None:
    bench = Bench(robot=robot)
    tool = bench.first.commanded_tool_pose
    step = Pose.from_rpy((0.01, 0.02, 0.03), (0.0, 0.0, np.pi / 2))
    pose = resolved(
        bench.first, "tool", {"in_frame": "tool", "xyz": [0.01, 0.02, 0.03], "rpy": [0, 0, 90]}
    ).pose
    assert pose.distance(tool @ step) < 1e-9
    assert pose.angle(tool @ step) < 1e-7


@pytest.mark.parametrize("shape", ["box", "cylinder", "capsule", "sphere"])
def test_surfaces_of_two_objects_touch(shape: str) -> None:
    """An object `on` another rests on its top, for any shape and orientation."""
    size = {"box": (0.04, 0.06, 0.08), "sphere": (0.03,)}.get(shape, (0.02, 0.08))
    obj = ObjectSpec(shape=shape, size=size, mass=0.1, pose=PoseSpec(xyz=(2, 2, 2)))  # type: ignore[arg-type]
    lying = {"box": 0.02, "sphere": 0.03}.get(shape, 0.02)
    standing = {"box": 0.04, "sphere": 0.03, "capsule": 0.06}.get(shape, 0.04)
    arm = Bench(slab=turned_box(), thing=obj).first
    for rpy, half in (([0, 0, 0], standing), ([0, 90, 0], lying)):
        on = resolved(arm, "of", {"on": "slab", "rpy": rpy}, object="thing")
        assert on.xyz == pytest.approx((0.5, 0.1, 0.52 + half), abs=1e-9)
        assert on.is_oriented
        beside = {"beside": "slab", "side": "+x", "by": 0.01, "rpy": rpy}
        x, y, z = resolved(arm, "of", beside, object="thing").xyz
        assert (y, z) == pytest.approx((0.1, 0.48 + half), abs=1e-9)  # both rest on the same level
        assert x > 0.55 + 0.01 + 0.019


@pytest.mark.parametrize(
    ("shape", "size", "highest"),
    [
        ("box", (0.2, 0.2, 0.04), 0.1 * np.sin(0.25) + 0.02 * np.cos(0.25)),
        ("prism", (0.1, 0.04), 0.1 * np.sin(0.25) + 0.02 * np.cos(0.25)),  # a corner is at +x
        ("cylinder", (0.1, 0.04), 0.1 * np.sin(0.25) + 0.02 * np.cos(0.25)),
    ],
)
def test_on_a_tilted_object_is_on_its_highest_point(
    shape: str, size: tuple[float, ...], highest: float
) -> None:
    """What stands above its middle only would be in it."""
    pose = PoseSpec(xyz=(0.5, 0.1, 0.5), rpy=(0.0, float(np.degrees(0.25)), 0.0))
    tilted = ObjectSpec(shape=shape, size=size, mass=0.1, pose=pose)  # type: ignore[arg-type]
    arm = Bench(tilted=tilted, thing=box((2, 2, 2))).first
    on = resolved(arm, "of", {"on": "tilted", "rpy": [0, 0, 0]}, object="thing")
    assert on.xyz == pytest.approx((0.5, 0.1, 0.5 + highest + 0.025), abs=1e-6)


@pytest.mark.parametrize("corner", [(0.0, 0.0, 0.0), (0.1, -0.2, 0.3)])
def test_meshes_are_placed_by_their_middle(
    corner: tuple[float, float, float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The frame of a mesh may be anywhere; poses of a mesh are those of its frame all the same."""
    monkeypatch.setattr(worlds, "WORLD", tmp_path)
    objects: dict[str, Any] = {}
    for name, size in (("slab", (200, 100, 40)), ("thing", (40, 60, 80))):
        middle = (1000.0 * corner[0], 1000.0 * corner[1], 1000.0 * corner[2])
        write_obj(tmp_path / f"{name}.obj", box_mesh(size, middle))
        turned = Pose.from_rpy((0.5, 0.1, 0.5), (0, 0, np.pi / 2)) @ Pose.from_rpy(corner).inverse
        x, y, z = turned.position.tolist()
        pose = PoseSpec(xyz=(x, y, z), rpy=(0.0, 0.0, 90.0))
        objects[name] = ObjectSpec(
            shape="mesh", file=f"{name}.obj", scale=0.001, mass=0.1, pose=pose, fixed=True
        )
    arm = Bench(**objects).first
    above = resolved(arm, "tool", {"above": "slab", "by": 0.1})
    assert above.xyz == pytest.approx((0.5, 0.1, 0.62))
    beside: dict[str, Data] = {"beside": "slab", "side": "+x", "by": 0.03}
    assert resolved(arm, "tool", beside).xyz == pytest.approx((0.58, 0.1, 0.5))
    cases: list[tuple[dict[str, Data], tuple[float, float, float]]] = [
        ({"on": "slab"}, (0.5, 0.1, 0.56)),
        ({"on": "slab", "xyz": [0.01, 0.02, 0]}, (0.51, 0.12, 0.56)),
        (beside, (0.60, 0.1, 0.52)),
    ]
    for given, expected in cases:
        found = resolved(arm, "of", given | {"rpy": [0, 0, 0]}, object="thing")
        assert found.pose.apply(np.array(corner)) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("shape", "size"),
    [
        ("tray", (0.2, 0.1, 0.04)),
        ("bin", (0.2, 0.1, 0.04)),
        ("cup", (0.05, 0.04)),
        ("bowl", (0.05, 0.04)),
    ],
)
def test_on_a_hollow_object_is_on_its_inner_floor(shape: str, size: tuple[float, ...]) -> None:
    """`above` refers to the rim, which is half the height of 0.04 m above the origin."""
    pose = PoseSpec(xyz=(0.5, 0.1, 0.5), rpy=(0.0, 0.0, 30.0))
    hollow = ObjectSpec(shape=shape, size=size, mass=0.1, pose=pose, wall=0.004)  # type: ignore[arg-type]
    arm = Bench(hollow=hollow).first
    assert resolved(arm, "tool", {"on": "hollow"}).xyz[2] == pytest.approx(0.484, abs=1e-6)
    assert resolved(arm, "tool", {"above": "hollow"}).xyz[2] == pytest.approx(0.52, abs=1e-6)


@pytest.mark.parametrize("gripper", ["robotiq_2f85", "panda_hand", "suction_cup"])
def test_pose_of_a_held_object_follows_the_hand(gripper: str) -> None:
    arm = Bench(gripper=gripper, slab=turned_box(), cube=box((0.3, 0.4, 0.5))).first
    in_hand = arm.tool_pose @ Pose.from_rpy((0.0, 0.0, 0.02), (0.0, 0.0, 0.0))
    arm.gripper.hold("cube", in_hand)
    known = arm.known.pose("cube")
    assert (known.by, known.pose.distance(in_hand) < 1e-9) == ("held", True)
    on = resolved(arm, "held", {"on": "slab", "rpy": [0, 0, 0]})
    assert on.xyz == pytest.approx((0.5, 0.1, 0.545), abs=1e-9)
    # Without an orientation the current one is kept; a tilted cube extends farther down.
    half = 0.025 * np.abs(in_hand.rotation_matrix[2]).sum()
    kept = resolved(arm, "held", {"on": "slab"})
    assert kept.xyz[2] == pytest.approx(0.52 + half, abs=1e-4)  # servo error
    arm.gripper.command(arm.gripper.description.stroke or 1.0)
    arm.gripper.let_go("cube")
    assert arm.known.pose("cube").by == "felt"
    assert arm.known.pose("cube").pose.distance(in_hand) < 1e-9


def test_declared_pose_is_used_not_the_true_one() -> None:
    noise = NoiseSpec(xyz=(0.05, 0.05, 0.0))
    bench = Bench(cube=box((0.3, 0.4, 0.5), noise=noise))
    assert bench.world.object_pose("cube").position != pytest.approx((0.3, 0.4, 0.5), abs=1e-3)
    assert resolved(bench.first, "tool", {"on": "cube"}).xyz == pytest.approx((0.3, 0.4, 0.525))


def test_latest_known_pose_is_used() -> None:
    arm = Bench(cube=box((0.3, 0.4, 0.5))).first
    arm.known.saw("cube", Pose.from_rpy((0.1, 0.2, 0.3)))
    assert resolved(arm, "tool", {"in_frame": "cube"}).xyz == pytest.approx((0.1, 0.2, 0.3))
    found = resolve_poses(validated(Ports, {"several": [{"on": "cube"}, {"xyz": [0, 0, 1]}]}), arm)
    assert found.names == {"cube"}
    assert found.metrics == {"known_by": "seen", "known_for_s": 0.0}


def test_unknown_pose_is_a_failure_with_a_reason() -> None:
    bench = Bench(
        gripper="robotiq_2f85",
        cube=box((0.3, 0.4, 0.5)),
        late=box((0.3, -0.4, 0.5), spawned=False),
    )
    arm = bench.first

    def refusal(name: str) -> str:
        with pytest.raises(Failure) as caught:
            resolved(arm, "tool", {"on": name})
        assert caught.value.code == "UNKNOWN_POSE"
        return caught.value.reason

    assert refusal("late").endswith("it is not in the world now")
    bench.world.spawn_object("late")  # another arm
    assert refusal("late").endswith("it was spawned during the run, and was never seen")
    arm.gripper.hold("cube", arm.tool_pose)
    bench.world.attachments.detach("arm1", "cube")  # as slip detection does
    assert refusal("cube").endswith("arm1 had taken it, and lost it")
    arm.known.forget("cube", "it was handed over")
    assert refusal("cube").endswith("it was handed over")
    arm.known.saw("cube", Pose.identity())
    assert resolved(arm, "tool", {"in_frame": "cube"}).xyz == (0.0, 0.0, 0.0)


def test_nothing_is_put_on_what_the_arm_holds_itself() -> None:
    """Such an object was lowered in the air (`NO_CONTACT`)."""
    arm = Bench(gripper="robotiq_2f85", cube=box((0.3, 0.4, 0.5))).first
    arm.gripper.hold("cube", arm.tool_pose)
    with pytest.raises(Failure, match="INVALID_TARGET: the arm holds 'cube' itself"):
        resolved(arm, "held", {"on": "cube"})
    assert resolved(arm, "held", {"above": "cube", "by": 0.1}).xyz[2] > arm.tool_pose.position[2]


def test_check_refuses_an_object_on_itself() -> None:
    sequence: list[Data] = [
        {"grasp": {"object": "cube", "then_at": {"on": "cube"}}},
        {"transport": {"object": "cube", "to": {"above": "cube", "by": 0.1}}},
        {"place": {"object": "cube", "at": {"on": "cube"}}},
    ]
    cube = {"shape": "box", "size": [0.05, 0.05, 0.05], "mass": 0.1}
    arm = {"robot": "ur5", "gripper": "robotiq_2f85", "tree": {"sequence": sequence}}
    tree = {"bt_dualarm": 1, "objects": {"cube": cube}, "arms": {"a": arm}}
    messages = [problem.message for problem in check_file(tree, REGISTRY.kinds)]
    assert messages == [
        "grasp: then_at: 'cube' cannot be on itself",
        "place: at: 'cube' cannot be on itself",
    ]


def test_pose_beyond_100_m_is_a_failure() -> None:
    arm = Bench(cube=box((0.3, 0.4, 0.5))).first
    with pytest.raises(Failure, match="more than 100 m away"):
        resolved(arm, "tool", {"on": "cube", "xyz": [100, 0, 0]})


@pytest.mark.parametrize(
    "given",
    [
        {"by": 0.1},
        {"above": "cube", "on": "cube"},
        {"on": "cube", "by": 0.1},
        {"beside": "cube"},
        {"above": "cube", "side": "+x"},
        {"in_frame": "base", "rpy": [0, 0, 0], "quat": [1, 0, 0, 0]},
        {"in_frame": "base", "quat": [2, 0, 0, 0]},
        {"above": "cube", "by": -0.1},
        {"above": "cube", "look_at": [0, 0, 0]},
    ],
)
def test_contradictory_relative_poses_are_refused(given: Data) -> None:
    with pytest.raises(ValidationError):
        validated(Ports, {"tool": given})


def test_check_warns_of_unreachable_poses_relative_to_a_base() -> None:
    tree = {
        "bt_dualarm": 1,
        "objects": {"cube": {"shape": "box", "size": [0.1, 0.1, 0.1], "mass": 1}},
        "arms": {
            "arm1": {
                "robot": "ur5",
                "tree": {
                    "sequence": [
                        {"reach_to_pose": {"to": {"in_frame": "base", "xyz": [3, 0, 0]}}},
                        {"reach_to_pose": {"to": {"in_frame": "base", "xyz": [0.4, 0.2, 0.4]}}},
                        {"reach_to_pose": {"to": {"above": "cube", "by": 5}}},
                    ]
                },
            }
        },
    }
    (warning,) = check(tree, REGISTRY.kinds, build=False).problems
    assert "out of reach of arm1" in warning.message
    assert warning.severity == "warning"


def test_relative_pose_is_resolved_when_the_leaf_starts(stage: Stage) -> None:
    """The pose of the second leaf is relative to the tool pose at the end of the first."""
    scenario = Scenario(objects={"cube": {
        "shape": "box", "size": [0.1, 0.1, 0.1], "mass": 1, "fixed": True,
        "pose": {"xyz": [0.4, 0.2, 0.5]},
    }})  # fmt: skip
    play = stage.play(
        scenario.file(
            {"reach_to_pose": {"to": {"above": "cube", "by": 0.15, "rpy": [180, 0, 0]}}},
            {"move_linear": {"to": {"in_frame": "tool", "xyz": [0, 0, 0.05]}}},
        )
    )
    play.run()
    end = play.world.arms["arm1"].tool_pose
    assert end.position == pytest.approx((0.4, 0.2, 0.65), abs=1e-3)
    assert play.leaf("reach_to_pose").metrics["known_by"] == "declared"
    assert "known_by" not in play.leaf("move_linear").metrics


def test_check_warns_of_an_object_that_is_never_spawned(tmp_path) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "task.yaml"
    path.write_text(
        "bt_dualarm: 1\n"
        "objects:\n  late: {shape: sphere, size: [0.1], mass: 1, spawned: false}\n"
        "arms:\n  arm1:\n    robot: ur5\n    tree:\n"
        "      reach_to_pose: {to: {above: late, by: 0.1}}\n"
    )
    (warning,) = check_file(path, REGISTRY.kinds)
    assert "'late' has spawned: false and no leaf spawns it" in warning.message
