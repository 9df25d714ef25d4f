"""Arms that track a cube at rest: a part of the family that `benchmarks.following` sweeps."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.following import FPS, LATENCIES, SHARES, complaints
from benchmarks.following_trial import LOOKS, Spot, follow
from benchmarks.vantage import BASE, vantage
from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.skill.registry import Registry
from tests.families import some
from tests.sim.worlds import WIDE


def drawn(seed: int) -> list[Spot]:
    """One case for each robot, with its other parameters drawn at random."""
    rng = np.random.default_rng(seed)
    return [
        Spot(
            robot,
            str(rng.choice(list(LOOKS))),
            float(rng.choice(FPS)),
            float(rng.choice(SHARES)),
            float(rng.choice(LATENCIES)),
            reality=str(rng.choice(("ideal", "lab", "rough"))),
        )
        for robot in WIDE
    ]


@pytest.mark.slow
@pytest.mark.parametrize("spot", some([*drawn(0), *drawn(1)[2:4]], 4), ids=str)
def test_arm_rests_before_a_target_at_rest(spot: Spot, registry: Registry) -> None:
    found = follow(spot, registry)
    assert complaints(spot, found) == [], found


@pytest.mark.parametrize("robot", WIDE)
def test_camera_at_its_vantage_looks_along_the_normal(robot: str) -> None:
    """The camera's pose at this posture is that of the arm's kinematics."""
    seen = vantage(robot, LOOKS["xy"])
    assert seen.camera.turn(np.array((0.0, 0.0, 1.0))) == pytest.approx(LOOKS["xy"], abs=1e-9)
    entry = load_robot(robot)
    xyz, rpy = BASE
    chain = Kinematics(entry, Pose.from_rpy(xyz, np.radians(rpy).tolist()))
    chain.matrix(seen.q)
    mount = entry.cameras["wrist"]
    camera = chain.frame(mount.link) @ mount.pose.matrix
    assert camera[:3, 3] == pytest.approx(seen.camera.position, abs=1e-4)
