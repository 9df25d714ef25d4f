"""Where a piece of a tree is being parsed: the file, the path in it, and what names mean there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from bt_dualarm.spec.params import ParamSpec
from bt_dualarm.spec.problems import Place, Problem
from bt_dualarm.spec.scope import Scope
from bt_dualarm.spec.source import Data, Path, Source


@dataclass(frozen=True, eq=False)
class SubtreeSpec:
    """A subtree as a file declares it.

    Attributes:
        name: Name in the file that declares it.
        source: That file.
        path: Path of its tree in that file.
        params: Parameters that a use may set.
        library: Subtrees that its own nodes may use.
    """

    name: str
    source: Source
    path: Path
    params: Mapping[str, ParamSpec]
    library: Mapping[str, SubtreeSpec]


@dataclass(frozen=True)
class Site:
    """A place in a file, with what is visible from it.

    Attributes:
        source: The file.
        path: Path in the file.
        scope: Meaning of references.
        library: Subtrees by name.
        uses: Subtrees that are being written out here, outermost first.
        depth: Nodes above it, in all files.
        user: Place where the innermost of these subtrees is used.
    """

    source: Source
    path: Path
    scope: Scope = field(default_factory=Scope)
    library: Mapping[str, SubtreeSpec] = field(default_factory=dict)
    uses: tuple[SubtreeSpec, ...] = ()
    depth: int = 0
    user: Place | None = None

    def into(self, *parts: str | int) -> Site:
        """The place that these keys and indices lead to."""
        return self._at((*self.path, *parts), self.depth)

    def deeper(self) -> Site:
        """The same place, below one more node."""
        return self._at(self.path, self.depth + 1)

    def _at(self, path: Path, depth: int) -> Site:
        """The same but for these: one is made for every word of a file, so without `replace`."""
        return Site(self.source, path, self.scope, self.library, self.uses, depth, self.user)

    @property
    def data(self) -> Data:
        """What the file says here."""
        return self.source.get(self.path)

    def problem(self, message: str, hint: str = "", *, key: bool = False) -> Problem:
        """An error here."""
        return self.source.problem(self.path, message, hint, key=key)
