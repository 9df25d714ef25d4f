"""Copies of a world's model, with a state each, that are used again: to make one takes 0.8 ms."""

from __future__ import annotations

import copy
import weakref
from typing import TYPE_CHECKING, Final, NamedTuple

import mujoco

if TYPE_CHECKING:
    from bt_dualarm.world.world import World


_MARKED: Final = (
    "geom_contype",
    "geom_conaffinity",
    "geom_margin",
    "body_contype",
    "body_conaffinity",
    "body_margin",
)
"""Fields of a copy that whoever has it may change."""

_ONE_CONTACT: Final = mujoco.mjtDisableBit.mjDSBL_MULTICCD
"""Of two convex shapes the deepest contact is enough; the others, which a step of the world wants
so that things lie flat, cost a tenth of a check."""


class ScratchCopy(NamedTuple):
    """A model, and a state of it.

    Attributes:
        model: Copy of a world's model.
        data: State of the copy.
    """

    model: mujoco.MjModel
    data: mujoco.MjData


class _Idle:
    """Copies of one model that nobody uses."""

    def __init__(self, original: mujoco.MjModel) -> None:
        self.original = original
        self.copies: list[ScratchCopy] = []


_idle: weakref.WeakKeyDictionary[World, _Idle] = weakref.WeakKeyDictionary()


def scratch_copy(world: World, owner: object) -> ScratchCopy:
    """A copy of a world's model as that is now, for as long as its owner lives.

    Args:
        world: World that the copy is of.
        owner: Object that has it to itself; once it is gone the next may have the copy.
    """
    idle = _idle.get(world)
    if idle is None or idle.original is not world.model:  # it was compiled anew
        idle = _idle[world] = _Idle(world.model)
    lent = _unmarked(idle) if idle.copies else _made(world.model)
    weakref.finalize(owner, idle.copies.append, lent).atexit = False
    return lent


def _unmarked(idle: _Idle) -> ScratchCopy:
    """One that was used, as if it had just been made."""
    lent = idle.copies.pop()
    for field in _MARKED:
        getattr(lent.model, field)[:] = getattr(idle.original, field)
    return lent


def _made(original: mujoco.MjModel) -> ScratchCopy:
    model = copy.copy(original)
    model.opt.disableflags |= _ONE_CONTACT
    return ScratchCopy(model, mujoco.MjData(model))
