"""Objects in a drawer and in other hands, by the arm's own estimates and never true contacts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bt_dualarm.arm.known_objects import KnownObjects
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ObjectSpec, expanded
from bt_dualarm.spec.yaml_reader import with_tuples
from tests.plays import Stage
from tests.sim.worlds import arm, box, file_of
from tests.skills.scenarios import CABINET, CUBE, GRIPPING, PULLS, Tree

FLOOR_Z = 0.5 - 0.06 + 0.006
"""Height of the inner floor of the cabinet's drawer, m."""

IN_DRAWER = (0.45, -0.65, FLOOR_Z + 0.02)
ELSEWHERE = (0.45, -0.30, 0.42)


def world_of(
    objects: dict[str, ObjectSpec], *, sensor: bool = True, at: float = 0.0
) -> tuple[World, KnownObjects]:
    cabinet: dict[str, Any] = dict(CABINET["cabinet"])
    cabinet["joints"] = {"slide": cabinet["joints"]["slide"] | {"sensor": sensor, "at": at}}
    with_joint, _, _ = expanded({"cabinet": ObjectSpec.model_validate(with_tuples(cabinet))})
    world = World(file_of({"arm1": arm("ur5", (0.0, 0.0, 0.4))}, with_joint | objects))
    return world, KnownObjects(world, "arm1")


@pytest.mark.parametrize("at", [0.0, 0.1])
def test_declared_objects_stand_in_the_drawer_and_on_each_other(at: float) -> None:
    """Objects on the fixed top, beside the drawer or far above it do not stand in it."""
    x, y, z = IN_DRAWER
    _, known = world_of(
        {
            "inside": box((x, y + at, z), 0.04),
            "stacked": box((x, y + at, z + 0.04), 0.04),
            "falls": box((x - 0.08, y + at, z + 0.02), 0.04),
            "high": box((x + 0.08, y + at, z + 0.05), 0.04),
            "top": box((x, y, 0.5 + 0.09 + 0.02), 0.04),
            "beside": box(ELSEWHERE, 0.04),
        },
        at=at,
    )
    assert known.standing_on("cabinet.slide") == {"inside", "stacked", "falls"}


def test_unseen_object_does_not_stand_in_the_drawer() -> None:
    """The object touches the drawer in the simulator, but counts only once the arm has seen it."""
    world, known = world_of({"cube": box(ELSEWHERE, 0.04, spawned=False)})
    world.spawn_object("cube", Pose.from_rpy(IN_DRAWER))
    for _ in range(50):
        world.step()
    cube, drawer = world.object_body("cube"), world.object_body("cabinet.slide")
    touching = {frozenset(world.model.geom_bodyid[pair]) for pair in world.data.contact.geom}
    assert frozenset({cube, drawer}) in touching
    assert known.where("cube") is None
    assert known.standing_on("cabinet.slide") == set()
    known.saw("cube", Pose.from_rpy(IN_DRAWER))
    assert known.standing_on("cabinet.slide") == {"cube"}
    known.forget("cube", "it was handed over")
    assert known.standing_on("cabinet.slide") == set()


@pytest.mark.parametrize("sensor", [True, False])
def test_known_objects_move_with_the_drawer(sensor: bool) -> None:
    """The joint's sensor counts or, without one, the pose in which the arm left the drawer."""
    world, known = world_of({"cube": box(IN_DRAWER, 0.04)}, sensor=sensor)
    assert known.pose("cube").pose.position == pytest.approx(IN_DRAWER)
    joint = world.model.body_jntadr[world.object_body("cabinet.slide")]
    world.data.qpos[world.model.jnt_qposadr[joint]] = 0.1
    world.sense()
    if not sensor:
        assert known.pose("cube").pose.position == pytest.approx(IN_DRAWER)
        known.saw("cabinet.slide", Pose.from_rpy((0.45, -0.55, 0.5)))
    moved = known.pose("cube")
    assert moved.by == "declared"
    assert moved.pose.position == pytest.approx(np.add(IN_DRAWER, (0.0, 0.1, 0.0)))


def bin_at(x: float, y: float, z: float, content_m: float) -> dict[str, ObjectSpec]:
    """A bin whose bottom is at a point, and a cube of an edge on its floor."""
    given = {"shape": "bin", "size": (0.06, 0.045, 0.03), "wall": 0.003, "mass": 0.06}
    container = ObjectSpec.model_validate(given | {"pose": {"xyz": (x, y, z + 0.015)}})
    return {"bin": container, "content": box((x, y, z + 0.003 + 0.5 * content_m), content_m)}


