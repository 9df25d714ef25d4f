"""What a tree file says of hits: what an arm does about them."""

from __future__ import annotations

from bt_dualarm.spec.ports import port
from bt_dualarm.spec.values import Value


class CollisionSpec(Value):
    """What an arm does when it is hit, or runs into something, as its joints' torques tell."""

    stop: bool = port(False, "Whether its motion ends with `COLLISION`, and it goes back a little")
    threshold: float = port(1.0, "Factor of the torques that count as a hit", ge=0.2, le=1000.0)
