"""Tactile pads measure grip forces with the described noise and rate."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bt_dualarm.core.share import share_dir
from bt_dualarm.robots.gripper import GripperFile, gripper_of, load_gripper
from bt_dualarm.robots.urdf_xml import DescriptionError
from bt_dualarm.sim.grippers import GripperCommand, GripperHardware
from bt_dualarm.sim.world import World
from tests.grippers.test_drive import FINGERED, let_run, world_around

TACTILE = tuple(name for name in FINGERED if load_gripper(name).tactile is not None)
FORCE_N = 40.0
EDGE = 0.03


def holding(gripper: str, reality: str) -> tuple[World, GripperHardware]:
    """A gripper that presses on a plate."""
    world = world_around(gripper, EDGE, reality)
    hardware = world.grippers["arm1"]
    hardware.command(GripperCommand(0.0, hardware.gripper.speed.most, FORCE_N))
    let_run(world, 1.5)
    return world, hardware


def readings(world: World, hardware: GripperHardware, seconds: float) -> np.ndarray:
    """Forces of all readings during a time in s, of shape (n, 2, 3), N."""
    assert hardware.tactile is not None
    seen = []
    stamps = [hardware.tactile.stamp]
    for _ in range(round(seconds / world.timestep)):
        let_run(world, world.timestep)
        if hardware.tactile.stamp != stamps[-1]:
            stamps.append(hardware.tactile.stamp)
            seen.append(hardware.tactile.forces)
    steps = np.diff(stamps)
    tactile = hardware.gripper.tactile
    assert tactile is not None
    assert steps.mean() == pytest.approx(1.0 / tactile.rate, abs=1e-6)
    return np.array(seen)


@pytest.mark.parametrize("gripper", TACTILE)
def test_held_object_presses_both_pads_outwards_with_the_commanded_force(gripper: str) -> None:
    world, hardware = holding(gripper, "ideal")
    forces = readings(world, hardware, 0.1)
    for pad, sign in enumerate((1.0, -1.0)):
        assert forces[:, pad, 1] == pytest.approx(sign * FORCE_N, rel=0.02)
    assert np.abs(forces[:, :, (0, 2)]).max() < 0.05 * FORCE_N


@pytest.mark.parametrize("gripper", TACTILE)
def test_open_fingers_measure_only_the_described_noise(gripper: str) -> None:
    for reality in ("ideal", "lab"):
        world = world_around(gripper, EDGE, reality)
        hardware = world.grippers["arm1"]
        tactile = hardware.gripper.tactile
        assert tactile is not None
        noise = 0.0 if reality == "ideal" else tactile.noise
        forces = readings(world, hardware, 0.5)
        assert forces.std(axis=0).mean() == pytest.approx(noise, rel=0.2)
        assert np.abs(forces.mean(axis=0)).max() <= noise


def test_description_may_omit_tactile_pads(tmp_path: Path) -> None:
    text = (share_dir("assets") / "grippers" / "robotiq_2f85.yaml").read_text(encoding="utf-8")
    description = tmp_path / "bare.yaml"
    description.write_text(text.partition("tactile:")[0], encoding="utf-8")
    assert gripper_of(GripperFile(description)).tactile is None


def test_cup_with_tactile_pads_is_refused(tmp_path: Path) -> None:
    text = (share_dir("assets") / "grippers" / "suction_cup.yaml").read_text(encoding="utf-8")
    description = tmp_path / "cup.yaml"
    tactile = 'tactile: {rate: 100, noise: 0.1, source: "nobody makes them"}\n'
    description.write_text(text + tactile, encoding="utf-8")
    with pytest.raises(DescriptionError, match="a cup has none"):
        gripper_of(GripperFile(description))
