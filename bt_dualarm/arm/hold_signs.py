"""Signs that a hold changes, by the opening of fingers or the vacuum of a cup: what counts."""

from __future__ import annotations

from typing import Final

from bt_dualarm.world.grippers.gripper import Gripper

LOST_S: Final = 0.04
"""Seconds for which a sign has to last: one reading may be off."""

_SLID_M: Final = 0.003  # of the opening: something else is between the pads then
_GIVES_M: Final = 0.0015  # by which it has shrunk where what is held is about to go
_SLID_STEPS: Final = 3.0  # of the encoder, that may be its noise
_GIVES_STEPS: Final = 1.5
_LEAKS: Final = 0.9  # share of a vacuum that has built up
_SEALS: Final = 0.5  # share of the vacuum that was asked for


def has_slid(page: Gripper, moved: float) -> bool:
    """Whether fingers that moved by so many metres have other places of a thing between them."""
    return moved > max(_SLID_M, _SLID_STEPS * page.resolution)


def gives(page: Gripper, shrunk: float) -> bool:
    """Whether fingers come together, by as many metres as their opening has shrunk."""
    return shrunk > max(_GIVES_M, _GIVES_STEPS * page.resolution)


def leaks(vacuum: float, most: float) -> bool:
    """Whether a vacuum falls: its share of the full one, and the most that it has been."""
    return vacuum < _LEAKS * most


def is_lost(page: Gripper, width: float, vacuum: float, force: float) -> bool:
    """Whether fingers have shut, or a cup does not seal.

    Args:
        page: Page of the gripper.
        width: Opening that is sensed, m.
        vacuum: Share of the full vacuum that is sensed.
        force: Force that was asked for, N.
    """
    if page.fingers:
        return width <= page.closed_width
    return vacuum < _SEALS * force / page.force.most
