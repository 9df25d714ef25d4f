"""Joints of compounds: the objects that they make, poses of their parts, and every refusal."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from bt_dualarm.core.errors import OverlapError, SpringError, WorldError
from bt_dualarm.core.pose import Pose
from bt_dualarm.sim.arm_models import NominalLoad
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ObjectSpec, expanded
from bt_dualarm.spec.joints import PartJoint
from bt_dualarm.spec.yaml_reader import with_tuples
from tests.sim.worlds import arm, box, file_of

DOOR: dict[str, Any] = {
    "shape": "compound",
    "mass": 5.0,
    "fixed": True,
    "pose": {"xyz": [1.0, 0.5, 0.4], "rpy": [0, 0, 30]},
    "noise": {"xyz": [0.02, 0.02, 0], "yaw": 5},
    "parts": {
        "post": {"shape": "box", "size": [0.04, 0.04, 0.6], "pose": {"xyz": [-0.02, 0, 0]}},
        "panel": {"shape": "box", "size": [0.3, 0.02, 0.5], "pose": {"xyz": [0.16, 0, 0]}},
        "knob": {"shape": "sphere", "size": [0.02], "pose": {"xyz": [0.28, -0.04, 0]}},
    },
    "joints": {
        "hinge": {"type": "hinge", "parts": ["panel", "knob"], "range": [-90, 10], "at": -40}
        | {"anchor": [0, 0.01, 0], "mass": 2.0}
    },
}


def spec_of(data: dict[str, Any]) -> ObjectSpec:
    return ObjectSpec.model_validate(with_tuples(data))


def world_with(data: dict[str, Any], seed: int = 0) -> World:
    objects, _, _ = expanded({"door": spec_of(data)})
    return World(file_of({"arm1": arm("ur5", (0.0, -2.0, 0.0))}, objects), seed)


def test_joint_splits_a_compound_into_two_objects() -> None:
    objects, groups, wrong = expanded({"door": spec_of(DOOR)})
    assert list(objects) == ["door", "door.hinge"]
    assert (groups, wrong) == ((), [])
    assert list(objects["door"].parts) == ["post"]
    assert list(objects["door.hinge"].parts) == ["panel", "knob"]
    assert objects["door"].fixed
    assert objects["door"].joint is None
    moved = objects["door.hinge"]
    assert not moved.fixed
    assert not moved.is_free
    assert moved.mass == 2.0
    assert moved.joint is not None
    assert (moved.joint.owner, moved.joint.name) == ("door", "hinge")


@pytest.mark.parametrize("kind", ["hinge", "slide"])
def test_position_is_the_inverse_of_the_displacement(kind: str) -> None:
    data = {"type": kind, "parts": ["a"], "axis": [1, 2, -1], "anchor": [0.1, 0.2, 0.3]}
    joint = PartJoint.model_validate(with_tuples(data | {"range": [-2, 2]}))
    for position in np.linspace(*joint.limits, 7).tolist():
        assert joint.position_of(joint.displacement(position)) == pytest.approx(position)


def test_world_has_the_parts_where_the_joint_puts_them() -> None:
    """In MuJoCo, at the start, with the noise of the object; the sensor reads the position."""
    world = world_with(DOOR, seed=3)
    frame = world.object_pose("door")
    assert frame.distance(spec_of(DOOR).pose.pose) > 0.005  # the noise counts for both
    hung = world.joint_of("door.hinge")
    assert hung is not None
    there = frame @ hung.spec.displacement(math.radians(-40))
    assert there.distance(world.object_pose("door.hinge")) < 1e-9
    assert there.angle(world.object_pose("door.hinge")) < 1e-6
    assert world.joint_reading("door.hinge") == pytest.approx(math.radians(-40))
    assert world.part_owner("door", "knob") == "door.hinge"
    assert world.part_owner("door", "post") == "door"
    # Pushed, it moves along its joint and stops at the end of its range.
    for _ in range(2000):
        push = world.object_pose("door.hinge").turn(np.array((0.0, -20.0, 0.0)))
        world.data.xfrc_applied[world.object_body("door.hinge"), :3] = push
        world.step()
    assert world.joint_position("door.hinge") == pytest.approx(math.radians(-90), abs=0.02)


def test_friction_holds_without_creeping() -> None:
    """A lid that dry friction can hold does not move by a degree in ten seconds."""
    lid = {"shape": "box", "size": [0.3, 0.2, 0.01]}
    frame = {"shape": "box", "size": [0.3, 0.01, 0.2], "pose": {"xyz": [0, 0.12, 0]}}
    joint: dict[str, Any] = {
        "type": "hinge",
        "axis": [-1, 0, 0],
        "anchor": [0, 0.1, 0],
        "range": [0, 90],
    }
    joint |= {"parts": ["lid"], "at": 45, "mass": 0.5, "friction": 1.0}
    world = world_with(
        DOOR | {"parts": {"lid": lid, "frame": frame}, "joints": {"hinge": joint}, "noise": {}}
    )
    for _ in range(5000):
        world.step()
    assert world.joint_position("door.hinge") == pytest.approx(math.radians(45), abs=0.017)


def test_spawned_and_removed_together() -> None:
    world = world_with(DOOR | {"spawned": False})
    before = world.state()
    assert not world.objects
    world.spawn_object("door", Pose.from_rpy((2.0, 0.0, 0.4)))
    assert set(world.objects) == {"door", "door.hinge"}
    assert world.object_pose("door").distance(Pose.from_rpy((2.0, 0.0, 0.4))) < 1e-9
    world.remove_object("door")
    assert not world.objects
    assert np.array_equal(world.state(), before)


def test_parts_on_joints_are_not_spawned_where_something_is() -> None:
    """They count as much as the parts that stay: a cube in the panel is thrown away otherwise."""
    data = DOOR | {"noise": {}, "pose": {"xyz": [1.0, 0.0, 0.4]}, "spawned": False}
    objects, _, _ = expanded({"door": spec_of(data)})
    panel = spec_of(DOOR).parts["panel"].pose.pose
    hung = objects["door.hinge"].joint
    assert hung is not None
    in_panel = Pose.from_rpy((1.0, 0.0, 0.4)) @ hung.spec.displacement(hung.spec.start) @ panel
    world = World(
        file_of(
            {"arm1": arm("ur5", (0.0, -2.0, 0.0))},
            {"cube": box(tuple(in_panel.position.tolist())), **objects},
        )
    )
    with pytest.raises(OverlapError, match=r"'door\.hinge' would be \d+ mm deep in cube"):
        world.spawn_object("door")
    assert set(world.objects) == {"cube"}


def test_parts_on_joints_come_and_go_only_with_their_object() -> None:
    world = world_with(DOOR)
    refusal = "'door.hinge' moves on a joint of 'door': it is added and removed with that"
    with pytest.raises(WorldError, match=refusal):
        world.remove_object("door.hinge")
    assert set(world.objects) == {"door", "door.hinge"}
    world.remove_object("door")
    with pytest.raises(WorldError, match=refusal):
        world.spawn_object("door.hinge")
    assert not world.objects


def test_parts_on_joints_of_a_free_object_move_with_it() -> None:
    """Also as it falls; the nominal model of a carrying arm has the mass and center of both."""
    world = world_with(DOOR | {"fixed": False})
    body = world.object_body("door")
    assert world.model.body_parentid[world.object_body("door.hinge")] == body
    assert world.model.body_subtreemass[body] == pytest.approx(7.0)
    whole = NominalLoad.of("door", world.objects["door"], Pose.identity())
    assert whole.mass == 7.0
    placed = world.object_pose("door").apply(whole.pose.position)
    assert placed == pytest.approx(world.data.subtree_com[body], abs=1e-9)
    spec = world.objects["door.hinge"].joint
    assert spec is not None
    for _ in range(300):  # it falls over
        world.step()
    owner = world.object_pose("door")
    assert owner.angle(Pose.from_rpy((0, 0, 0), (0, 0, math.radians(30)))) > 0.1
    moved = owner @ spec.spec.displacement(world.joint_position("door.hinge"))
    assert moved.distance(world.object_pose("door.hinge")) < 1e-9
    assert moved.angle(world.object_pose("door.hinge")) < 1e-7


def test_object_that_is_not_fixed_is_spawned_and_removed_with_its_parts() -> None:
    world = world_with(DOOR | {"fixed": False, "spawned": False})
    before = world.state()
    place = Pose.from_rpy((2.0, 0.0, 0.4))
    for _ in range(2):
        world.spawn_object("door", place)
        hung = world.objects["door.hinge"].joint
        assert hung is not None
        expected = place @ hung.spec.displacement(hung.spec.start)
        assert world.object_pose("door.hinge").distance(expected) < 1e-9
        world.remove_object("door")
        assert not world.objects
        assert np.array_equal(world.state(), before)


MISTAKES = [
    ({"shape": "box", "size": [1, 1, 1], "parts": {}}, "only a compound has joints"),
    (
        {"fixed": False, "joints": {"hinge": DOOR["joints"]["hinge"] | {"sensor": False}}},
        "'hinge' needs its sensor, or 'fixed: true'",
    ),
    ({"many": {"grid": [2]}}, "cannot be 'many'"),
]

WRONG_JOINTS = [
    ({"hinge": {"parts": ["panle"]}}, "did you mean 'panel'"),
    ({"panel": {}}, "is the name of a part as well"),
    ({"hinge": {"parts": ["panel", "knob", "post"]}}, "at least one has to stay"),
    ({"hinge": {}, "other": {}}, "joints form no chains"),
    ({"hinge": {"range": [10, -10]}}, "give the smaller one first"),
    ({"hinge": {"range": [-721, 10]}}, "-720"),
    ({"hinge": {"type": "slide", "range": [0, 11]}}, "at most 10 m"),
    ({"hinge": {"at": 20}}, "is not between -90 and 10°"),
    ({"hinge": {"axis": [0, 0, 0]}}, "no direction"),
    ({"hinge": {"parts": ["panel", "panel"]}}, "has a name twice"),
]


@pytest.mark.parametrize(("fields", "message"), MISTAKES)
def test_object_that_cannot_have_joints_is_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        spec_of(DOOR | fields)


@pytest.mark.parametrize(("joints", "message"), WRONG_JOINTS)
def test_invalid_joint_is_refused(joints: dict[str, Any], message: str) -> None:
    filled = {name: DOOR["joints"]["hinge"] | fields for name, fields in joints.items()}
    with pytest.raises(ValidationError, match=message):
        spec_of(DOOR | {"joints": filled})


def test_fixtures_of_a_scene_may_have_joints(tmp_path: Path) -> None:
    from bt_dualarm.behaviors.load import load_tree_file

    (tmp_path / "cell.yaml").write_text(
        "bt_dualarm_scene: 1\nfixtures:\n  box:\n    shape: compound\n    parts:\n"
        "      a: {shape: box, size: [0.1, 0.1, 0.1]}\n"
        "      b: {shape: box, size: [0.1, 0.1, 0.1], pose: {xyz: [0, 0, 0.12]}}\n"
        "    joints: {up: {type: slide, parts: [b], range: [0, 0.1]}}\n"
    )
    path = tmp_path / "tree.yaml"
    path.write_text(
        "bt_dualarm: 1\nworld: {scene: cell.yaml}\narms:\n  arm1:\n    robot: ur5\n"
        "    tree: {joint_at: {object: box, joint: up, below: 0.1}}\n"
    )
    assert list(load_tree_file(path).objects) == ["box", "box.up"]


def test_position_of_a_joint_may_have_the_unit_of_an_angle() -> None:
    """Like a parameter of the type `angle`."""
    from bt_dualarm.skill.registry import Registry

    ports = Registry.load().skills["operate"].Ports
    given = {"object": "door", "joint": "hinge"}
    for text, degrees in (("85 deg", 85.0), ("0.5 rad", 28.648)):
        read = ports.model_validate(given | {"to": text}).model_dump()
        assert read["to"] == pytest.approx(degrees, abs=1e-3)
    with pytest.raises(ValidationError, match="text with a unit"):
        ports.model_validate(given | {"to": "5 N"})


def test_fault_may_name_a_part_on_a_joint() -> None:
    """It can become slippery; it cannot be pushed away, which the message says."""
    import bt_dualarm as bt

    def problems(kind: str, **fields: Any) -> list[str]:
        fault = {"kind": kind, "object": "door.hinge"} | fields
        tree = {"wait": 1}
        file = {"bt_dualarm": 1, "name": "x", "objects": {"door": DOOR}, "faults": {"f": fault}}
        arms = {"arm1": {"robot": "ur5", "base": {"xyz": [0, -2, 0]}, "tree": tree}}
        return [str(one) for one in bt.check(file | {"arms": arms})]

    assert problems("reduced_friction") == []
    (wrong,) = problems("pushed_object", force=[1, 0, 0], until=1)
    assert "moves on a joint only" in wrong


@pytest.mark.parametrize("mass", [0.01, 0.013, 1.0, 10.0])
def test_spring_is_as_stiff_as_the_time_step_allows(mass: float) -> None:
    """The stiffest that is allowed does not diverge; a stiffer one is refused with the limit."""

    def door(spring: float) -> dict[str, Any]:
        hinge = DOOR["joints"]["hinge"]
        loaded = hinge | {"mass": mass, "spring": spring, "damping": 0.0, "rest": 5.0}
        return DOOR | {"joints": {"hinge": loaded}}

    with pytest.raises(SpringError, match="too stiff for what it moves") as refused:
        world_with(door(1e5))
    stiffest = float(refused.value.message.split()[-3])
    assert stiffest == pytest.approx(mass * 0.0304 / 0.002**2, rel=0.3)
    world = world_with(door(stiffest))
    for _ in range(500):
        world.step()
    assert abs(world.joint_position("door.hinge")) < math.pi
