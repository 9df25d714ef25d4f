"""Move the arm to its home posture."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bt_dualarm import Planner, PortModel, Skill, Speed, passengers_to, port


class GoHome(Skill):
    """Move the arm to its home posture, on a collision-free path."""

    class Ports(PortModel):
        speed: Speed = port(0.5, "fraction of the arm's limits")
        planner: Planner = port("RRTConnect", "planner to use if the straight path is blocked")

    failures = {
        "IN_COLLISION": "the arm would touch something at home",
        "NO_PLAN": "no collision-free path home was found",
        "TRACKING_ERROR": "the arm was blocked or could not follow",
        "SPILLED": "what stands on a held object would fall off at home, or fell off on the way",
        "BUSY": "another leaf moves the arm",
    }
    example = "go_home: {speed: 0.5}"
    begins_anywhere = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Plan, move, measure the error."""
        arm = self.arm
        home = arm.posture("home")
        at_home = arm.kinematics.forward(home)
        passengers = passengers_to(arm.world, arm.name, arm.commanded_tool_pose, at_home)
        yield from arm.travel([home], self.ports.speed, planner=self.ports.planner)
        error = np.abs(arm.q - home)
        self.metrics["joint_error_rad"] = float(error.max())
        for each in passengers:
            each.refuse_spilled()
