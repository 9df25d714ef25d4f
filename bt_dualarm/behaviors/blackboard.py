"""Blackboards, and the ports of a node bound to literals or keys."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from pydantic import ValidationError

from bt_dualarm.core.errors import Failure
from bt_dualarm.spec.explain import explain
from bt_dualarm.spec.ports import (
    REFERENCE,
    PortModel,
    as_text,
    key_name,
    only,
    references_in,
    shown,
    templates_of,
    validated,
)
from bt_dualarm.spec.yaml_reader import Data


class Blackboard:
    """Blackboard of one arm: values by key, in YAML notation.

    py_trees' blackboard is one for the whole process: two trees that write ``target`` would
    overwrite each other.
    """

    def __init__(self) -> None:
        self._values: dict[str, Data] = {}

    def read(self, key: str) -> Data:
        """Returns the value of a key.

        Raises:
            Failure: ``NO_VALUE``: the key was not written yet.
        """
        if key not in self._values:
            raise Failure("NO_VALUE", f"no node has written '{key_name(key)}' yet")
        return self._values[key]

    def write(self, key: str, value: Data) -> None:
        """Set a key."""
        self._values[key] = value

    def write_out(self, text: str) -> str:
        """Returns text with each ``{key}`` replaced by its value, if it has one."""
        return REFERENCE.sub(self._written, text)

    def _written(self, match: re.Match[str]) -> str:
        key = match[1]
        return as_text(self._values[key]) if key in self._values else shown(match[0])


class BoundPorts:
    """Ports of one node, bound to a blackboard: references are resolved at each start of the node.

    Args:
        model: Model of the ports.
        ports: Checked ports, as in the file.
        blackboard: Blackboard with the values of references.
    """

    def __init__(
        self, model: type[PortModel], ports: Mapping[str, Data], blackboard: Blackboard
    ) -> None:
        self._model = model
        self._ports = ports
        self._blackboard = blackboard
        self._references = references_in(model, ports)
        self._templates = {
            name for name in templates_of(model) if REFERENCE.search(str(ports.get(name, "")))
        }
        dynamic = self._references or self._templates
        self._known = None if dynamic else validated(model, ports)

    def now(self) -> PortModel:
        """Returns the ports with the current values of the blackboard.

        Raises:
            Failure: ``NO_VALUE``: a key has no value, or one that its port does not allow.
        """
        if self._known is not None:
            return self._known
        values = dict(self._ports)
        values |= {name: self._blackboard.read(key) for name, key in self._references.items()}
        values |= {name: self._blackboard.write_out(values[name]) for name in self._templates}
        try:
            return validated(self._model, values)
        except ValidationError as error:
            found = next(explain(error, self._model, values, "port"))
            raise Failure(
                "NO_VALUE", f"a key has a value that is not allowed: {found.message}"
            ) from error


class Outputs:
    """Outputs of one leaf, bound to a blackboard.

    Args:
        model: Model of the outputs.
        keys: Key of each output to which the file gives one; the others are discarded.
        blackboard: Blackboard to which they are written, in YAML notation.
        on_write: Receiver of key and value after each write.
    """

    def __init__(
        self,
        model: type[PortModel],
        keys: Mapping[str, str],
        blackboard: Blackboard,
        on_write: Callable[[str, Data], None] = lambda _key, _value: None,
    ) -> None:
        self._model = model
        self._keys = keys
        self._blackboard = blackboard
        self._on_write = on_write

    def write(self, name: str, value: object) -> None:
        """Write one output to the blackboard.

        Raises:
            KeyError: The skill declares no such output.
            pydantic.ValidationError: The value is not of the declared type.
        """
        if name not in self._model.model_fields:
            raise KeyError(f"the skill declares no output '{name}'")
        if name not in self._keys:
            return
        model = only(self._model, name)
        given = model.model_construct(None, **{name: value})
        data = given.model_dump(mode="json", warnings="error")
        validated(model, data)
        self._blackboard.write(self._keys[name], data[name])
        self._on_write(self._keys[name], data[name])
