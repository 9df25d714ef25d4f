"""Faults that a file injects into the leaves of its trees, to test what the trees do about them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Final, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from bt_dualarm.spec.node_types import NodeSpec, port
from bt_dualarm.spec.problems import Name, Problem, suggestion
from bt_dualarm.spec.values import Duration, Value
from bt_dualarm.spec.yaml_reader import Source

FaultEffect: TypeAlias = Literal["fail", "raise", "hang"]
"""What happens to a leaf: it fails, its code raises an exception, or it never ends."""

FaultPhase: TypeAlias = Literal["start", "during", "end"]
"""When in a run of the leaf: before its first step, after a time, or when it would succeed."""

EFFECTS: Final[tuple[FaultEffect, ...]] = ("fail", "raise", "hang")
PHASES: Final[tuple[FaultPhase, ...]] = ("start", "during", "end")


class FaultSpec(Value):
    """Fault that is injected into the runs of a leaf."""

    arm: Name = port(..., "Arm whose tree has the leaf")
    leaf: str = port(..., "Path of the leaf in the tree, or the name of leaves", min_length=1)
    effect: FaultEffect = port(
        "fail", "The leaf fails, its code raises an exception, or it never ends"
    )
    phase: FaultPhase = port(
        "start", "Before its first step, `after` a time, or when it would succeed"
    )
    after: Duration = port(0.0, "Time since the start of the leaf, for the phase `during`")
    code: Annotated[str, Field(pattern=r"^[A-Z][A-Z0-9_]*$")] = port(
        "INJECTED", "Code with which it fails"
    )
    begin: Duration = port(0.0, "Simulated time from which the fault is active")
    until: Duration = port(1e9, "Simulated time until which it is active")
    times: int = port(1, "How many runs of the leaf have the fault", ge=1, le=1_000_000)
    probability: float = port(1.0, "Probability for each of them", ge=0.0, le=1.0)

    @model_validator(mode="after")
    def _times_fit(self) -> Self:
        if self.until <= self.begin:
            raise ValueError(f"until {self.until:g} s is not later than begin {self.begin:g} s")
        if self.after and self.phase != "during":
            raise ValueError(f"after is for the phase during, not for {self.phase}")
        return self


Faults: TypeAlias = Annotated[dict[Name, FaultSpec], Field(max_length=200)]
"""Faults by a name of the author's choice."""


def unique_names(children: Sequence[NodeSpec]) -> list[str]:
    """Returns the names of siblings; the second and later of equal ones are numbered."""
    seen: Counter[str] = Counter()
    names = []
    for child in children:
        seen[child.name] += 1
        count = seen[child.name]
        names.append(child.name if count == 1 else f"{child.name}#{count}")
    return names


def leaf_paths(root: NodeSpec) -> dict[str, NodeSpec]:
    """Leaves of a tree by their path, numbered where siblings have the same name."""
    found: dict[str, NodeSpec] = {}
    waiting = [(root, root.name)]
    while waiting:
        node, path = waiting.pop()
        if not node.children:
            found[path] = node
            continue
        names = unique_names(node.children)
        waiting += [(c, f"{path}/{name}") for c, name in zip(node.children, names, strict=True)]
    return found


def fault_problems(
    faults: Mapping[str, FaultSpec], source: Source, trees: Mapping[str, NodeSpec]
) -> Iterator[Problem]:
    """Yields arms and leaves of faults that the file does not have.

    Args:
        faults: Faults by name.
        source: Source of the file.
        trees: Tree of each arm, by the arm's name.
    """
    for name, fault in faults.items():
        if fault.arm not in trees:
            hint = suggestion(fault.arm, trees, "arm")
            yield source.problem(("faults", name, "arm"), f"there is no arm '{fault.arm}'", hint)
            continue
        paths = leaf_paths(trees[fault.arm])
        names = {path.rpartition("/")[2] for path in paths}
        if fault.leaf not in paths.keys() | names:
            message = f"the tree of {fault.arm} has no leaf '{fault.leaf}'"
            hint = suggestion(fault.leaf, [*paths, *names], "leaf")
            yield source.problem(("faults", name, "leaf"), message, hint)
