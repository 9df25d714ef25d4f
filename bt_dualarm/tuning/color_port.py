"""Which leaf of a tree file looks for a colour, and where that colour is written."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from bt_dualarm.errors import DualArmError
from bt_dualarm.spec.annotations import models_in
from bt_dualarm.spec.color import Color
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.ports import key_name, reference_of
from bt_dualarm.spec.problems import SpecError
from bt_dualarm.spec.source import Path, Source, with_tuples


class NoColorPortError(DualArmError):
    """No leaf looks for a colour, or several do and it is open which is meant."""


@dataclass(frozen=True, eq=False)
class ColorPort:
    """A port that says what a camera looks for.

    Attributes:
        node: Leaf of a tree.
        port: Name of the port.
        color: Colour in the port, None where a key of the blackboard brings it.
    """

    node: NodeSpec
    port: str
    color: Color | None

    @property
    def path(self) -> Path:
        """Path of the port in the file of the node."""
        return (*self.node.path, self.node.kind, self.port)

    def home(self) -> tuple[Source, Path]:
        """File and place at which the colour is written, or would be.

        Raises:
            SpecError: It comes from somewhere that is not of one colour alone.
        """
        source, reference = self.node.source, reference_of(self.node.source.get(self.path))
        if reference is None:
            return source, self.path
        name, problem = key_name(reference), self.node.port_problem
        hint = "write the colour here instead, or make it a parameter of type color"
        declared = source.get(("params", name)) if self.node.user is None else None
        if not isinstance(declared, dict):
            what = "a parameter of the subtree or a key of the blackboard"
            message = f"{self.node.kind}: this colour is '{{{name}}}', {what}"
            raise SpecError([problem((self.port,), message, hint)])
        if declared.get("type") != "color":
            message = f"this colour is the parameter '{name}', which is no colour but a "
            words = f"{message}{declared.get('type')}: it cannot hold ranges"
            raise SpecError([source.problem(("params", name), words, hint, key=True)])
        return source, ("params", name, "default")


def color_ports(file: TreeFile, arm: str, kinds: Mapping[str, Kind]) -> Iterator[ColorPort]:
    """Ports of an arm's tree that take a colour, each once, in the order of the file."""
    seen = set()
    for node in file.arms[arm].tree.walk():
        fields = kinds[node.kind].ports.model_fields if node.kind in kinds else {}
        for name, field in fields.items():
            if Color not in models_in(field.annotation):
                continue
            value = node.ports.get(name, field.default)
            known = reference_of(value) is None and value is not None
            color = Color.model_validate(with_tuples(value)) if known else None
            found = ColorPort(node, name, color)
            if (node.source.file, found.path) not in seen:
                seen.add((node.source.file, found.path))
                yield found


def choose(ports: Sequence[ColorPort], arm: str, line: int | None = None) -> ColorPort:
    """The port that is meant: the only one, or the one of the node in a line of the file.

    Raises:
        NoColorPortError: There is none, or several and no line.
    """
    fitting = [one for one in ports if line in (None, one.node.place.line)]
    if len(fitting) == 1:
        return fitting[0]
    if not ports:
        raise NoColorPortError(f"no leaf of {arm} looks for a colour")
    places = "\n".join(f"  {one.node.place}  {one.node.name}" for one in ports)
    if not fitting:
        raise NoColorPortError(f"no leaf in line {line} looks for a colour; these do:\n{places}")
    raise NoColorPortError(f"{len(fitting)} leaves look for a colour; say --line N:\n{places}")
