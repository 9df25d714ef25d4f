"""What ``"{name}"`` means where it stands: a parameter's value, or a key of the blackboard."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from bt_dualarm.spec.ports import KEY, REFERENCE, as_text, reference_of
from bt_dualarm.spec.source import Data


@dataclass(frozen=True)
class Scope:
    """Names visible in one tree, or in one use of a subtree.

    Keys of a subtree are its own: each use has a prefix that no author can write.

    Attributes:
        values: Values of the parameters; one that was given as a key is ``"{outer key}"``.
        prefix: Text before every other key.
    """

    values: Mapping[str, Data] = field(default_factory=dict)
    prefix: str = ""

    def fill(self, value: Data) -> Data:
        """The same data with parameters replaced and keys made those of the arm's blackboard."""
        if isinstance(value, dict):
            return {key: self.fill(item) for key, item in value.items()}
        if isinstance(value, list):
            return [self.fill(item) for item in value]
        name = reference_of(value)
        if name is None or not KEY.fullmatch(name):
            return value
        return self.values.get(name, f"{{{self.prefix}{name}}}")

    def fill_text(self, text: str) -> str:
        """Text with parameters written out and keys made those of the arm's blackboard."""
        return REFERENCE.sub(lambda match: as_text(self.fill(match[0])), text)

    def key(self, name: str) -> str:
        """The key of the arm's blackboard that a node writes under ``name``."""
        return reference_of(self.values.get(name)) or f"{self.prefix}{name}"


def fill_parameters(value: Data, values: Mapping[str, Data]) -> Data:
    """Data outside of trees, where no blackboard is: only parameters are replaced."""
    if isinstance(value, dict):
        return {key: fill_parameters(item, values) for key, item in value.items()}
    if isinstance(value, list):
        return [fill_parameters(item, values) for item in value]
    name = reference_of(value)
    return value if name is None else values.get(name, value)
