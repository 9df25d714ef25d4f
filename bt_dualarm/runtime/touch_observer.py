"""Looks at what the arms touch after each step of the physics."""

from __future__ import annotations

from bt_dualarm.runtime.parts import IdleObserver
from bt_dualarm.world.touches import Touches


class TouchObserver(IdleObserver):
    """An observer of contacts.

    Args:
        touches: Those who watch are told.
    """

    def __init__(self, touches: Touches) -> None:
        self._touches = touches

    def after_step(self, time: float) -> None:  # noqa: ARG002 - contacts are as they are now
        """Look at the contacts of this step."""
        self._touches.look()
