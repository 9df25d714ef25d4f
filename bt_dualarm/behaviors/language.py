"""The node types of the tree language and the classes that implement them.

A node type is one class with its ports, its declaration (``node_type``) and its tick; parser,
checks, schema and reference get the declarations passed in. To add one, add its class here.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from bt_dualarm.behaviors.composites import (
    Guard,
    If,
    IfThenElse,
    OnlyIf,
    Parallel,
    ReactiveFallback,
    ReactiveSequence,
    Selector,
    Sequence,
    SkipIf,
    Switch,
    Until,
    While,
)
from bt_dualarm.behaviors.conditions import (
    All,
    AnyOf,
    ArmAt,
    ArmNear,
    Elapsed,
    ForceAbove,
    InZone,
    JointAt,
    Moving,
    Not,
    ObjectAt,
    Sees,
    Touching,
)
from bt_dualarm.behaviors.coordination import Await, Claim, InStep, Meet, Signal
from bt_dualarm.behaviors.decorators import (
    Delay,
    ForceFailure,
    ForceSuccess,
    ForEach,
    Inverter,
    OnHalt,
    Rate,
    Repeat,
    Retry,
    RunOnce,
    Subtree,
    Timeout,
)
from bt_dualarm.behaviors.leaf import Compare, Fail, LanguageLeaf, Log, Set, Succeed, Test, Wait
from bt_dualarm.behaviors.node import ReportingNode
from bt_dualarm.spec.node_types import LanguageNode

_PARENTS: Final[tuple[type[ReportingNode], ...]] = (
    Sequence,
    Selector,
    ReactiveSequence,
    ReactiveFallback,
    Parallel,
    Switch,
    If,
    IfThenElse,
    While,
    Guard,
    OnlyIf,
    SkipIf,
    Until,
    Retry,
    Repeat,
    ForEach,
    All,
    AnyOf,
    Not,
    Timeout,
    Delay,
    Rate,
    Inverter,
    ForceSuccess,
    ForceFailure,
    RunOnce,
    OnHalt,
    Claim,
    InStep,
    Subtree,
)
_LEAVES: Final[tuple[type[LanguageLeaf], ...]] = (
    Wait,
    Set,
    Compare,
    Test,
    Log,
    Fail,
    Succeed,
    Signal,
    Await,
    Meet,
    ArmAt,
    ArmNear,
    InZone,
    ObjectAt,
    Sees,
    Moving,
    ForceAbove,
    Touching,
    JointAt,
    Elapsed,
)

PARENT_CLASSES: Final[Mapping[str, type[ReportingNode]]] = MappingProxyType(
    {parent.node_type.name: parent for parent in _PARENTS}
)
"""Classes of the nodes with children, by name of the node type."""

LEAF_CLASSES: Final[Mapping[str, type[LanguageLeaf]]] = MappingProxyType(
    {leaf.node_type.name: leaf for leaf in _LEAVES}
)
"""Classes of the language's leaves, by name of the node type."""

LANGUAGE: Final[Mapping[str, LanguageNode]] = MappingProxyType(
    {name: parent.node_type for name, parent in PARENT_CLASSES.items()}
    | {name: leaf.node_type for name, leaf in LEAF_CLASSES.items()}
)
"""Every node type of the language, in the order of the reference."""
