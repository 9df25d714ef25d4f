"""The seed determines the sampled masses of a gripper, separately for palm and fingers."""

from __future__ import annotations

import pytest

from bt_dualarm.robots.gripper import FINGERS, PALM
from bt_dualarm.sim.world import World
from tests.grippers.fingers import FINGERED
from tests.sim.worlds import arm, file_of

SHARES = {"ideal": 0.0, "lab": 0.05, "rough": 0.20}
"""Largest relative error of a link's mass; docs/reality.md."""


def factors(gripper: str, reality: str, seed: int) -> list[float]:
    """True masses of palm and fingers relative to those of the description."""
    world = World(file_of({"arm1": arm("ur5", gripper=gripper)}, reality=reality), seed)
    description = world.grippers["arm1"].gripper
    parts = [description.palm, *(finger.part for finger in description.fingers)]
    bodies = [world.model.body(f"arm1/{name}") for name in (PALM, *FINGERS)]
    return [float(body.mass[0]) / part.mass for body, part in zip(bodies, parts, strict=True)]


@pytest.mark.parametrize("reality", SHARES)
@pytest.mark.parametrize("gripper", FINGERED)
def test_errors_of_masses_are_within_the_share(gripper: str, reality: str) -> None:
    most = SHARES[reality]
    drawn = [factors(gripper, reality, seed) for seed in range(6)]
    flat = [abs(one - 1.0) for row in drawn for one in row]
    assert max(flat) <= most + 1e-9
    assert max(flat) >= 0.5 * most
    assert factors(gripper, reality, 3) == drawn[3], "one seed is one robot"
    if most:
        assert all(len(set(row)) == len(row) for row in drawn), "each link has its own factor"
        assert len({tuple(row) for row in drawn}) == len(drawn)
