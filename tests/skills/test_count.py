"""`count` finds the true number of objects, or fails with AMBIGUOUS."""

from __future__ import annotations

from itertools import product
from typing import Any, TypeAlias

import pytest

from bt_dualarm.behaviors.report import LeafReport
from tests.families import some
from tests.plays import Stage

Objects: TypeAlias = dict[str, dict[str, Any]]
CUBE = {"shape": "box", "size": [0.04, 0.04, 0.04]}
CAN = {"shape": "cylinder", "size": [0.02, 0.05]}
TOP = 0.4


def count(
    stage: Stage,
    kind: dict[str, Any],
    specs: Objects,
    reality: str = "lab",
    **ports: Any,
) -> LeafReport:
    """Report of `count` for red objects of a kind on a table.

    `specs` overrides keys of each object. `at` is its x and y from the image center and the height
    below it.
    """
    objects: dict[str, Any] = {
        "kind": {**kind, "mass": 0.1, "color": "red", "spawned": False}
        | {"pose": {"xyz": [5, 5, 5]}}
    }
    for name, obj in specs.items():
        x, y, below = obj["at"]
        spec = {**kind, "mass": 0.1, "color": "red", "fixed": True}
        spec |= {key: value for key, value in obj.items() if key != "at"}
        half = spec["size"][0] if spec["shape"] == "sphere" else spec["size"][-1] / 2
        pose = {"xyz": [0.38 + x, -0.45 + y, TOP + below + half], "rpy": [0, 0, 15]}
        objects[name] = spec | {"pose": pose}
    look = {"look_at": {"at": {"xyz": [0.38, -0.45, TOP]}, "distance": 0.4, "speed": 1.0}}
    tree = {"sequence": [look, {"count": {"object": "kind"} | ports}]}
    arm = {"robot": "ur5", "base": {"xyz": [0, 0, TOP]}, "camera": {}, "tree": tree}
    file = {
        "world": {"scene": "table", "reality": reality},
        "objects": objects,
        "arms": {
            "arm1": arm | {"tree": {"sequence": [look, {"count": {"object": "kind"} | ports}]}}
        },
    }
    return stage.run(file, seed=2).leaf("count")


def beside(kind: dict[str, Any]) -> float:
    """Distance in m between the centers of two objects that touch, both turned by 15°."""
    return float(kind["size"][0] * (1 if kind["shape"] == "box" else 2))


C15 = 0.9659258
S15 = 0.2588190


@pytest.mark.parametrize("kind", [CUBE, CAN], ids=["cubes", "cans"])
class TestEachKind:
    """Tests with boxes and with cylinders."""

    @pytest.mark.parametrize("number", [0, 1, 2])
    def test_separate_objects_are_counted(
        self, kind: dict[str, Any], number: int, stage: Stage
    ) -> None:
        places: Objects = {"a": {"at": (0.05, 0.02, 0)}, "b": {"at": (-0.05, -0.02, 0)}}
        leaf = count(stage, kind, dict(list(places.items())[:number]))
        assert (leaf.status, leaf.metrics["found"]) == ("SUCCESS", number), leaf.reason

    @pytest.mark.parametrize("reality", ["lab", "rough"])
    def test_two_objects_that_touch_are_ambiguous(
        self, kind: dict[str, Any], reality: str, stage: Stage
    ) -> None:
        """They form one color blob; a third, separate object is counted with certainty."""
        far = beside(kind)
        specs: Objects = {"a": {"at": (0, 0, 0)}, "b": {"at": (far * C15, far * S15, 0)}}
        leaf = count(stage, kind, specs | {"c": {"at": (-0.08, -0.03, 0)}}, reality)
        assert (leaf.code, leaf.metrics["found"], leaf.metrics["unlike"]) == ("AMBIGUOUS", 1, 1)

    @pytest.mark.parametrize(("aside", "reality"), some(product([0.0, 0.08], ["lab", "rough"]), 3))
    def test_stacked_objects_are_not_counted_as_one(
        self, kind: dict[str, Any], aside: float, reality: str, stage: Stage
    ) -> None:
        """From above they look like one nearer object; from the side, like no known shape."""
        specs: Objects = {
            name: {"at": (aside, 0, z * kind["size"][-1])} for z, name in enumerate("ab")
        }
        leaf = count(stage, kind, specs, reality)
        assert (leaf.code, leaf.metrics["found"]) == ("AMBIGUOUS", 0), leaf.reason

    @pytest.mark.parametrize(("ratio", "reality"), some(product([0.75, 1.3], ["lab", "rough"]), 3))
    def test_object_of_another_size_is_not_counted(
        self, kind: dict[str, Any], ratio: float, reality: str, stage: Stage
    ) -> None:
        """One image shows the size, given the height of the table; `others` ignores the object."""
        size = [ratio * edge for edge in kind["size"]]
        specs: Objects = {
            "a": {"at": (0.05, 0.02, 0)},
            "other": {"at": (-0.05, -0.02, 0), "size": size},
        }
        leaf = count(stage, kind, specs, reality)
        assert (leaf.code, leaf.metrics["other_size"]) == ("AMBIGUOUS", 1), leaf.reason
        leaf = count(stage, kind, specs, reality, others=True)
        assert (leaf.status, leaf.metrics["found"]) == ("SUCCESS", 1)


