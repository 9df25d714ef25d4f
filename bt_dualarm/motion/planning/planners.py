"""The planners of OMPL that a skill may name.

Those that end after a count of checks and repeat with their seed. Left out: PRM and PRM* search in
a second thread, FMT and BFMT draw all their samples before they look at the count, and the KPIECE
family finds another way each time, whatever its seed.
"""

from __future__ import annotations

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
