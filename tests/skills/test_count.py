"""What is counted is there, so many times; where a picture cannot tell, it is said."""

from __future__ import annotations

from itertools import product
from typing import Any, TypeAlias

import pytest

from bt_dualarm.behaviors.report import LeafReport
from tests.families import some
from tests.plays import Stage

Things: TypeAlias = dict[str, dict[str, Any]]
CUBE = {"shape": "box", "size": [0.04, 0.04, 0.04]}
CAN = {"shape": "cylinder", "size": [0.02, 0.05]}
TOP = 0.4


def count(
    stage: Stage,
    kind: dict[str, Any],
    things: Things,
    reality: str = "lab",
    **ports: Any,
) -> LeafReport:
    """What `count` says of red things of a kind, each but for what is said of it, on a table.

    Their places are by x and y from the middle of the picture, and by what is below them.
    """
    objects: dict[str, Any] = {
        "kind": {**kind, "mass": 0.1, "color": "red", "spawned": False}
        | {"pose": {"xyz": [5, 5, 5]}}
    }
    for name, obj in things.items():
        x, y, below = obj["at"]
        spec = {**kind, "mass": 0.1, "color": "red", "fixed": True}
        spec |= {key: value for key, value in obj.items() if key != "at"}
        half = spec["size"][0] if spec["shape"] == "sphere" else spec["size"][-1] / 2
        pose = {"xyz": [0.38 + x, -0.45 + y, TOP + below + half], "rpy": [0, 0, 15]}
        objects[name] = spec | {"pose": pose}
    look = {"look_at": {"at": {"xyz": [0.38, -0.45, TOP]}, "distance": 0.4}}
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
    """Distance in m of the middles of two that touch, turned by 15° as they are: side by side."""
    return float(kind["size"][0] * (1 if kind["shape"] == "box" else 2))


C15 = 0.9659258
S15 = 0.2588190


@pytest.mark.parametrize("kind", [CUBE, CAN], ids=["cubes", "cans"])
class TestEachKind:
    """Boxes and cylinders alike."""

    @pytest.mark.parametrize("number", [0, 1, 2])
    def test_those_apart_are_counted(self, kind: dict[str, Any], number: int, stage: Stage) -> None:
        places: Things = {"a": {"at": (0.05, 0.02, 0)}, "b": {"at": (-0.05, -0.02, 0)}}
        leaf = count(stage, kind, dict(list(places.items())[:number]))
        assert (leaf.status, leaf.metrics["found"]) == ("SUCCESS", number), leaf.reason

    @pytest.mark.parametrize("reality", ["lab", "rough"])
    def test_two_that_touch_are_not_counted_as_none(
        self, kind: dict[str, Any], reality: str, stage: Stage
    ) -> None:
        """They make one patch; another one, apart, is certain."""
        far = beside(kind)
        things: Things = {"a": {"at": (0, 0, 0)}, "b": {"at": (far * C15, far * S15, 0)}}
        leaf = count(stage, kind, things | {"c": {"at": (-0.08, -0.03, 0)}}, reality)
        assert (leaf.code, leaf.metrics["found"], leaf.metrics["unlike"]) == ("AMBIGUOUS", 1, 1)

    @pytest.mark.parametrize(("aside", "reality"), some(product([0.0, 0.08], ["lab", "rough"]), 3))
    def test_one_on_another_is_not_counted_as_one(
        self, kind: dict[str, Any], aside: float, reality: str, stage: Stage
    ) -> None:
        """From above they look like one that is nearer; from aside, like nothing known."""
        things: Things = {
            name: {"at": (aside, 0, z * kind["size"][-1])} for z, name in enumerate("ab")
        }
        leaf = count(stage, kind, things, reality)
        assert (leaf.code, leaf.metrics["found"]) == ("AMBIGUOUS", 0), leaf.reason

    @pytest.mark.parametrize(("ratio", "reality"), some(product([0.75, 1.3], ["lab", "rough"]), 3))
    def test_another_size_is_not_counted(
        self, kind: dict[str, Any], ratio: float, reality: str, stage: Stage
    ) -> None:
        """One picture tells it by the table on which it stands; with `others` it is left out."""
        size = [ratio * edge for edge in kind["size"]]
        things: Things = {
            "a": {"at": (0.05, 0.02, 0)},
            "other": {"at": (-0.05, -0.02, 0), "size": size},
        }
        leaf = count(stage, kind, things, reality)
        assert (leaf.code, leaf.metrics["other_size"]) == ("AMBIGUOUS", 1), leaf.reason
        leaf = count(stage, kind, things, reality, others=True)
        assert (leaf.status, leaf.metrics["found"]) == ("SUCCESS", 1)


