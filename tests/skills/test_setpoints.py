"""Every set-point of every skill respects all joint limits."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.control.controller import JointController
from bt_dualarm.trajectory.set_points import SetPoint
from bt_dualarm.trajectory.trajectory import Trajectory, use_of_limits
from tests.plays import Stage
from tests.skills.scenarios import LOOKING, PRESENTING, TARGET, Scenario, Tree

PERIOD = 0.004  # s

MOVES: list[Tree] = [
    {"move_linear": {"offset": {"xyz": [0, 0.08, -0.05]}, "speed": 1.0}},
    {"rotate_tool": {"axis": "x", "angle": 25, "point": [0, 0, 0.1], "speed": 1.0}},
    {"circle": {"radius": 0.05, "turns": 0.6, "begin": 30, "tilt": 10, "speed": 1.0}},
    {"lissajous": {"amplitudes": [0.05, 0.03], "repeats": 0.5, "speed": 1.0}},
    {
        "parallel": {  # a motion that is stopped midway
            "policy": "any",
            "on_failure": "continue",
            "children": [
                {"circle": {"speed": 1.0, "turns": 3}},
                {"sequence": [{"wait": {"seconds": 1.0}}, {"stop": {}}]},
            ],
        }
    },
    {"reach_to_pose": {"offset": {"xyz": [0, 0, 0.1]}, "speed": 1.0}},
    {"go_home": {"speed": 1.0}},
]

SENT = list[SetPoint]


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> SENT:
    """Set-points of the only arm after each update of its controller."""
    points: SENT = []
    update = JointController.update

    def record(self: JointController, time: float) -> None:
        update(self, time)
        points.append(self.setpoint)

    monkeypatch.setattr(JointController, "update", record)
    return points


@pytest.mark.parametrize(
    ("scenario", "leaves"),
    [
        (Scenario(arm=PRESENTING), MOVES),
        (Scenario(arm={**PRESENTING, "limits": {"velocity": 0.3, "jerk": 0.5}}), MOVES[:4]),
        (Scenario(arm={"robot": "panda", "posture": "look_out"}), MOVES),
        (Scenario(TARGET, arm=LOOKING), [{"track": {"duration": 2.0}}]),
    ],
    ids=["ur5", "ur5 at a share", "panda", "panda tracks"],
)
def test_set_points_respect_all_limits(
    scenario: Scenario, leaves: list[Tree], stage: Stage, sent: SENT
) -> None:
    """Position, velocity, acceleration (both the given one and the change of velocity) and jerk."""
    play = stage.run(scenario.file(*leaves))
    limits = play.world.robots["arm1"].limits
    q, v, a = (np.array([getattr(point, name) for point in sent]) for name in ("q", "v", "a"))
    use = use_of_limits(Trajectory(PERIOD, q, v, a), limits)
    assert max(use.velocity, use.acceleration, use.jerk) <= 1.0 + 1e-6
    assert use.position_margin >= -1e-9
    assert play.arm().outcome == "SUCCESS"
    if leaves is MOVES:
        assert play.arm().clipped_setpoints == 0, "planned motions need no clipping"
        assert use.acceleration > 0.95, "and use the limits fully"
