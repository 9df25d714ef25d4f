"""A skill that goes wrong in the phase that it is told."""

from __future__ import annotations

import builtins
from collections.abc import Callable, Iterator
from typing import Any, ClassVar

import numpy as np

from bt_dualarm import PortModel, Skill, SkillContext, port
from bt_dualarm.sim.frame import Window
from bt_dualarm.trajectory.set_points import SetPoint


class Raiser(Skill):
    """Move about, and raise in one phase."""

    class Ports(PortModel):
        """Which phase, and how bad."""

        phase: str = port(..., "where to raise")
        error: str = port("ValueError", "what to raise")

    example: ClassVar[str] = "raiser: {phase: before}"
    ports: Ports

    def __init__(
        self, ports: PortModel, context: SkillContext, write: Callable[[str, Any], None]
    ) -> None:
        super().__init__(ports, context, write)
        self._raise_in("constructor")

    def run(self) -> Iterator[float | None]:
        """Wave the last joint until something breaks."""
        self._raise_in("before")
        unsubscribe = self.arm.camera.subscribe(self._on_frame) if self.arm.camera else None
        if self.arm.camera and self.ports.phase == "aim":
            self.arm.camera.aim = self._on_exposure
        self.arm.stream(self._wave)
        began = self.time
        try:
            while True:
                yield None
                if self.time - began > 0.3:
                    self._raise_in("after")
                    self._raise_in("metrics")
                    if self.ports.phase == "ending":
                        return
        finally:
            self._raise_in("finally")
            self._raise_in("ending")
            if unsubscribe is not None:
                unsubscribe()

    def _raise_in(self, phase: str) -> None:
        if phase != self.ports.phase:
            return
        if phase == "metrics":
            self.metrics = {"odd": object(), 3: np.zeros(3)}  # type: ignore[dict-item]
        error: type[BaseException] = getattr(builtins, self.ports.error)
        raise error(f"on purpose, in {phase}")

    def _wave(self, time: float) -> SetPoint:
        """A sine of 0.1 rad that begins with bounded jerk, as the controller sees to."""
        if self.time > 0.3:
            self._raise_in("stream")
        if self.time > 0.3 and self.ports.phase == "nan":
            return SetPoint(*(np.full((3, self.arm.robot.dof), np.nan)))
        start = self.arm.robot.postures["home"]
        tip = np.eye(len(start))[-1] * 0.1
        return SetPoint(start + tip * np.sin(time), tip * np.cos(time), -tip * np.sin(time))

    def _on_frame(self, frame: object) -> None:
        if self.time > 0.3:
            self._raise_in("camera")

    def _on_exposure(self, *place: object) -> Window:
        if self.time > 0.3:
            self._raise_in("aim")
        return Window()