LOW = [
    {"shape": "cylinder", "size": [0.02, 0.021]},
    {"shape": "cylinder", "size": [0.033, 0.021]},
    {"shape": "cylinder", "size": [0.02, 0.01]},
    {"shape": "box", "size": [0.04, 0.04, 0.01]},
]
"""Cans and plates that are no higher than a cube when two are stacked."""


@pytest.mark.parametrize(("kind", "reality"), some(product(LOW, ["lab", "rough"]), 3))
def test_stacked_low_objects_are_not_counted_as_one(
    kind: dict[str, Any], reality: str, stage: Stage
) -> None:
    """Seen from straight above, the upper one is nearer by less than one image can resolve."""
    specs: Objects = {name: {"at": (0, 0, z * kind["size"][-1])} for z, name in enumerate("ab")}
    leaf = count(stage, kind, specs, reality)
    assert (leaf.code, leaf.metrics["found"]) == ("AMBIGUOUS", 0), leaf.reason


@pytest.mark.parametrize("reality", ["lab", "rough"])
def test_low_object_is_counted_if_resolvable_or_declared_unstacked(
    reality: str, stage: Stage
) -> None:
    """One image resolves a height of 21 mm; 10 mm needs ``stacked: false``."""
    alone: Objects = {"a": {"at": (0.02, 0.01, 0)}}
    leaf = count(stage, LOW[0], alone, reality)
    assert (leaf.status, leaf.metrics["found"]) == ("SUCCESS", 1), leaf.reason
    leaf = count(stage, LOW[2], alone, reality)
    assert (leaf.code, leaf.metrics["maybe_stacked"]) == ("AMBIGUOUS", 1)
    assert "stacked: false" in leaf.reason
    leaf = count(stage, LOW[2], alone, reality, stacked=False)
    assert (leaf.status, leaf.metrics["found"]) == ("SUCCESS", 1), leaf.reason


def test_half_covered_object_is_ambiguous(stage: Stage) -> None:
    cover = {"size": [0.06, 0.06, 0.01], "color": "blue", "at": (0.045, 0, 0.041)}
    leaf = count(stage, CUBE, {"a": {"at": (0, 0, 0)}, "cover": cover})
    assert (leaf.code, leaf.metrics["found"]) == ("AMBIGUOUS", 0)


def test_ball_is_not_counted_as_cubes(stage: Stage) -> None:
    ball = {"shape": "sphere", "size": [0.03], "at": (0.06, 0, 0)}
    leaf = count(stage, CUBE, {"a": {"at": (-0.04, 0, 0)}, "ball": ball})
    assert (leaf.status, leaf.metrics["found"], leaf.metrics["unlike"]) == ("SUCCESS", 1, 1)


