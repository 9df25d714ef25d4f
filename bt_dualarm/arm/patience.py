"""How long an arm waits for another one to clear its way."""

from __future__ import annotations

import zlib

import numpy as np

PATIENCE_S = (0.5, 2.0)
"""Simulated seconds, drawn between these, that an arm waits for another one to clear its way."""


class Patience:
    """Drawn, so that two arms in each other's way do not try at the same time.

    Args:
        arm: Name of the arm.
        seed: Seed of everything random in the run.

    Attributes:
        rng: Source of what is drawn, for other choices of an arm that waits.
        seconds: Simulated seconds that it waits this time.
    """

    def __init__(self, arm: str, seed: int) -> None:
        self.rng = np.random.default_rng([seed, zlib.crc32(arm.encode())])
        self.seconds = 0.0
        self.renew()

    def renew(self) -> float:
        """Draw how long it waits the next time; returns it."""
        self.seconds = float(self.rng.uniform(*PATIENCE_S))
        return self.seconds
