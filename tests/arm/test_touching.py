"""What an arm touches on its way is a metric of the leaf that moved it, whatever it was."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.spec.document import ObjectSpec
from tests.arm.test_arm import Bench
from tests.sim.worlds import box


def block(turn: float, mass: float) -> ObjectSpec:
    """A block in the way of the tool, as far around the base as that."""
    tool = Bench().first.tool_pose.position
    around = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    x, y = around @ tool[:2]
    return box((float(x), float(y), float(tool[2])), edge=0.06, mass=mass)


def go(bench: Bench) -> None:
    """To the end of the motion, with what it pushes, and nobody who looks where it goes."""
    bench.first.begin(bench.motion(0.6))
    for _ in range(200):
        bench.tick()


@pytest.mark.parametrize("mass", [0.02, 0.3])
@pytest.mark.parametrize("turn", [0.25, 0.4])
def test_what_is_knocked_away_is_named_with_the_force(turn: float, mass: float) -> None:
    """A block that floats is accelerated by its contacts, one of which is the hardest."""
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
    assert bench.first.touched([]) == {}, "said once"


def test_what_the_leaf_was_asked_to_touch_is_no_news() -> None:
    bench = Bench(block=block(0.25, 0.05))
    bench.world.model.opt.gravity[:] = 0.0
    go(bench)
    assert bench.first.touched(["block"]) == {}


def test_a_way_that_is_clear_has_no_such_metric() -> None:
    bench = Bench(block=block(np.pi, 0.05))
    bench.world.model.opt.gravity[:] = 0.0
    go(bench)
    assert bench.first.touched([]) == {}


def test_another_leaf_that_did_not_move_has_touched_nothing() -> None:
    bench = Bench(block=block(0.25, 0.05))
    bench.world.model.opt.gravity[:] = 0.0
    go(bench)
    assert bench.second.touched([]) == {}


def test_what_it_held_from_the_beginning_or_touched_then_is_its_own_matter() -> None:
    """A leaf that leaves what it has put down, or carries what another leaf took."""
    bench = Bench(block=block(0.0, 0.05))
    bench.world.model.opt.gravity[:] = 0.0
    bench.world.step()
    assert len(bench.world.data.contact.geom), "it touches"
    bench.first.begin(bench.motion(0.4))
    for _ in range(100):
        bench.tick()
    assert bench.first.touched([]) == {}
