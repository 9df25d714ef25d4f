"""A skill that does not return from a tick, for a while."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import ClassVar

from bt_dualarm import Duration, PortModel, Skill, port


class Hang(Skill):
    """Wait, then sleep within a tick for longer than a watchdog allows."""

    class Ports(PortModel):
        """When, and for how long."""

        after: Duration = port(0.2, "simulated time before the tick that hangs")
        wall_s: float = port(20.0, "time on the wall that the tick takes", unit="s", gt=0, le=60)

    example: ClassVar[str] = "hang: {after: 0.2}"
    ports: Ports

    def run(self) -> Iterator[None]:
        """Wait, then hang."""
        began = self.time
        while self.time - began < self.ports.after:
            yield
        time.sleep(self.ports.wall_s)
