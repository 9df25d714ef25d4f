"""Node types as the check sees them: ports, children, outcomes; and the nodes of a tree file.

The node types of the language are the classes in `bt_dualarm.behaviors`, each with its `NodeType`;
those of skills come from the registry. Parser and checks get them passed in.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Final, TypeAlias

from bt_dualarm.spec.ports import PortModel
from bt_dualarm.spec.problems import Location, Problem, suggestion
from bt_dualarm.spec.yaml_reader import Data, DataPath, Source


class NoPorts(PortModel):
    """Nothing to set."""


@dataclass(frozen=True)
class Slot:
    """A named child of a node.

    Attributes:
        name: Name in the file.
        required: Whether the child must be given.
        after: Result of the child in the first slot that leads to this one, success (True) or
            failure (False); None if that does not matter.
    """

    name: str
    required: bool = True
    after: bool | None = None


@dataclass(frozen=True)
class NodeType:
    """Declaration of a node type, of the language or of a skill.

    Attributes:
        name: Name in the file.
        summary: One-line description.
        ports: Model of its inputs.
        outputs: Model of its outputs, written to the blackboard if the file names a key.
        slots: Named children.
        many: Whether it takes a list of children.
        cases: Whether it takes a mapping of children, ``cases``.
        fixed: Ports that need a literal value and cannot come from the blackboard.
        shorthand: Port that a bare value stands for: ``wait: 2``.
        uses: Port that names a subtree, whose tree becomes the node's child; empty if none does.
        brings_in: Ports that name what the node spawns.
        needs_camera: Whether it works only with a camera that moves with the arm.
        needs_gripper: Whether it works only with an arm that has a gripper.
        failures: Failure codes with their meaning.
        example: A node in YAML.
        origin: Where it is defined: a file for skills.
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
        """Returns whether only one of the children in such slots is ever ticked."""
        return self.cases or any(one.name == slot and one.after is not None for one in self.slots)

    @cached_property
    def fields_besides_ports(self) -> frozenset[str]:
        """Fields of a node that are not ports: its name, outputs and children."""
        return self.no_data_fields | self.outputs.model_fields.keys()

    @cached_property
    def no_data_fields(self) -> frozenset[str]:
        """Fields of a node that are neither ports nor outputs: its name and children."""
        lists = ["children"] * self.many + ["cases"] * self.cases
        return frozenset({"name", *lists, *(slot.name for slot in self.slots)})


@dataclass(frozen=True, eq=False)
class NodeSpec:
    """A node of a tree file with its descendants, parsed but not checked.

    Attributes:
        kind: Name of its node type: ``sequence``, or a skill's name.
        name: Name given by the author, else the kind.
        ports: Everything else that the node was given, as YAML data; parameters are filled in.
        children: Children in the order of the file.
        slots: Role of each child: ``children``, ``child``, ``condition``, a case, …
        source: File that contains it.
        path: Path in that file.
        whole: Whether all of it could be parsed.
        user: Location where the subtree that it is part of is used, if it is part of one.
        parameters: Names of the parameters that it may refer to.
    """

    kind: str
    name: str
    ports: Mapping[str, Data]
    children: tuple[NodeSpec, ...] = ()
    slots: tuple[str, ...] = ()
    source: Source = field(default_factory=lambda: Source("<none>", ()), repr=False)
    path: DataPath = field(default=(), repr=False)
    whole: bool = field(default=True, repr=False)
    user: Location | None = field(default=None, repr=False)
    parameters: frozenset[str] = field(default=frozenset(), repr=False)

    @property
    def location(self) -> Location:
        """Location of the node's kind in the file."""
        return self.source.key_location((*self.path, self.kind))

    def problem(self, message: str, hint: str = "") -> Problem:
        """Error of the node as a whole."""
        return Problem(self.location, message, hint)

    def port_problem(
        self, path: DataPath, message: str, hint: str = "", *, key: bool = False
    ) -> Problem:
        """Error of one port, or of a part of its value."""
        return self.source.problem((*self.path, self.kind, *path), message, hint, key=key)

    def walk(self) -> Iterator[NodeSpec]:
        """Yields the node, then its descendants, in the order of the file."""
        waiting = [self]
        while waiting:
            node = waiting.pop()
            yield node
            waiting += reversed(node.children)


@dataclass(frozen=True)
class Outcomes:
    """Possible results of a node; a node with neither never ends."""

    succeeds: bool = True
    fails: bool = True

    @property
    def never(self) -> bool:
        """Whether the node runs until it is halted."""
        return not (self.succeeds or self.fails)


