"""Symmetric objects may be rotated by their symmetry where the goal is out of reach otherwise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from bt_dualarm.behaviors.report import LeafReport
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose
from bt_dualarm.perception.known_shape import KnownShape
from bt_dualarm.sim.world import World
from bt_dualarm.skill.inserting import Inserting
from bt_dualarm.skill.symmetry import goals_alike, poses_alike, turns_alike
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.yaml_reader import with_tuples
from tests.families import some
from tests.plays import Stage
from tests.skills.test_placing_paths import board, placed

OBJECTS: dict[str, dict[str, Any]] = {
    "cylinder": {"shape": "cylinder", "size": [0.025, 0.10], "mass": 0.3},
    "capsule": {"shape": "capsule", "size": [0.022, 0.06], "mass": 0.2},
    "box": {"shape": "box", "size": [0.05, 0.05, 0.10], "mass": 0.3},
    "prism": {"shape": "prism", "size": [0.027, 0.10], "mass": 0.3},
}
MARKER = {"marker": {"id": 1, "size": 0.02}}


def cross(bars: int, at: Sequence[float] = (0.0, 0.0, 0.0)) -> dict[str, Any]:
    """A compound of equal bars about an axis through a point of its frame."""
    bar = {"shape": "box", "size": [0.08, 0.01, 0.03]}
    yaws = [180.0 * number / bars for number in range(bars)]
    parts = {f"bar{i}": bar | {"pose": {"xyz": at, "rpy": [0, 0, yaws[i]]}} for i in range(bars)}
    return {"shape": "compound", "parts": parts}


@cache
def carried(kind: str, roll: float, *, marked: bool = False) -> LeafReport:
    """A Panda's `transport` under a board of an object grasped from the side."""
    obj = OBJECTS[kind] | (MARKER if marked else {})
    goal = {"xyz": [0.55, 0.1, 0.63], "rpy": [roll, 0, -90]}
    return placed(
        "panda",
        "panda_hand",
        {
            "thing": obj | {"pose": {"xyz": [0.40, -0.40, 0.45]}},
            "low": board(0.55, 0.1, 0.55),
            "high": board(0.55, 0.1, 0.78),
        },
        {"grasp": {"object": "thing", "approach": [0, -1, 0]}},
        {"transport": {"object": "thing", "to": {"xyz": [0.40, -0.2, 0.70]}}},
        {"transport": {"object": "thing", "to": goal}},
    )


@pytest.mark.parametrize(
    ("kind", "roll", "fold"),
    some([("cylinder", 0, 24), ("prism", 0, 6), ("capsule", 20, 24), ("box", 0, 4)], 2),
)
def test_carried_object_is_rotated_by_its_symmetry(kind: str, roll: float, fold: int) -> None:
    """The requested orientation is out of reach; the rotation is about the object's own axis."""
    leaf = carried(kind, roll)
    assert leaf.status == "SUCCESS", leaf.reason
    turns = float(leaf.metrics["spun_rad"]) * fold / (2.0 * np.pi)
    assert turns == pytest.approx(round(turns))
    assert float(leaf.metrics["object_turned_rad"]) < np.radians(1.0)
    assert float(leaf.metrics["believed_turned_rad"]) < np.radians(1.0)


@pytest.mark.parametrize("kind", ["box", "cylinder"])
def test_carried_object_is_not_rotated_if_that_is_visible(kind: str) -> None:
    """The marker would not be where it was requested."""
    leaf = carried(kind, 0, marked=True)
    assert leaf.code == "UNREACHABLE", leaf.reason
    assert "object_error_m" not in leaf.metrics, "refused before any motion"


def test_carried_object_may_have_been_located_turned_by_its_symmetry(stage: Stage) -> None:
    """Its frame, beside it, is not where the arm takes it to be, but it is where it should be."""
    at = (0.03, 0.05, 0.0)

    def frame(x: float, y: float, z: float, yaw: float) -> dict[str, Any]:
        pose = Pose.from_rpy((x, y, z), (0, 0, np.radians(yaw))) @ Pose.from_rpy(at).inverse
        return {"xyz": pose.position.tolist(), "rpy": [0, 0, yaw]}

    thing = cross(2, at) | {"mass": 0.1, "color": "red", "pose": frame(0.45, 0.1, 0.016, 77)}
    top = {
        "shape": "box",
        "size": [1.2, 1.2, 0.02],
        "fixed": True,
        "pose": {"xyz": [0.4, 0, -0.01]},
    }
    goal = frame(0.45, -0.15, 0.15, -130)
    steps: list[dict[str, Any]] = [
        {"look_at": {"at": {"xyz": [0.45, 0.1, 0.02]}, "distance": 0.35}},
        {"locate": {"object": "thing", "pose": "{seen}"}},
        {"grasp": {"object": "thing", "at": "{seen}"}},
        {"transport": {"object": "thing", "to": goal}},
    ]
    arm = {"robot": "ur5e", "gripper": "robotiq_2f85", "camera": {}, "tree": {"sequence": steps}}
    world = {"scene": "empty", "reality": "lab"}
    play = stage.run(
        {"world": world, "objects": {"top": top, "thing": thing}, "arms": {"arm1": arm}}
    )
    leaf = play.leaf("transport")
    assert leaf.status == "SUCCESS", leaf.reason
    assert float(leaf.metrics["object_error_m"]) < 0.002
    true = play.world.object_pose("thing")
    assert true.position[:2] != pytest.approx(goal["xyz"][:2], abs=0.03), "no other pose was shown"