@pytest.mark.parametrize("height", [None, 0.43])
def test_object_on_a_declared_block_is_counted(height: float | None, stage: Stage) -> None:
    """A cube on a blue block 30 mm high."""
    block = {"size": [0.1, 0.1, 0.03], "color": "blue", "at": (0, 0, 0)}
    leaf = count(stage, CUBE, {"block": block, "a": {"at": (0, 0, 0.03)}}, height=height)
    assert (leaf.status, leaf.metrics["found"]) == ("SUCCESS", 1), leaf.reason


def test_wrong_height_makes_the_count_ambiguous(stage: Stage) -> None:
    """The given height overrides that of the table."""
    leaf = count(stage, CUBE, {"a": {"at": (0, 0, 0)}}, height=0.34)
    assert (leaf.code, leaf.metrics["other_size"]) == ("AMBIGUOUS", 1)


def test_region_limits_the_count(stage: Stage) -> None:
    """Objects outside it are not counted and do not make the count ambiguous."""
    specs: Objects = {
        "inside": {"at": (0.05, 0.02, 0)},
        "outside": {"at": (-0.06, -0.02, 0)},
        "other": {"at": (-0.03, 0.07, 0), "shape": "sphere", "size": [0.02]},
        "on it": {"at": (-0.03, 0.07, 0.03)},
    }
    specs["on_it"] = specs.pop("on it")
    region = {"size": [0.08, 0.1, 0.1], "pose": {"xyz": [0.43, -0.43, TOP + 0.03]}}
    everywhere = count(stage, CUBE, specs)
    assert everywhere.code == "AMBIGUOUS", everywhere
    leaf = count(stage, CUBE, specs, region=region)
    assert (leaf.status, leaf.metrics["found"]) == ("SUCCESS", 1), leaf.reason
    assert leaf.metrics["unlike"] == 0


def test_images_of_a_braking_arm_are_not_averaged(stage: Stage) -> None:
    """The leaf before is halted in the middle of a fast motion of the camera."""
    cubes = {
        f"cube{i}": CUBE | {"color": "red", "fixed": True} | {"pose": {"xyz": [x, -0.45, 0.42]}}
        for i, x in enumerate((0.33, 0.40))
    }
    look = {"look_at": {"at": {"xyz": [0.38, -0.45, TOP]}, "distance": 0.4, "speed": 1.0}}
    aside = {"reach_to_pose": {"offset": {"xyz": [0, 0.12, 0]}, "speed": 1.0}}
    halted = {"force_success": {"child": {"timeout": {"seconds": 0.2, "child": aside}}}}
    tree = {"sequence": [look, halted, {"count": {"object": "cube0"}}]}
    arm = {"robot": "ur5", "base": {"xyz": [0, 0, TOP]}, "camera": {}, "tree": tree}
    play = stage.run({"world": {"scene": "table"}, "objects": cubes, "arms": {"arm1": arm}})
    assert play.leaf("reach_to_pose").code == "HALTED"
    leaf = play.leaf("count")
    assert leaf.status == "SUCCESS", leaf.reason
    assert leaf.metrics["found"] == 2


@pytest.mark.parametrize(
    "beside",
    [
        {"hold_still": {"duration": 2.0}},
        {"reach_to_pose": {"offset": {"xyz": [0, 0.05, 0]}, "speed": 0.05}},
    ],
)
def test_count_works_beside_a_leaf_that_has_the_arm(beside: dict[str, Any], stage: Stage) -> None:
    cube = CUBE | {"color": "red", "fixed": True, "pose": {"xyz": [0.38, -0.45, 0.42]}}
    look = {"look_at": {"at": {"xyz": [0.38, -0.45, TOP]}, "distance": 0.4}}
    tree = {"sequence": [look, {"parallel": [beside, {"count": {"object": "cube0"}}]}]}
    arm = {"robot": "ur5", "base": {"xyz": [0, 0, TOP]}, "camera": {}, "tree": tree}
    file = {"world": {"scene": "table"}, "objects": {"cube0": cube}, "arms": {"arm1": arm}}
    leaf = stage.run(file).leaf("count")
    assert (leaf.status, leaf.metrics.get("found")) == ("SUCCESS", 1), leaf.reason
