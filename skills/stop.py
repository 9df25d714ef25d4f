"""Stop the arm, regardless of which leaf moves it."""

from __future__ import annotations

import math
from collections.abc import Iterator

from bt_dualarm import Failure, PortModel, Skill, port


class Stop(Skill):
    """Stop the arm with bounded jerk; a leaf that moves it fails with INTERRUPTED."""

    class Ports(PortModel):
        longest: float = port(5.0, "longest time to come to rest", unit="s", gt=0, le=60)

    failures = {"TIMED_OUT": "the arm did not come to rest in time"}
    example = "stop: {}"
    ports: Ports

    def run(self) -> Iterator[None]:
        """Brake, wait for rest, measure the time."""
        began = self.time
        for _ in self.arm.halt(longest_s=math.inf):
            took = self.time - began
            if took > self.ports.longest:
                raise Failure(
                    "TIMED_OUT", f"{self.arm.name} still moves after {took:.2f} s", took_s=took
                )
            yield
        self.metrics["stopping_s"] = self.time - began