class _Above(Failure):
    """Ends `insert` when the peg is above the hole."""


@pytest.mark.parametrize(("shape", "yaw"), some([("prism", 90), ("box", -60), ("prism", -90)], 2))
def test_peg_is_rotated_by_its_symmetry_above_its_hole(
    shape: str, yaw: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A Panda that holds the peg from the side cannot reach the requested orientation."""

    def above(_: Inserting) -> Iterator[None]:
        raise _Above("NOT_FOUND", "above the hole")
        yield

    monkeypatch.setattr(Inserting, "through", above)
    size = [0.02, 0.1] if shape == "prism" else [0.03, 0.03, 0.1]
    post = {"shape": "box", "size": [0.1, 0.1, 0.2], "fixed": True}
    hole = {"shape": "tube", "size": [0.04, 0.05], "wall": 0.018, "fixed": True}
    leaf = placed(
        "panda",
        "panda_hand",
        {
            "thing": {"shape": shape, "size": size, "mass": 0.2}
            | {"pose": {"xyz": [0.45, -0.25, 0.65]}},
            "stand": post | {"pose": {"xyz": [0.45, -0.25, 0.5]}},
            "hole": hole | {"pose": {"xyz": [0.45, 0.25, 0.625]}},
            "base": post | {"pose": {"xyz": [0.45, 0.25, 0.5]}},
        },
        {"grasp": {"object": "thing", "approach": [0, -1, 0]}},
        {
            "insert": {
                "object": "thing",
                "at": {"xyz": [0.45, 0.25, 0.65], "rpy": [0, 0, yaw]},
                "depth": 0.04,
            }
        },
    )
    assert leaf.reason == "above the hole"
    turns = float(leaf.metrics["spun_rad"]) / np.radians(60 if shape == "prism" else 90)
    assert turns == pytest.approx(round(turns))


@pytest.mark.parametrize("rpy", [(0, 0, 0), (0, 0, 40), (180, 0, 10), (30, 20, 10), (90, 0, 0)])
@pytest.mark.parametrize(
    ("fields", "count"),
    [
        ({"shape": "cylinder", "size": [0.03, 0.1]}, 24),
        ({"shape": "sphere", "size": [0.03]}, 24),
        ({"shape": "cup", "size": [0.03, 0.1]}, 24),
        ({"shape": "prism", "size": [0.03, 0.1], "sides": 5}, 5),
        ({"shape": "prism", "size": [0.05, 0.1], "sides": 6} | MARKER, 1),
        ({"shape": "box", "size": [0.05, 0.05, 0.1]}, 4),
        ({"shape": "box", "size": [0.05, 0.06, 0.1]}, 2),
        ({"shape": "box", "size": [0.05, 0.05, 0.1]} | MARKER, 1),
        ({"shape": "cylinder", "size": [0.03, 0.1]} | MARKER, 1),
        ({"shape": "bin", "size": [0.05, 0.05, 0.1]}, 1),
        (cross(4), 8),
        (cross(2, at=[0.1, -0.2, 0.3]), 4),
        (cross(3), 6),
        (cross(1, at=[0.1, -0.2, 0.3]), 2),
    ],
)
def test_equivalent_poses_are_symmetric(
    fields: dict[str, Any], count: int, rpy: tuple[float, float, float]
) -> None:
    """Each is the goal up to the symmetry of the object, about its center; the goal is first."""
    spec = ObjectSpec.model_validate(with_tuples(fields | {"mass": 0.1}))
    goal = Pose.from_rpy((0.1, 0.2, 0.3), np.radians(rpy).tolist())
    alike = poses_alike(spec, goal)
    assert alike[0] == (0.0, goal)
    assert np.all(np.diff(np.abs([angle for angle, _ in alike])) >= -1e-12)
    shape = KnownShape.of(spec)
    center = np.array(shape.center)
    for angle, pose in alike:
        assert pose.apply(center) == pytest.approx(goal.apply(center))
        assert shape.away(pose, goal) == pytest.approx((0.0, 0.0), abs=1e-6)
        assert pose.angle(goal) == pytest.approx(abs(angle), abs=1e-6)
        assert shape.angle(pose, goal) < 1e-6
    if rpy[0] in (0, 180) and rpy[1] == 0:
        assert len(alike) == count
    elif spec.shape == "prism" or (spec.shape in ("box", "compound") and rpy[0] != 90):
        assert len(alike) == 1, "a tilted object has no equivalent pose, which keeps the pads level"


@pytest.mark.parametrize("rpy", [(0, 0, 0), (0, 0, 40), (180, 0, 10), (30, 20, 10), (90, 0, 0)])
@pytest.mark.parametrize(
    ("fields", "count"),
    [
        ({"shape": "cylinder", "size": [0.03, 0.1]}, 48),
        ({"shape": "capsule", "size": [0.03, 0.1]}, 48),
        ({"shape": "sphere", "size": [0.03]}, 24),
        ({"shape": "cup", "size": [0.03, 0.1]}, 24),
        ({"shape": "prism", "size": [0.03, 0.1], "sides": 5}, 10),
        ({"shape": "prism", "size": [0.05, 0.1], "sides": 6} | MARKER, 1),
        ({"shape": "box", "size": [0.05, 0.05, 0.1]}, 8),
        ({"shape": "box", "size": [0.05, 0.06, 0.1]}, 4),
        ({"shape": "box", "size": [0.05, 0.05, 0.1]} | MARKER, 1),
        ({"shape": "bin", "size": [0.05, 0.05, 0.1]}, 1),
    ],
)
def test_what_looks_the_same_upside_down_may_be_turned_over(
    fields: dict[str, Any], count: int, rpy: tuple[float, float, float]
) -> None:
    """Half of the poses are turned over; none of a cup, a bin, or what has a marker."""
    goal = Pose.from_rpy((0.1, 0.2, 0.3), np.radians(rpy).tolist())
    spec = ObjectSpec.model_validate(with_tuples(fields | {"mass": 0.1}))
    world = MagicMock(spec=World)
    world.declared_objects = {"thing": spec}
    world.passengers_of.return_value = ()
    alike = goals_alike(world, "thing", goal)
    same = poses_alike(spec, goal)
    assert repr(alike[: len(same)]) == repr(same)
    for angle, pose in alike[len(same) :]:
        assert abs(angle) == pytest.approx(np.pi)
        assert KnownShape.of(spec).away(pose, goal) == pytest.approx((0.0, 0.0), abs=1e-6)
    if rpy[0] in (0, 180) and rpy[1] == 0:
        assert len(alike) == count
    world.passengers_of.return_value = ("rider",)
    assert repr(goals_alike(world, "thing", goal)) == repr(same), "what stands on it would fall off"


@pytest.mark.parametrize(
    ("fields", "axis", "count"),
    [
        ({"shape": "box", "size": (0.03, 0.03, 0.1)}, 2, 4),
        ({"shape": "box", "size": (0.1, 0.03, 0.03)}, 0, 4),
        ({"shape": "box", "size": (0.03, 0.03, 0.03)}, 2, 4),
        ({"shape": "box", "size": (0.03, 0.1, 0.05)}, 1, 2),
        ({"shape": "prism", "size": (0.02, 0.1)}, 2, 6),
        ({"shape": "cylinder", "size": (0.02, 0.1)}, 2, 24),
        ({"shape": "box", "size": (0.05, 0.05, 0.1)} | MARKER, 2, 1),
        ({"shape": "bin", "size": (0.1, 0.1, 0.05)}, 2, 1),
        (cross(4), 2, 8),
        (cross(3, at=(0.1, -0.2, 0.3)), 2, 6),
    ],
)
def test_symmetries_are_rotations_about_the_axis(
    fields: dict[str, Any], axis: int, count: int
) -> None:
    """Each rotation preserves the axis and the appearance; the identity is first."""
    spec = ObjectSpec.model_validate(with_tuples(fields | {"mass": 0.1}))
    turns = turns_alike(spec)
    assert len(turns) == count
    assert turns[0].angle(Pose.identity()) == pytest.approx(0.0)
    for turn in turns:
        assert turn.turn(np.eye(3)[axis]) == pytest.approx(np.eye(3)[axis])
        away = KnownShape.of(spec).away(turn, Pose.identity())
        assert away == pytest.approx((0.0, 0.0), abs=1e-6)
