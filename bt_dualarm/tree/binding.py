"""Ports of a node in a built tree: literals known from the start, keys read at each start."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from pydantic import ValidationError

from bt_dualarm.errors import Failure
from bt_dualarm.spec.explain import explain
from bt_dualarm.spec.ports import (
    REFERENCE,
    PortModel,
    only,
    references_in,
    templates_of,
    validated,
)
from bt_dualarm.spec.source import Data
from bt_dualarm.tree.board import Board


class BoundPorts:
    """The ports of one node.

    Args:
        model: Types of the ports.
        ports: Ports as the file has them; the check has passed.
        board: Blackboard on which references are looked up.
    """

    def __init__(self, model: type[PortModel], ports: Mapping[str, Data], board: Board) -> None:
        self._model = model
        self._ports = ports
        self._board = board
        self._references = references_in(model, ports)
        self._templates = {
            name for name in templates_of(model) if REFERENCE.search(str(ports.get(name, "")))
        }
        dynamic = self._references or self._templates
        self._known = None if dynamic else validated(model, ports)

    def now(self) -> PortModel:
        """The ports with the values that the blackboard has now.

        Raises:
            Failure: ``NO_VALUE``: a key has no value, or none that this port takes.
        """
        if self._known is not None:
            return self._known
        values = dict(self._ports)
        values |= {name: self._board.read(key) for name, key in self._references.items()}
        values |= {name: self._board.write_out(values[name]) for name in self._templates}
        try:
            return validated(self._model, values)
        except ValidationError as error:
            found = next(explain(error, self._model, values, "port"))
            raise Failure(
                "NO_VALUE", f"a key has a value that is not allowed: {found.message}"
            ) from error


class Outputs:
    """What one leaf may write to the blackboard.

    Args:
        model: Types of the outputs.
        keys: Key that the file gives for an output; the others are not kept.
        board: Blackboard on which they are written, in YAML's notation.
        wrote: Function that is told key and value after each writing.
    """

    def __init__(
        self,
        model: type[PortModel],
        keys: Mapping[str, str],
        board: Board,
        wrote: Callable[[str, Data], None] = lambda _key, _value: None,
    ) -> None:
        self._model = model
        self._keys = keys
        self._board = board
        self._wrote = wrote

    def write(self, name: str, value: object) -> None:
        """Put one output on the blackboard.

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
        self._board.write(self._keys[name], data[name])
        self._wrote(self._keys[name], data[name])
