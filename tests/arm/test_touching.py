"""Objects that an arm touches in passing are a metric of the leaf that moved it."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.spec.document import ObjectSpec
from tests.arm.test_arm import Bench
from tests.sim.worlds import box


def block(turn: float, mass: float) -> ObjectSpec:
    """A block of a mass in kg at the tool's position turned about the base by an angle in rad."""
    tool = Bench().first.tool_pose.position
    around = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    x, y = around @ tool[:2]
    return box((float(x), float(y), float(tool[2])), edge=0.06, mass=mass)


def go(bench: Bench) -> None:
    """Moves to the end without a check for collisions, pushing whatever is on the path."""
    bench.first.begin(bench.motion(0.6))
    for _ in range(200):
        bench.tick()


@pytest.mark.parametrize("mass", [0.02, 0.3])
@pytest.mark.parametrize("turn", [0.25, 0.4])
def test_object_knocked_away_is_reported_with_the_force(turn: float, mass: float) -> None:
    """The reported force is that of the hardest contact that accelerates a floating block."""
    bench = Bench(block=block(turn, mass))
    world = bench.world
    world.model.opt.gravity[:] = 0.0
    velocities = [np.zeros(3)]
    start = world.model.jnt_dofadr[world.model.body_jntadr[world.model.body("block").id]]
    world.on_forces.append(lambda: velocities.append(world.data.qvel[start : start + 3].copy()))
    bench.first.begin(bench.motion(0.6))
    for _ in range(300):
        bench.tick()
    accelerations = np.diff(velocities, axis=0) / world.timestep
    together = mass * float(np.linalg.norm(accelerations, axis=1).max())
    found = bench.first.touched([])
    assert found["touched"] == "block"
    assert together / (8 * 1.3) < float(found["touch_force_n"]) < 1.05 * together
    assert bench.first.touched([]) == {}, "reported once"


def test_expected_contact_is_not_reported() -> None:
    bench = Bench(block=block(0.25, 0.05))
    bench.world.model.opt.gravity[:] = 0.0
    go(bench)
    assert bench.first.touched(["block"]) == {}


def test_motion_without_contact_reports_none() -> None:
    bench = Bench(block=block(np.pi, 0.05))
    bench.world.model.opt.gravity[:] = 0.0
    go(bench)
    assert bench.first.touched([]) == {}


def test_leaf_that_did_not_move_reports_no_contact() -> None:
    bench = Bench(block=block(0.25, 0.05))
    bench.world.model.opt.gravity[:] = 0.0
    go(bench)
    assert bench.second.touched([]) == {}


def test_object_touched_from_the_start_is_not_reported() -> None:
    """For example, a leaf leaves an object that it has placed, or carries one picked by another."""
    bench = Bench(block=block(0.0, 0.05))
    bench.world.model.opt.gravity[:] = 0.0
    bench.world.step()
    assert len(bench.world.data.contact.geom), "it touches"
    bench.first.begin(bench.motion(0.4))
    for _ in range(100):
        bench.tick()
    assert bench.first.touched([]) == {}
