"""How near an arm is to a singularity, and its joints to their position limits."""

from __future__ import annotations

import mujoco
import numpy as np

from bt_dualarm.motion.kinematics.path_failure import SINGULAR_CONDITION
from bt_dualarm.world.world import World

NEAR_LIMIT = 0.01
"""Distance in rad of a joint from its position limit from which it does."""


class Posture:
    """What the posture of an arm allows; to be made anew after a recompilation.

    Args:
        world: World that the arm is in.
        arm: Name of the arm.

    Attributes:
        room: Distance in rad of the nearest position limit, when it was looked at last.
        condition: Condition number of the tool's Jacobian, likewise.
    """

    def __init__(self, world: World, arm: str) -> None:
        self._world = world
        self._body = world.arms[arm]
        self._limits = world.robots[arm].limits
        self._jacobian = np.zeros((6, world.model.nv))
        self.room = float("inf")
        self.condition = 1.0

    def look(self) -> None:
        """Measure both."""
        limits, body = self._limits, self._body
        model, data = self._world.model, self._world.sensed
        q = data.qpos[body.qpos_ids]
        self.room = float(min((q - limits.lower).min(), (limits.upper - q).min()))
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacSite(model, data, self._jacobian[:3], self._jacobian[3:], body.tool_site)
        values = np.linalg.svd(self._jacobian[:, body.dof_ids], compute_uv=False)
        self.condition = float(values[0] / max(values[-1], 1e-9))

    @property
    def time_scale(self) -> tuple[float, str]:
        """That a motion along a path should have, and why, if that is less than 1."""
        if self.condition > SINGULAR_CONDITION:
            return 0.5, f"condition {self.condition:.0f}"
        if self.room < NEAR_LIMIT:
            return 0.5, f"{self.room:.3f} rad from a limit"
        return 1.0, ""
