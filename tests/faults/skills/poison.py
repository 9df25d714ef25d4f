"""A skill that does to the simulation what a bug in it would do."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

from bt_dualarm import Duration, PortModel, Skill, port


class Poison(Skill):
    """Wait, then write what is not a number into the simulation."""

    class Ports(PortModel):
        """When and where."""

        after: Duration = port(0.2, "how long the world stays sane")
        into: Literal["qpos", "qvel", "ctrl", "xfrc_applied"] = port("qvel", "which array")

    example: ClassVar[str] = "poison: {after: 0.2}"
    ports: Ports

    def run(self) -> Iterator[None]:
        """Wait, write, and see what happens."""
        began = self.time
        while self.time - began < self.ports.after:
            yield
        getattr(self.arm.world.data, self.ports.into).flat[-1] = float("nan")
        while True:
            yield
