"""A touch of the tool, by the force that comes of it: what was there a moment ago is none."""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.pose import Vector

_TARE_S: Final = (0.1, 0.5)
"""How long ago the force was that counts as none: friction and masses that are off are in it."""


class TouchSense:
    """The force against a motion of the tool, beyond what it was a moment ago.

    Args:
        arm: Arm whose tool it is.
        way: Direction of the motion in the world, of unit length, of shape (3,).
        alone: Whether nothing but a force along the way is taken to act. Friction then hardly
            counts, whatever the posture; small forces are felt as still smaller ones.

    Attributes:
        most: Largest force in N so far.
    """

    def __init__(self, arm: Arm, way: Vector, *, alone: bool = False) -> None:
        self._arm, self._way, self._alone = arm, way, alone
        self._felt = deque[tuple[float, float]]()
        self._none = 0.0
        self.most = 0.0

    def force(self, *, stands: bool = False) -> float:
        """Force in N now; to be asked for once a tick.

        Args:
            stands: Whether the tool has stopped: what was none then is so for as long as it stands,
                for a force may come up slowly.
        """
        now, (latest, earliest) = self._arm.time, _TARE_S
        felt = self._against()
        self._felt.append((now, felt))
        while now - self._felt[0][0] > earliest:
            self._felt.popleft()
        before = [one for at, one in self._felt if now - at >= latest]
        if not stands:
            self._none = float(np.mean(before)) if before else felt
        rise = felt - self._none
        self.most = max(self.most, rise)
        return rise

    def _against(self) -> float:
        """Force in N against the way, of all that pushes the joints now.

        Alone, it is what explains the joints' torques best, each as a share of the joint's effort
        (weighted least squares). A whole wrench is more than near a singular posture can be told:
        friction of joints that hardly move the tool was 100 N there.
        """
        arm, way = self._arm, self._way
        if not self._alone:
            return -float(way @ arm.external_wrench[:3])
        lever = way @ arm.world.nominal[arm.name].tool_jacobian_at(arm.q)[:3]
        shares = lever / arm.robot.limits.effort**2
        return -float(shares @ arm.external_torque) / max(float(shares @ lever), 1e-12)
