"""How hard a peg presses on the rim of its hole while it searches."""

from __future__ import annotations

import argparse

import mujoco
import numpy as np
import pytest
import yaml

import bt_dualarm as bt
from benchmarks import inserting
from bt_dualarm.core.share import share_dir

CALM_N = 10.0
"""Force on the rim that was exceeded when the compensation of hops included contact force, N."""


@pytest.mark.parametrize("seed", [44])
def test_a_hop_does_not_press_harder_than_the_first_touch_lets_it(seed: int) -> None:
    """The joints of a UR10 rub most, so that an error of their friction presses most."""
    words = {"robot": "ur10", "gripper": "robotiq_2f85", "reality": "lab", "shape": "cylinder"}
    file, _ = inserting.task(argparse.Namespace(**words), seed)
    pressed = [0.0]
    with bt.open(file) as run:
        world = run.world
        peg = world.payload_geoms("peg")
        arm = world.arms["arm1"].geom_ids
        rim = inserting.TABLE + inserting.HIGH + 0.04 - 0.0003
        force = np.empty(6)

        def look() -> None:
            if world.object_pose("peg").position[2] < rim:
                return  # not standing on the table before the grasp, nor in the hole
            total = np.zeros(3)
            for number, pair in enumerate(world.data.contact.geom.tolist()):
                if peg & set(pair) and not arm & set(pair):
                    mujoco.mj_contactForce(world.model, world.data, number, force)
                    axes = world.data.contact.frame[number].reshape(3, 3)
                    total += (1.0 if pair[1] in peg else -1.0) * (force[:3] @ axes)
            pressed[0] = max(pressed[0], float(np.linalg.norm(total)))

        world.on_forces.append(look)
        leaf = run.finish().arms["arm1"].runs[-1]
    assert leaf.status == "SUCCESS", leaf.reason
    assert int(leaf.metrics["search_places"]) > 2
    assert 1.0 < pressed[0] < CALM_N


@pytest.mark.parametrize("has_bottom", [True, False])
def test_a_soft_arm_that_stands_on_the_bottom_need_not_press_with_the_full_force(
    has_bottom: bool,
) -> None:
    """At 1.5 mm below the bottom this arm presses with 51 of 60 N: that was NO_CONTACT."""
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
