"""The words of the tree language: every node that is not a skill, with its places and ports."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from bt_dualarm.spec.kind import Kind as Kind
from bt_dualarm.spec.kind import NoPorts, Slot
from bt_dualarm.spec.word_ports import (
    Compare,
    Fail,
    Log,
    Memory,
    Parallel,
    Rate,
    Repeat,
    Retry,
    Seconds,
    Set,
    Subtree,
    Switch,
)

_MEMORY: Final = frozenset({"memory"})
_CHILD: Final = (Slot("child"),)
_CONDITIONED: Final = (Slot("condition"), Slot("child"))

_KINDS: Final = (
    Kind(
        "sequence",
        "Children one after the other until one fails",
        Memory,
        many=True,
        fixed=_MEMORY,
        example="sequence: [{wait: 1}, {log: a second is over}]",
    ),
    Kind(
        "selector",
        "Children one after the other until one succeeds",
        Memory,
        many=True,
        fixed=_MEMORY,
        example="selector: [{compare: {value: 1, to: 2}}, {log: they differ}]",
    ),
    Kind(
        "parallel",
        "All children at once",
        Parallel,
        many=True,
        fixed=frozenset({"policy", "on_failure"}),
        example="parallel: {policy: any, children: [{wait: 1}, {wait: 2}]}",
    ),
    Kind(
        "switch",
        "The child whose case equals a value",
        Switch,
        cases=True,
        slots=(Slot("default", required=False),),
        example="switch: {value: red, cases: {red: {log: stop}, green: {log: go}}, default: fail}",
    ),
    Kind(
        "if",
        "One child or the other, as a condition says once at the start",
        NoPorts,
        slots=(Slot("condition"), Slot("then"), Slot("else", required=False)),
        example="if: {condition: {compare: {value: 1, to: 2}}, then: succeed, else: fail}",
    ),
    Kind(
        "while",
        "Starts its child again and again as long as a condition holds",
        NoPorts,
        slots=_CONDITIONED,
        example="while: {condition: {compare: {value: 1, to: 2}}, child: {wait: 1}}",
    ),
    Kind(
        "retry",
        "Starts its child again when it fails",
        Retry,
        slots=_CHILD,
        example="retry: {times: 3, delay: 0.5, child: {compare: {value: 1, to: 2}}}",
    ),
    Kind(
        "repeat",
        "Starts its child again when it succeeds",
        Repeat,
        slots=_CHILD,
        example="repeat: {times: 3, child: {wait: 1}}",
    ),
    Kind(
        "timeout",
        "Halts its child and fails after a time",
        Seconds,
        slots=_CHILD,
        example="timeout: {seconds: 5, child: {wait: 1}}",
    ),
    Kind(
        "delay",
        "Waits before its child starts",
        Seconds,
        slots=_CHILD,
        example="delay: {seconds: 500 ms, child: {log: now}}",
    ),
    Kind(
        "rate",
        "Ticks its child less often",
        Rate,
        slots=_CHILD,
        example="rate: {hz: 2, child: {wait: 5}}",
    ),
    Kind(
        "inverter",
        "Success for failure and failure for success",
        NoPorts,
        slots=_CHILD,
        example="inverter: {child: {compare: {value: 1, to: 2}}}",
    ),
    Kind(
        "force_success",
        "Success, however its child ends",
        NoPorts,
        slots=_CHILD,
        example="force_success: {child: {compare: {value: 1, to: 2}}}",
    ),
    Kind(
        "force_failure",
        "Failure, however its child ends",
        NoPorts,
        slots=_CHILD,
        example="force_failure: {child: {log: on to the next branch}}",
    ),
    Kind(
        "run_once",
        "Runs its child to an end once, then repeats that result",
        NoPorts,
        slots=_CHILD,
        example="run_once: {child: {log: said only once}}",
    ),
    Kind(
        "guard",
        "Halts its child and fails once a condition no longer holds",
        NoPorts,
        slots=_CONDITIONED,
        example="guard: {condition: {compare: {value: 1, to: 1}}, child: {wait: 5}}",
    ),
    Kind(
        "on_halt",
        "Ticks a clean-up once when its child is halted",
        NoPorts,
        slots=(Slot("child"), Slot("cleanup")),
        example="on_halt: {child: {wait: 5}, cleanup: {log: interrupted}}",
    ),
    Kind(
        "subtree",
        "A subtree by name, with values for its parameters",
        Subtree,
        example="subtree: {use: pause, params: {time: 2}}",
    ),
    Kind(
        "wait",
        "Succeeds after a time",
        Seconds,
        shorthand="seconds",
        example="wait: 500 ms",
    ),
    Kind(
        "set",
        "Writes a key of the blackboard",
        Set,
        example="set: {key: height, value: 0.2}",
    ),
    Kind(
        "compare",
        "Succeeds if a comparison holds",
        Compare,
        example="compare: {value: 1, relation: less, to: 2}",
    ),
    Kind(
        "log",
        "Writes a line to the log",
        Log,
        shorthand="message",
        example="log: the cube is there",
    ),
    Kind(
        "fail",
        "Fails at once",
        Fail,
        shorthand="reason",
        example="fail: {code: NO_CUBE, reason: the table is empty}",
    ),
    Kind(
        "succeed",
        "Succeeds at once",
        NoPorts,
        example="succeed",
    ),
)

LANGUAGE: Final[Mapping[str, Kind]] = MappingProxyType({kind.name: kind for kind in _KINDS})
"""Every word of the language by name."""