EITHER: Final = Outcomes()
SUCCESS: Final = Outcomes(fails=False)
FAILURE: Final = Outcomes(succeeds=False)

ChildOutcomes: TypeAlias = Sequence[Outcomes]
"""Outcomes of each child of a node, in the order of the file."""

OutcomeRule: TypeAlias = Callable[[NodeSpec, ChildOutcomes], Outcomes]
"""Outcomes of a node, given those of its children."""

ProblemRule: TypeAlias = Callable[[NodeSpec], Iterator[Problem]]
"""Problems of a node that the types of its ports cannot express."""

NoEffectRule: TypeAlias = Callable[[NodeSpec, ChildOutcomes], str]
"""Why a node has no effect, given the outcomes of its children; empty if it has one."""


def either(_: NodeSpec, _children: ChildOutcomes) -> Outcomes:
    """`OutcomeRule` of a node that can succeed and can fail."""
    return EITHER


def success(_: NodeSpec, _children: ChildOutcomes) -> Outcomes:
    """`OutcomeRule` of a node that cannot fail."""
    return SUCCESS


def failure(_: NodeSpec, _children: ChildOutcomes) -> Outcomes:
    """`OutcomeRule` of a node that cannot succeed."""
    return FAILURE


def as_child(_: NodeSpec, children: ChildOutcomes) -> Outcomes:
    """`OutcomeRule` of a node that ends as its first child does."""
    return children[0]


def always(_: NodeSpec) -> bool:
    """Rule that holds for every node of a type."""
    return True


def _never(_: NodeSpec) -> bool:
    return False


def _no_problems(_: NodeSpec) -> Iterator[Problem]:
    yield from ()


def _has_effect(_: NodeSpec, _children: ChildOutcomes) -> str:
    return ""


@dataclass(frozen=True, kw_only=True)
class LanguageNode(NodeType):
    """Declaration of a node type of the language, with the rules for its nodes.

    Attributes:
        outcomes: Outcomes of a node.
        advances_on: Whether a child that succeeds (True) or one that fails (False) is followed by
            the next; None if children do not follow each other.
        revisits: Whether a node may tick a child after one that comes later in the file.
        runs_all: Whether every run of a node that goes as planned runs all children once, in order.
        problems: Problems of a node beyond the types of its ports.
        no_effect: Why a node has no effect.
        synonyms: Names in other behavior tree libraries, each with what to write here besides
            the name, ``memory: false``, or nothing.
    """

    outcomes: OutcomeRule = either
    advances_on: bool | None = None
    revisits: Callable[[NodeSpec], bool] = _never
    runs_all: Callable[[NodeSpec], bool] = _never
    problems: ProblemRule = _no_problems
    no_effect: NoEffectRule = _has_effect
    synonyms: Mapping[str, str] = field(default_factory=dict)


RESERVED_NAMES: Final = frozenset(
    {
        "sequence", "selector", "parallel", "switch", "if", "while", "guard",
        "retry", "repeat", "timeout", "delay", "rate", "inverter", "force_success",
        "force_failure", "run_once", "on_halt", "subtree",
        "wait", "set", "compare", "log", "fail", "succeed",
        "signal", "await", "meet", "claim",
    }
)  # fmt: skip
"""Names of the language's node types. No skill may have one of them: the registry of skills, which
is below `bt_dualarm.behaviors`, checks that."""

_OWN_SKILLS: Final = "(load your own skills with --skills DIR)"


def synonyms_in(node_types: Iterable[NodeType]) -> dict[str, str]:
    """Names in other behavior tree libraries, each with what to write here instead."""
    return {
        synonym: f"{node_type.name}, with {besides}" if besides else node_type.name
        for node_type in node_types
        if isinstance(node_type, LanguageNode)
        for synonym, besides in node_type.synonyms.items()
    }


def kind_hint(given: str, node_types: Mapping[str, NodeType]) -> str:
    """Hint for an unknown node type: our name for it, the nearest name, or all names."""
    name, colon, rest = given.partition(":")
    if colon and rest:
        return f"write a space after the colon: '{name}: {rest}'"
    known = {_letters(kind): kind for kind in node_types}
    synonyms = synonyms_in(node_types.values())
    ours = {_letters(name): meant for name, meant in synonyms.items()} | known
    meant = ours.get(_letters(given), "")
    if meant:
        name, comma, how = meant.partition(",")
        return f"here it is '{name}'{comma}{how}"
    return f"{suggestion(given, known.values(), 'kind of node')} {_OWN_SKILLS}"


@lru_cache(maxsize=1024)
def _letters(name: str) -> str:
    """Returns a name for comparison: without case and underscores."""
    return re.sub("[^a-z0-9]", "", name.lower())
