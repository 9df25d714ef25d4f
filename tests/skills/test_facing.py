"""`track` with a camera that turns to face its target."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bt_dualarm.control.facing_servo import Facing
from bt_dualarm.control.planar_servo import PlaneTarget
from bt_dualarm.core.pose import Vector
from bt_dualarm.spec.problems import SpecError
from tests.glossary import METRICS
from tests.plays import Stage
from tests.skills.scenarios import Tree
from tests.skills.test_track import CENTER, carried, lost_at, scenario

SIDE = 0.05
BALL: Tree = {
    "shape": "sphere",
    "size": [SIDE / math.sqrt(math.pi)],
    "mass": 0.1,
    "color": "yellow",
    "fixed": True,
    "pose": {"xyz": CENTER.tolist()},
}
WHERE = scenario({"fps": 60, "latency": 0.02}, cube=BALL)
FACING: Tree = {
    "plane": "free",
    "orientation": "facing",
    "target_size": SIDE,
    "duration": 6.0,
    "reach": 1.0,
    "score": "cube",
}


def around(time: float) -> Vector:
    """Displacement by 30° around the vertical through the origin, in 4 s, after 1 s at rest."""
    progress = min(1.0, max(0.0, (time - 1.0) / 4.0))
    angle = math.radians(30.0) * progress**3 * (10 - 15 * progress + 6 * progress**2)
    x, y, z = CENTER
    c, s = math.cos(angle), math.sin(angle)
    moved: Vector = np.array((x * c - y * s, x * s + y * c, z)) - CENTER
    return moved


@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), (0.1, 0.2, -0.1)])
def test_facing_camera_turns_with_a_target_around_the_arm(
    at: tuple[float, float, float], stage: Stage
) -> None:
    """The camera aims within 0.1° at its center, wherever its frame is; the tool turns along."""
    part = {"shape": "sphere", "size": BALL["size"], "pose": {"xyz": at}}
    frame = (CENTER - at).tolist()
    ball = {"shape": "compound", "parts": {"ball": part}, "pose": {"xyz": frame}}
    ball |= {key: BALL[key] for key in ("color", "mass", "fixed")}
    where = scenario({"fps": 60, "latency": 0.02}, cube=ball)
    play = stage.play(where.file({"track": FACING}))
    play.watchers.append(carried(lambda time: around(time) - at))
    tools = []
    play.watchers.append(lambda w: tools.append(w.arms["arm1"].tool_pose))
    play.run()
    leaf = play.leaf("track")
    assert leaf.status == "SUCCESS", leaf.reason
    assert float(leaf.metrics["aim_rms_rad"]) < math.radians(0.1)
    assert float(leaf.metrics["distance_rms_m"]) < 0.002
    assert float(leaf.metrics["true_rms_m"]) < 0.002
    assert tools[0].angle(tools[-1]) > math.radians(15.0)
    assert play.arm().clipped_setpoints == 0
    assert leaf.metrics.keys() <= METRICS


def test_facing_camera_searches_for_a_lost_target(stage: Stage) -> None:
    """The arm stops, searches across the last line of sight, and fails."""
    ports = FACING | {"lost_timeout": 2.0}
    play = stage.play(WHERE.file({"track": ports}), interventions=lost_at(3.0))
    play.watchers.append(carried(around))
    play.run()
    leaf = play.leaf("track")
    assert leaf.code == "LOST", leaf.reason
    assert leaf.metrics["old_data_steps"] == 0
    assert play.speed_after((leaf.ended_s or 0.0) + 1.0) < 0.01


def test_facing_requires_a_free_plane(stage: Stage) -> None:
    """In a plane the orientation is constant: the check reports the contradiction."""
    with pytest.raises(SpecError, match="orientation: facing needs plane: free"):
        stage.play(WHERE.file({"track": FACING | {"plane": "yz"}}))


@pytest.mark.parametrize("seed", range(3))
def test_facing_orientation_follows_from_the_position(seed: int) -> None:
    """A camera at its target position sees the object straight ahead; rates are derivatives."""
    rng = np.random.default_rng(seed)
    up = np.array((*rng.normal(0.0, 0.2, 1), -1.0, *rng.normal(0.0, 0.2, 1)))
    facing = Facing(0.5, up / np.linalg.norm(up), 0.3)
    position, velocity, acceleration = rng.normal(0.0, (0.15, 1.0, 1.0), (3, 3)).T.copy()
    step = 1e-5

    def camera(time: float) -> PlaneTarget:
        at = position + velocity * time + 0.5 * acceleration * time**2
        return facing.camera_motion(PlaneTarget(at, velocity + acceleration * time, acceleration))

    now, before, after = camera(0.0), camera(-step), camera(step)
    ahead = facing.rotation(now.position)[:, 2]
    np.testing.assert_allclose(
        now.position + 0.3 * ahead, position + np.array((0.0, 0.0, 0.3)), atol=1e-12
    )
    rate = (after.position - before.position) / (2.0 * step)
    np.testing.assert_allclose(now.velocity, rate, atol=1e-5)
    rate = (after.velocity - before.velocity) / (2.0 * step)
    np.testing.assert_allclose(now.acceleration, rate, atol=1e-5)
    turned = facing.rotation(after.position) - facing.rotation(before.position)
    spin = turned / (2.0 * step) @ facing.rotation(now.position).T
    omega = facing.rates(now.position) @ now.velocity
    np.testing.assert_allclose((spin[2, 1], spin[0, 2], spin[1, 0]), omega, atol=1e-5)
    np.testing.assert_allclose(facing.rotation(np.zeros(3)), np.eye(3), atol=1e-12)