@pytest.mark.parametrize("content_m", [0.004, 0.02, 0.04])
def test_content_of_a_bin_in_the_drawer_stands_in_the_drawer_like_the_bin(content_m: float) -> None:
    """The bin stands on the drawer, not on what is within it, however high that is."""
    x, y, _ = IN_DRAWER
    _, known = world_of(bin_at(x, y, FLOOR_Z, content_m))
    assert known.standing_on("cabinet.slide") == {"bin", "content"}


@pytest.mark.parametrize("content_m", [0.004, 0.02, 0.04])
def test_content_of_a_bin_moves_with_it_from_the_hand_into_the_drawer(content_m: float) -> None:
    """The bin and its content were believed to stand on each other, without end."""
    x, y, _ = ELSEWHERE
    world, known = world_of(bin_at(x, y, 0.0, content_m))
    for _ in range(50):
        world.step()
    world.attach("arm1", "bin")
    known.took("bin")
    known.left("bin")
    world.attachments.detach("arm1", "bin")
    before = known.pose("bin").pose.inverse @ known.pose("content").pose
    assert known.standing_on("cabinet.slide") == set()

    known.saw("bin", Pose.from_rpy((*IN_DRAWER[:2], FLOOR_Z + 0.015)))
    assert known.standing_on("cabinet.slide") == {"bin", "content"}
    joint = world.model.body_jntadr[world.object_body("cabinet.slide")]
    world.data.qpos[world.model.jnt_qposadr[joint]] = 0.1
    world.sense()
    after = known.pose("bin").pose.inverse @ known.pose("content").pose
    assert after.distance(before) < 1e-9
    assert known.pose("bin").pose.position[1] == pytest.approx(IN_DRAWER[1] + 0.1)

    upside_down = Pose.from_rpy((*ELSEWHERE[:2], ELSEWHERE[2] + 0.1), (np.pi, 0.0, 0.0))
    known.saw("bin", upside_down)  # its content is believed to be below it then
    assert known.pose("bin").pose.distance(upside_down) < 1e-9
    assert known.standing_on("cabinet.slide") == set()


def test_unknown_object_in_the_drawer_does_not_keep_the_arm_from_opening_it(stage: Stage) -> None:
    """The object appeared there after the check, put there by no arm: no skill may look it up."""
    cube = CUBE | {
        "size": [0.04, 0.04, 0.04],
        "spawned": False,
        "pose": {"xyz": [0.45, -0.2, 0.42]},
    }
    pull: Tree = {"operate": {"object": "cabinet", "joint": "slide", "to": 0.12}}
    play = stage.play(
        {
            "world": {"scene": "table", "reality": "lab", "time_limit": 30},
            "objects": CABINET | {"cube": cube},
            "arms": {"arm1": GRIPPING | {"tree": {"sequence": [PULLS, pull]}}},
        },
        interventions=[(0.05, lambda world: world.spawn_object("cube", Pose.from_rpy(IN_DRAWER)))],
    )
    assert play.run().outcome == "SUCCESS", play.leaves("operate")


def test_object_seen_in_the_hand_of_another_arm_moves_with_it_until_that_arm_releases_it() -> None:
    """Of equivalent poses of a symmetric object, the nearest to that arm's estimate counts."""
    arms = {"arm1": arm("ur5", (0.0, 0.0, 0.4)), "arm2": arm("ur5", (1.0, 0.0, 0.4))}
    world = World(file_of(arms, {"bar": box((0.4, 0.4, 0.5), 0.04)}))
    known = KnownObjects(world, "arm1")
    tool = world.nominal["arm2"].tool_link_pose_at(world.hardware["arm2"].q)
    world.attach("arm2", "bar")
    estimate = world.attachments.find("arm2", "bar")
    assert estimate is not None
    half_turn = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, np.pi))
    slid = estimate.relative @ Pose.from_rpy((0.01, 0.0, 0.0), (0.0, 0.0, 0.1))

    def canonical(pose: Pose) -> Pose:
        """The bar looks the same after half a turn about its z axis."""
        return min((pose, pose @ half_turn), key=Pose.identity().angle)

    known.located("bar", tool @ slid @ half_turn, canonical)
    seen = known.seen_in_hand("bar", "arm2")
    assert seen is not None
    assert seen.distance(slid) < 1e-9
    assert seen.angle(slid) < 1e-6
    assert known.seen_in_hand("bar", "arm1") is None

    q = world.hardware["arm2"].q + 0.2
    world.hardware["arm2"].q[:] = q
    there = world.nominal["arm2"].tool_link_pose_at(q) @ slid
    assert known.pose("bar").pose.distance(there) < 1e-9
    assert known.pose("bar").by == "seen"

    world.attachments.detach("arm2", "bar")
    assert known.seen_in_hand("bar", "arm2") is None
    with pytest.raises(Failure, match="in the hand of arm2, which has released it"):
        known.pose("bar")
