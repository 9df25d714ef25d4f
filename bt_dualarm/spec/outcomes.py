"""How each node of a tree can end, and warnings that follow from it.

Warns of branches that no tick can reach, of leaves after a node that never ends, and of
decorators that change nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.ports import reference_of
from bt_dualarm.spec.problems import Problem


@dataclass(frozen=True)
class Ends:
    """How a node can end; one that can do neither never ends."""

    succeeds: bool = True
    fails: bool = True

    @property
    def never(self) -> bool:
        """Whether it goes on until it is halted."""
        return not (self.succeeds or self.fails)


_EITHER: Final = Ends()
_SUCCESS: Final = Ends(fails=False)
_FAILURE: Final = Ends(succeeds=False)

_LEAVES: Final[Mapping[str, Ends]] = {
    "succeed": _SUCCESS,
    "set": _SUCCESS,
    "log": _SUCCESS,
    "wait": _SUCCESS,
    "fail": _FAILURE,
}


def ends_below(root: NodeSpec) -> dict[NodeSpec, Ends]:
    """How each node of a tree can end, as far as that can be told from the file."""
    known: dict[NodeSpec, Ends] = {}

    def visit(node: NodeSpec) -> Ends:
        children = [visit(child) for child in node.children]
        known[node] = _ends(node, children)
        return known[node]

    visit(root)
    return known


def _ends(node: NodeSpec, children: list[Ends]) -> Ends:
    if not children:
        reads = any(reference_of(value) for value in node.ports.values())
        return _EITHER if reads else _LEAVES.get(node.kind, _EITHER)
    rule = _RULES.get(node.kind)
    return rule(node, children) if rule else _EITHER


def _sequence(_: NodeSpec, children: list[Ends]) -> Ends:
    reached = children[: _first(children, lambda ends: not ends.succeeds) + 1]
    return Ends(all(ends.succeeds for ends in children), any(ends.fails for ends in reached))


def _selector(_: NodeSpec, children: list[Ends]) -> Ends:
    reached = children[: _first(children, lambda ends: not ends.fails) + 1]
    return Ends(any(ends.succeeds for ends in reached), all(ends.fails for ends in children))


def _first(children: list[Ends], stops: Callable[[Ends], bool]) -> int:
    """Index of the first child after which none is reached, else that of the last."""
    return next((i for i, ends in enumerate(children) if stops(ends)), len(children) - 1)


def _parallel(node: NodeSpec, children: list[Ends]) -> Ends:
    policy = node.ports.get("policy", "all")
    needed: int = {"all": len(children), "any": 1}.get(policy) or policy
    succeed = sum(ends.succeeds for ends in children)
    fail = sum(ends.fails for ends in children)
    tolerated = len(children) - needed if node.ports.get("on_failure") == "continue" else 0
    return Ends(succeed >= needed, fail > tolerated)


def _if(_: NodeSpec, children: list[Ends]) -> Ends:
    condition, then, *other = children
    reached = [then] * condition.succeeds + (other or [_SUCCESS]) * condition.fails
    return Ends(any(e.succeeds for e in reached), any(e.fails for e in reached))


def _while(_: NodeSpec, children: list[Ends]) -> Ends:
    condition, child = children
    return Ends(condition.fails, condition.succeeds and child.fails)


def _repeat(node: NodeSpec, children: list[Ends]) -> Ends:
    forever = node.ports.get("times") == "forever"
    return Ends(children[0].succeeds and not forever, children[0].fails)


def _guard(_: NodeSpec, children: list[Ends]) -> Ends:
    condition, child = children
    return Ends(condition.succeeds and child.succeeds, condition.fails or child.fails)


_RULES: Final[Mapping[str, Callable[[NodeSpec, list[Ends]], Ends]]] = {
    "sequence": _sequence,
    "selector": _selector,
    "parallel": _parallel,
    "switch": lambda node, ends: Ends(
        any(e.succeeds for e in ends), "default" not in node.slots or any(e.fails for e in ends)
    ),
    "if": _if,
    "while": _while,
    "guard": _guard,
    "repeat": _repeat,
    "retry": lambda _, ends: ends[0],
    "timeout": lambda _, ends: Ends(ends[0].succeeds, True),
    "delay": lambda _, ends: ends[0],
    "rate": lambda _, ends: ends[0],
    "run_once": lambda _, ends: ends[0],
    "subtree": lambda _, ends: ends[0],
    "on_halt": lambda _, ends: ends[0],
    "inverter": lambda _, ends: Ends(ends[0].fails, ends[0].succeeds),
    "force_success": lambda _, ends: ends[0] if ends[0].never else _SUCCESS,
    "force_failure": lambda _, ends: ends[0] if ends[0].never else _FAILURE,
}


def warnings(root: NodeSpec) -> Iterator[Problem]:
    """Everything in a tree that is allowed but can hardly be meant."""
    ends = ends_below(root)
    for node in root.walk():
        children = [ends[child] for child in node.children]
        for message, where in (*_unreachable(node, children), *_without_effect(node, children)):
            yield replace(where.problem(message), severity="warning")


def _unreachable(node: NodeSpec, ends: list[Ends]) -> Iterator[tuple[str, NodeSpec]]:
    if node.kind in ("sequence", "selector"):
        stops = (lambda e: not e.succeeds) if node.kind == "sequence" else (lambda e: not e.fails)
        last = _first(ends, stops)
        if last + 1 < len(ends):
            before = node.children[last]
            how = "never ends"
            if not ends[last].never:
                how = "always fails" if node.kind == "sequence" else "cannot fail"
            message = f"no tick reaches this: '{before.name}' before it {how}"
            yield message, node.children[last + 1]
    for slot, child in zip(node.slots, node.children, strict=True):
        if node.kind in ("if", "while", "guard") and slot in ("then", "child"):
            if not ends[0].succeeds:
                yield f"no tick reaches this: '{node.children[0].name}' never holds", child
        elif slot == "else" and not ends[0].fails:
            yield f"no tick reaches this: '{node.children[0].name}' always holds", child


def _without_effect(node: NodeSpec, ends: list[Ends]) -> Iterator[tuple[str, NodeSpec]]:
    child = node.children[0].name if node.children else ""
    if node.kind in ("retry", "repeat") and node.ports.get("times") == 1:
        yield f"{node.kind} with times: 1 does nothing", node
    elif node.kind == "retry" and not ends[0].fails:
        yield f"retry does nothing: '{child}' cannot fail", node
    elif node.kind == "repeat" and not ends[0].succeeds:
        yield f"repeat does nothing: '{child}' cannot succeed", node
    elif node.kind == "force_success" and not ends[0].fails:
        yield f"force_success does nothing: '{child}' cannot fail", node
    elif node.kind == "force_failure" and not ends[0].succeeds:
        yield f"force_failure does nothing: '{child}' cannot succeed", node
    elif node.kind == "inverter" and node.children and node.children[0].kind == "inverter":
        yield "two inverters, one in the other, do nothing", node
    elif node.kind == "parallel" and len(node.children) == 1:
        yield "a parallel of one child does nothing", node
