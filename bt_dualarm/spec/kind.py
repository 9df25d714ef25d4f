"""What may be written for a node: declared once, for the check, the schema and the docs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from bt_dualarm.spec.ports import PortModel


class NoPorts(PortModel):
    """Nothing to set."""


@dataclass(frozen=True)
class Slot:
    """A place for one child.

    Attributes:
        name: Name in the file.
        required: Whether a node cannot do without.
        after: Which end of the child in the first slot leads here, success (True) or failure
            (False); None where that does not matter.
    """

    name: str
    required: bool = True
    after: bool | None = None


@dataclass(frozen=True)
class Kind:
    """What may be written for one kind of node, a word of the language or a skill.

    Attributes:
        name: Name in the file.
        summary: One line for people.
        ports: Model of its inputs.
        outputs: Model of what it writes to the blackboard where the file names a key.
        slots: Places for one child each.
        many: Whether it takes a list of children.
        cases: Whether it takes a mapping of children, ``cases``.
        fixed: Ports that must be written out; no key of the blackboard can give them.
        shorthand: The port that a bare value stands for: ``wait: 2``.
        uses: Port that names a subtree, whose tree becomes the node's child; empty if none does.
        brings_in: Ports that name what the node brings into the world.
        needs_camera: Whether it works only with a camera that moves with the arm.
        needs_gripper: Whether it works only with an arm that has a gripper.
        failures: Codes of its failures with their meaning.
        example: Node in YAML.
        origin: Place it comes from: a file for skills.
    """

    name: str
    summary: str
    ports: type[PortModel] = NoPorts
    outputs: type[PortModel] = NoPorts
    slots: tuple[Slot, ...] = ()
    many: bool = False
    cases: bool = False
    fixed: frozenset[str] = frozenset()
    shorthand: str = ""
    uses: str = ""
    brings_in: frozenset[str] = frozenset()
    needs_camera: bool = False
    needs_gripper: bool = False
    failures: Mapping[str, str] = field(default_factory=dict)
    example: str = ""
    origin: str = "the language"

    @property
    def is_leaf(self) -> bool:
        """Whether no children are written for it."""
        return not (self.slots or self.many or self.cases)

    def is_alternative(self, slot: str) -> bool:
        """Whether only one of the children in such slots is ever ticked."""
        return self.cases or any(one.name == slot and one.after is not None for one in self.slots)

    @cached_property
    def places(self) -> frozenset[str]:
        """What may stand beside the ports: the name, outputs and the places of children."""
        lists = ["children"] * self.many + ["cases"] * self.cases
        slots = (slot.name for slot in self.slots)
        return frozenset({"name", *lists, *slots, *self.outputs.model_fields})

    @cached_property
    def no_ports(self) -> frozenset[str]:
        """What stands beside the ports and is no output: the name and the places of children."""
        return self.places - self.outputs.model_fields.keys()
