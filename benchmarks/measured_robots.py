"""The robots with which the published figures were measured."""

from __future__ import annotations

from typing import Final

MEASURED: Final = ("panda", "ur10", "ur3", "ur5", "xarm7")
"""In the order in which drawn worlds pick them: a robot more would change every later draw."""
