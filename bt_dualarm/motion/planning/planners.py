"""The planners of OMPL that a skill may name.

Those that end after a count of checks, or of rounds, and repeat with their seed. Left out: PRM and
PRM* search in a second thread, FMT and BFMT draw all their samples before they look at the count,
and the KPIECE family finds another way each time, whatever its seed.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType
from typing import TYPE_CHECKING, Final, Literal, TypeAlias, get_args

if TYPE_CHECKING:
    import ompl.base

Planner: TypeAlias = Literal[
    "RRTConnect",
    "RRT",
    "RRTstar",
    "InformedRRTstar",
    "SORRTstar",
    "BITstar",
    "AORRTC",
]
"""Names as OMPL has them; those that optimise (with ``star``, and AORRTC) use all their checks."""

PLANNERS: Final[tuple[Planner, ...]] = get_args(Planner)

DEFAULT_PLANNER: Final[Planner] = "RRTConnect"
"""Kuffner and LaValle 2000: two trees, from both ends, that grow towards each other."""

CHECKS_PER_ROUND: Final[Mapping[Planner, int]] = {"BITstar": 4}
"""Checks that a round counts for, where it is more than one: BITstar sorts edges for most of its
time, longer and longer, and looks at less and less; a round took as long as 10 to 40 checks."""


def made(
    name: Planner, longest_edge: float, geometric: ModuleType, space: ompl.base.SpaceInformation
) -> ompl.base.Planner:
    """A planner of OMPL for one search.

    Args:
        name: Name of the planner.
        longest_edge: Longest edge of its trees, in the space's measure, where it has such a bound.
        geometric: OMPL's module ``ompl.geometric``.
        space: What OMPL knows of the space that is searched.
    """
    planner = getattr(geometric, name)(space)
    if hasattr(planner, "setRange"):
        planner.setRange(longest_edge)
    return planner
