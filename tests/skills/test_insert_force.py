"""Force of a peg on the rim of its hole during the search."""

from __future__ import annotations

import argparse

import mujoco
import numpy as np
import pytest
import yaml

import bt_dualarm as bt
from benchmarks import inserting
from bt_dualarm.core.share import share_dir

LIMIT_N = 10.0
"""Force on the rim that was exceeded when the compensation of hops included contact force, N."""


@pytest.mark.parametrize("seed", [44])
def test_search_hops_press_lightly_on_the_rim(seed: int) -> None:
    """A UR10 has the highest joint friction, so that an error of its model presses hardest."""
    options = {
        "robot": "ur10",
        "gripper": "robotiq_2f85",
        "reality": "lab",
        "shape": "cylinder",
        "direction": "down",
    }
    file, _ = inserting.task(argparse.Namespace(**options), seed)
    pressed = [0.0]
    with bt.open(file) as run:
        world = run.world
        peg = world.payload_geoms("peg")
        arm = world.arms["arm1"].geom_ids
        rim = inserting.TABLE + inserting.HIGH + 0.04 - 0.0003
        force = np.empty(6)

        def record_force() -> None:
            if world.object_pose("peg").position[2] < rim:
                return  # on the table before the grasp, or in the hole
            total = np.zeros(3)
            for number, pair in enumerate(world.data.contact.geom.tolist()):
                if peg & set(pair) and not arm & set(pair):
                    mujoco.mj_contactForce(world.model, world.data, number, force)
                    axes = world.data.contact.frame[number].reshape(3, 3)
                    total += (1.0 if pair[1] in peg else -1.0) * (force[:3] @ axes)
            pressed[0] = max(pressed[0], float(np.linalg.norm(total)))

        world.on_forces.append(record_force)
        leaf = run.finish().arms["arm1"].runs[-1]
    assert leaf.status == "SUCCESS", leaf.reason
    assert int(leaf.metrics["search_places"]) > 2
    assert 1.0 < pressed[0] < LIMIT_N


def test_rim_that_is_nearer_than_expected_is_touched_lightly() -> None:
    """The descent began almost at the rim: the peg was pressed along the fingers, with 50 N."""
    options = {
        "robot": "ur5",
        "gripper": "robotiq_2f85",
        "reality": "lab",
        "shape": "cylinder",
        "direction": "down",
    }
    file, _ = inserting.task(argparse.Namespace(**options), 43)
    file["arms"]["arm1"]["tree"]["sequence"][1]["insert"]["at"]["xyz"][2] -= 0.001
    with bt.open(file) as run:
        pressed = inserting.ContactForces(run.world, "down")
        leaf = run.finish().arms["arm1"].runs[-1]
    assert leaf.status == "SUCCESS", leaf.reason
    assert 1.0 < pressed.rim_n < 15.0
    assert abs(pressed.height) < 0.001


@pytest.mark.parametrize("has_bottom", [True, False])
def test_compliant_arm_on_the_bottom_need_not_reach_the_full_force(
    has_bottom: bool,
) -> None:
    """At 1.5 mm below the bottom, this arm presses with 51 of 60 N: it failed with NO_CONTACT."""
    file = yaml.safe_load((share_dir("trees") / "peg_in_hole.yaml").read_text())
    file["arms"]["arm1"]["tree"]["sequence"][1]["insert"] |= {"push": 60, "tolerance": 0.0015}
    if not has_bottom:  # the same hole 30 mm above the table
        for name in ("right", "left", "back", "front"):
            file["objects"][name]["pose"]["xyz"][2] += 0.03
        file["arms"]["arm1"]["tree"]["sequence"][1]["insert"]["at"]["xyz"][2] += 0.03
    leaf = bt.run(file).arms["arm1"].runs[1]
    assert leaf.skill == "insert"
    assert leaf.code == ("" if has_bottom else "NO_CONTACT")
    if has_bottom:
        assert 30.0 < leaf.metrics["push_n"] < 60.0


def test_peg_that_was_halted_in_its_hole_is_inserted_again() -> None:
    """No plan leads out of the hole, in which the peg is wherever a `timeout` or a jam ended it."""
    file = yaml.safe_load((share_dir("trees") / "peg_in_hole.yaml").read_text())
    leaves = file["arms"]["arm1"]["tree"]["sequence"]
    insert = leaves[1]
    leaves[1] = {"selector": [{"timeout": {"seconds": 5.4, "child": insert}}, insert]}
    heights: dict[float, float] = {}
    with bt.open(file) as run:
        while not run.done:
            run.step(0.1)
            heights[run.time] = float(run.world.object_pose("peg").position[2])
        result = run.finish()
    first, second = (one for one in result.arms["arm1"].runs if one.skill == "insert")
    assert (first.code, second.status) == ("HALTED", "SUCCESS"), second.reason
    halted = min(heights, key=lambda time: abs(time - (first.ended_s or 0.0)))
    assert heights[halted] < 0.45, "it was not in the hole, whose rim is at 0.42 m"
