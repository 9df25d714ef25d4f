"""One use of a subtree: which one, with which values for its parameters, in a scope of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from bt_dualarm.spec.params import Misdeclared, ParamSpec
from bt_dualarm.spec.ports import is_unknown, reference_of, unknown
from bt_dualarm.spec.problems import Problem, suggestion
from bt_dualarm.spec.scope import Scope
from bt_dualarm.spec.site import Site, SubtreeSpec
from bt_dualarm.spec.source import Data


@dataclass
class Expansion:
    """A node that uses a subtree.

    Args:
        here: Site of that node.
        ports: Its ports, with references resolved in its own scope.
        number: Number of the use, another one for each in a tree.

    Attributes:
        problems: Found so far.
    """

    here: Site
    ports: Mapping[str, Data]
    number: int
    problems: list[Problem] = field(default_factory=list)

    def site(self) -> Site | None:
        """Where the subtree's root is to be parsed, or None with the reason in the problems."""
        name = self.ports.get("use")
        if not isinstance(name, str) or is_unknown(name):
            return None  # another check says so
        subtree = self.here.library.get(name)
        if subtree is None:
            hint = suggestion(name, self.here.library, "subtree")
            self._add(("use",), f"there is no subtree '{name}'", hint)
            return None
        if subtree in self.here.uses:
            circle = [*self.here.uses[self.here.uses.index(subtree) :], subtree]
            names = " → ".join(item.name for item in circle)
            self._add(("use",), f"subtrees use each other without end: {names}")
            return None
        prefix = f"{self.here.scope.prefix}{name}#{self.number}/"
        return Site(
            subtree.source,
            subtree.path,
            Scope(self._values(subtree), prefix),
            subtree.library,
            (*self.here.uses, subtree),
            self.here.depth,
            self.here.source.key_place(self.here.path),
        )

    def _values(self, subtree: SubtreeSpec) -> dict[str, Data]:
        given = self.ports.get("params", {})
        if not isinstance(given, dict):  # the check of the ports says so
            return {name: unknown(name) for name in subtree.params}
        for name in given:
            if name not in subtree.params:
                hint = suggestion(name, subtree.params, "parameter")
                message = f"subtree '{subtree.name}' has no parameter '{name}'"
                self._add(("params", name), message, hint, key=True)
        return {
            name: self._value(subtree, name, spec, given) for name, spec in subtree.params.items()
        }

    def _value(
        self, subtree: SubtreeSpec, name: str, spec: ParamSpec, given: Mapping[str, Data]
    ) -> Data:
        if name not in given:
            if spec.default is not None:
                return spec.default
            message = f"subtree '{subtree.name}' needs its parameter '{name}'"
            self._add((), message, f"{name}: {spec.description or spec.type}", key=True)
            return unknown(name)
        if isinstance(spec, Misdeclared):
            return spec.default
        value = given[name]
        if reference_of(value) is None and spec.type == "key":
            message = f"{name}: expected a key of the blackboard"
            self._add(("params", name), message, f'for example "{{{name}}}"')
        elif reference_of(value) is None:
            for complaint in spec.complaints(name, value):
                self._add(("params", name), complaint)
        return value

    def _add(
        self, path: tuple[str, ...], message: str, hint: str = "", *, key: bool = False
    ) -> None:
        self.problems.append(self.here.into(*path).problem(message, hint, key=key))
