"""What `place` does and says about goals at which an object would not stay."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.skill.placing import SettingDown
from bt_dualarm.spec.document import ObjectSpec
from tests.plays import Stage
from tests.skills.scenarios import GRIPPING, Scenario, Tree
from tests.skills.test_unnamed_objects import failure


def test_unstable_capsule_is_not_blamed_on_the_support() -> None:
    """The table is level, but a capsule cannot stand on its end."""
    code, reason = failure(
        {
            "sequence": [
                {"grasp": {"object": "cube"}},
                {"place": {"at": {"xyz": [0.30, -0.45, 0.44], "rpy": [0, 0, 0]}}},
            ]
        },
        shape="capsule",
        size=[0.02, 0.04],
        pose={"xyz": [0.40, -0.45, 0.42], "rpy": [90, 0, 0]},
    )
    assert code == "NOT_SUPPORTED", reason
    assert "not level" not in reason
    assert "give `at` an orientation in which it lies" in reason


SHAPES: dict[str, Tree] = {
    "box": {"shape": "box", "size": [0.04, 0.05, 0.05]},
    "can": {"shape": "cylinder", "size": [0.02, 0.06]},
}


@pytest.mark.parametrize("robot", ["ur5", "panda"])
@pytest.mark.parametrize("name", list(SHAPES))
@pytest.mark.parametrize(
    "turn", [{"angle": 8, "axis": [1, 0, 0]}, {"angle": -20, "axis": [1, 1, 0]}]
)
def test_an_object_that_is_held_tilted_is_placed_upright(
    robot: str, name: str, turn: Tree, stage: Stage
) -> None:
    """So an arm holds one that was halted in the middle of a motion: NOT_SUPPORTED."""
    shape = SHAPES[name]
    height = 0.5 * shape["size"][-1]
    thing = shape | {"mass": 0.1, "pose": {"xyz": [0.40, -0.45, 0.4005 + height]}}
    gripper = "panda_hand" if robot == "panda" else "robotiq_2f85"
    arm = GRIPPING | {"robot": robot, "gripper": gripper}
    place = {"place": {"at": {"xyz": [0.30, -0.35, 0.4005 + height]}}}
    leaves: list[Tree] = [{"grasp": {"object": "thing"}}, {"rotate_tool": turn}, place]
    file = Scenario({"thing": thing}, arm=arm, scene="table").file(*leaves)
    play = stage.run(file)
    assert play.leaf("place").status == "SUCCESS", play.leaf("place").reason
    assert abs(play.world.object_pose("thing").rotation_matrix[2, 2]) > 0.9999


@pytest.mark.parametrize("robot", ["ur5", "panda"])
@pytest.mark.parametrize("angle", [-120, 147])
def test_an_object_that_is_held_upside_down_is_placed_as_it_stood(
    robot: str, angle: float, stage: Stage
) -> None:
    """So an arm held a can that was halted on its way around: the hand would be in the floor.

    Tilted by 120°, it was lowered until something else touched: its lowest point is too high.
    """
    can = {"shape": "cylinder", "size": [0.02, 0.12], "mass": 0.1}
    site: Tree = {"shape": "box", "size": [0.2, 0.2, 0.2], "mass": 1, "fixed": True}
    objects: Tree = {
        "can": can | {"pose": {"xyz": [0.45, -0.3, 0.2605]}},
        "from": site | {"pose": {"xyz": [0.45, -0.3, 0.1]}},
        "to": site | {"pose": {"xyz": [0.45, 0.2, 0.1]}},
    }
    gripper = "panda_hand" if robot == "panda" else "robotiq_2f85"
    arm = GRIPPING | {"robot": robot, "gripper": gripper}
    leaves: list[Tree] = [
        {"grasp": {"object": "can"}},
        {"transport": {"to": {"xyz": [0.4, 0, 0.6]}}},
        {"rotate_tool": {"angle": angle, "axis": [1, 0, 0], "frame": "world"}},
        {"place": {"at": {"xyz": [0.45, 0.2, 0.2605]}}},
    ]
    play = stage.run(Scenario(objects, arm=arm, scene="empty").file(*leaves))
    assert play.leaf("place").status == "SUCCESS", play.leaf("place").reason
    assert play.world.object_pose("can").rotation_matrix[2, 2] > 0.9999


@pytest.mark.parametrize("robot", ["ur5", "panda"])
@pytest.mark.parametrize("angle", [4.9, 8, 25])
def test_a_long_object_that_is_held_tilted_is_placed_on_something(
    robot: str, angle: float, stage: Stage
) -> None:
    """A goal on something follows from the lowest point of the object, which was far below."""
    bar: Tree = {"shape": "box", "size": [0.16, 0.03, 0.03], "mass": 0.15}
    bar["pose"] = {"xyz": [0.40, -0.45, 0.4155]}
    box: Tree = {"shape": "box", "size": [0.2, 0.2, 0.05], "mass": 5, "fixed": True}
    box["pose"] = {"xyz": [0.30, -0.25, 0.4255]}
    gripper = "panda_hand" if robot == "panda" else "robotiq_2f85"
    arm = GRIPPING | {"robot": robot, "gripper": gripper}
    turn = {"rotate_tool": {"angle": angle, "axis": [0, 1, 0], "frame": "world"}}
    leaves: list[Tree] = [{"grasp": {"object": "bar"}}, turn, {"place": {"at": {"on": "box"}}}]
    file = Scenario({"bar": bar, "box": box}, arm=arm, scene="table").file(*leaves)
    play = stage.run(file)
    assert play.leaf("place").status == "SUCCESS", play.leaf("place").reason
    assert float(play.leaf("place").metrics["placed_turned_rad"]) < 0.01
    assert play.world.object_pose("bar").position[2] == pytest.approx(0.4655, abs=0.002)


@pytest.mark.parametrize("rpy", [(0.0, 0.0, 0.7), (np.pi, 0.0, 0.0), (0.0, 2.5, 0.3)])
def test_an_object_is_turned_upright_from_any_orientation(rpy: tuple[float, float, float]) -> None:
    """Exactly upright or upside down, no direction to turn in follows from the two axes."""
    world = SimpleNamespace(
        objects={"box": ObjectSpec(shape="box", size=(0.05, 0.05, 0.1), mass=0.1)}
    )
    setting_down: Any = SimpleNamespace(
        _arm=SimpleNamespace(world=world),
        _name="box",
        _support_at=lambda _: SimpleNamespace(below=0.0),
    )
    goal = Pose.from_rpy((0.5, 0.0, 0.05), rpy)
    found = SettingDown._standing(setting_down, goal, np.array((0.0, 0.0, 1.0)))
    assert found is not None
    assert found.rotation_matrix[2, 2] == pytest.approx(1.0)