LOW = [
    {"shape": "cylinder", "size": [0.02, 0.021]},
    {"shape": "cylinder", "size": [0.033, 0.021]},
    {"shape": "cylinder", "size": [0.02, 0.01]},
    {"shape": "box", "size": [0.04, 0.04, 0.01]},
]
"""Cans and plates of which two on one another are no higher than a cube."""


@pytest.mark.parametrize(("kind", "reality"), some(product(LOW, ["lab", "rough"]), 3))
def test_low_ones_on_one_another_are_not_counted_as_one(
    kind: dict[str, Any], reality: str, stage: Stage
) -> None:
    """Straight from above: the upper one is nearer by less than one picture shows."""
    things: Things = {name: {"at": (0, 0, z * kind["size"][-1])} for z, name in enumerate("ab")}
    leaf = count(stage, kind, things, reality)
    assert (leaf.code, leaf.metrics["found"]) == ("AMBIGUOUS", 0), leaf.reason


@pytest.mark.parametrize("reality", ["lab", "rough"])
def test_a_low_one_is_counted_where_the_picture_tells_or_somebody_says(
    reality: str, stage: Stage
) -> None:
    """21 mm are enough for one picture; of 10 mm it takes somebody who knows."""
    alone: Things = {"a": {"at": (0.02, 0.01, 0)}}
    leaf = count(stage, LOW[0], alone, reality)
    assert (leaf.status, leaf.metrics["found"]) == ("SUCCESS", 1), leaf.reason
    leaf = count(stage, LOW[2], alone, reality)
    assert (leaf.code, leaf.metrics["maybe_stacked"]) == ("AMBIGUOUS", 1)
    assert "stacked: false" in leaf.reason
    leaf = count(stage, LOW[2], alone, reality, stacked=False)
    assert (leaf.status, leaf.metrics["found"]) == ("SUCCESS", 1), leaf.reason


def test_what_is_half_covered_is_in_doubt(stage: Stage) -> None:
    cover = {"size": [0.06, 0.06, 0.01], "color": "blue", "at": (0.045, 0, 0.041)}
    leaf = count(stage, CUBE, {"a": {"at": (0, 0, 0)}, "cover": cover})
    assert (leaf.code, leaf.metrics["found"]) == ("AMBIGUOUS", 0)


def test_a_ball_is_no_cube_nor_several(stage: Stage) -> None:
    ball = {"shape": "sphere", "size": [0.03], "at": (0.06, 0, 0)}
    leaf = count(stage, CUBE, {"a": {"at": (-0.04, 0, 0)}, "ball": ball})
    assert (leaf.status, leaf.metrics["found"], leaf.metrics["unlike"]) == ("SUCCESS", 1, 1)


@pytest.mark.parametrize("height", [None, 0.43])
def test_what_stands_on_something_declared_is_counted(height: float | None, stage: Stage) -> None:
    """A cube on a blue block 30 mm high."""
    block = {"size": [0.1, 0.1, 0.03], "color": "blue", "at": (0, 0, 0)}
    leaf = count(stage, CUBE, {"block": block, "a": {"at": (0, 0, 0.03)}}, height=height)
    assert (leaf.status, leaf.metrics["found"]) == ("SUCCESS", 1), leaf.reason


def test_a_wrong_height_makes_doubt(stage: Stage) -> None:
    """The height that is given counts, not that of the table."""
    leaf = count(stage, CUBE, {"a": {"at": (0, 0, 0)}}, height=0.34)
    assert (leaf.code, leaf.metrics["other_size"]) == ("AMBIGUOUS", 1)


def test_region_limits_what_counts(stage: Stage) -> None:
    """What is elsewhere neither counts nor makes the count ambiguous."""
    things: Things = {
        "inside": {"at": (0.05, 0.02, 0)},
        "outside": {"at": (-0.06, -0.02, 0)},
        "other": {"at": (-0.03, 0.07, 0), "shape": "sphere", "size": [0.02]},
        "on it": {"at": (-0.03, 0.07, 0.03)},
    }
    things["on_it"] = things.pop("on it")
    region = {"size": [0.08, 0.1, 0.1], "pose": {"xyz": [0.43, -0.43, TOP + 0.03]}}
    everywhere = count(stage, CUBE, things)
    assert everywhere.code == "AMBIGUOUS", everywhere
    leaf = count(stage, CUBE, things, region=region)
    assert (leaf.status, leaf.metrics["found"]) == ("SUCCESS", 1), leaf.reason
    assert leaf.metrics["unlike"] == 0
