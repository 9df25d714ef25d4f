"""The robots with which the published figures were measured."""

from __future__ import annotations

from typing import Final

MEASURED: Final = ("panda", "ur10", "ur3", "ur5", "xarm7")
"""Order in which random worlds choose them; another robot would change all later random numbers."""
