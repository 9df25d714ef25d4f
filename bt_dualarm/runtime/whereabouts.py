"""Where a thread stands: in which file and line, in which leaf of which arm."""

from __future__ import annotations

import sys
import sysconfig
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Final

_LEAF: Final = "bt_dualarm.tree.leaf", "Leaf"
_ARM: Final = "bt_dualarm.runtime.arm_runtime", "ArmRuntime"
"""Module and name of what code of a run belongs to. Not imported here: py_trees takes long, and
where nobody has imported them yet, no code of them is under way."""

_PACKAGE: Final = str(Path(__file__).parents[1])
_LIBRARIES: Final = (
    "<",
    *{sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")},
)
"""How names of files begin that nobody has written for a tree of his own."""

_WAITING: Final = (
    "bdb",
    "_pydevd_bundle",
    "bt_dualarm.cli.outlet",
    "bt_dualarm.motion.planning.process",
)
"""Modules that wait for somebody at a debugger or a terminal, or have limits of their own."""


@dataclass(frozen=True)
class Whereabouts:
    """Where a thread stands.

    Attributes:
        arm: Name of the arm whose code runs; empty where it is none's.
        leaf: Path of the leaf, or of all that run where it stands in a stream; empty if unknown.
        place: File, line and function of the innermost code that is of no library.
        is_excused: Whether it waits for a person, or for what has a limit of its own, or no code of
            a skill is under way.
        is_in_package: Whether it is in code of this package, which a skill may have called.
        otherwise: What the code is said to be where it is no arm's.
    """

    arm: str = ""
    leaf: str = ""
    place: str = "an unknown place"
    is_excused: bool = False
    is_in_package: bool = False
    otherwise: str = "the run"

    @classmethod
    def of(cls, thread: int, otherwise: str = "the run") -> Whereabouts:
        """Of the thread with this identity, as it stands at this moment.

        Args:
            thread: Identity of the thread.
            otherwise: What code is said to be that is no arm's.
        """
        return cls.of_frame(sys._current_frames().get(thread), otherwise)

    @classmethod
    def of_frame(cls, innermost: FrameType | None, otherwise: str = "the run") -> Whereabouts:
        """Of a thread whose innermost frame is given; ``otherwise`` as in `of`."""
        frames, arm, leaf = [], None, None
        for frame in _outwards(innermost):
            owner = frame.f_locals.get("self") if _is_of_a_run(frame) else None
            if _is_a(owner, _ARM):
                arm = owner
                break
            leaf = leaf or (owner if _is_a(owner, _LEAF) else None)
            frames.append(frame)
        own = [frame for frame in frames if not _is_of_a_library(frame)]
        return cls(
            arm.name if arm else "",
            leaf.path if leaf else ", ".join(arm.running if arm else ()),
            _place(own or frames),
            (not own and leaf is None) or any(_waits(frame) for frame in frames),
            bool(frames) and _module(frames[0]).startswith("bt_dualarm."),
            otherwise,
        )

    def __str__(self) -> str:
        who = f"{self.arm}: {self.leaf}" if self.leaf else self.arm
        return f"{who or self.otherwise} at {self.place}"


def _outwards(frame: FrameType | None) -> Iterator[FrameType]:
    while frame is not None:
        yield frame
        frame = frame.f_back


def _module(frame: FrameType) -> str:
    return str(frame.f_globals.get("__name__", ""))


def _is_of_a_run(frame: FrameType) -> bool:
    """Others' variables are left alone: to look at them has a price."""
    return _module(frame) in (_LEAF[0], _ARM[0])


def _is_a(owner: object, kind: tuple[str, str]) -> bool:
    """Whether it is of a class, given by its module and name."""
    module, name = kind
    return isinstance(owner, getattr(sys.modules.get(module), name, ()))


def _waits(frame: FrameType) -> bool:
    return _module(frame).startswith(_WAITING)


def _place(frames: list[FrameType]) -> str:
    if not frames:
        return Whereabouts.place
    code = frames[0].f_code
    return f"{Path(code.co_filename).name}:{frames[0].f_lineno}, in {code.co_name}"


def _is_of_a_library(frame: FrameType) -> bool:
    return frame.f_code.co_filename.startswith((_PACKAGE, *_LIBRARIES))
