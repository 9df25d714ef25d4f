"""Random mutations of tree files: of their structure, of their values, of their text."""

from __future__ import annotations

import copy
import random
from collections.abc import Iterator
from typing import Any

import yaml

Data = Any

VALUES: tuple[Data, ...] = (
    None, True, False, 0, -1, 1, 3, 10**6, 2**60, 0.5, -0.5, 1e-300, 1e300, "", "a", "yz", "home",
    "{speed}", "{x}", "{", "{}", "{a b}", "yes", "1:30", "500 ms", "90 deg", "cube", "arm1", [], {},
    [0, 0, 0], [0], [[0]], {"xyz": [0, 0, 1]}, {"a": 1}, "x" * 600, "a\0b", "../x",
    "x" * 5000, "\u2028", "\U0001f916", "*",
)  # fmt: skip
NODES: tuple[Data, ...] = (
    "succeed", "fail", {"wait": 1}, {"set": {"key": "x", "value": 1}}, {"log": "{x}"},
    {"subtree": {"use": "a"}}, {"sequence": ["succeed"]},
    {"parallel": {"policy": 1, "children": ["succeed"]}}, {"compare": {"value": "{x}", "to": 1}},
    {"spawn": {"object": "cube"}}, {"circle": {}}, {"track": {}},
    {"object_at": {"object": "cube", "at": {"above": "cube", "by": "2 cm"}}}, {"elapsed": "3 s"},
    {"joint_at": {"object": "cube", "joint": "x", "below": 3}}, {"sees": {"color": "red"}},
    {"grasp": {"object": "cube", "then_at": {"on": "cube"}}}, {"operate": {"joint": "x", "to": 1}},
    {"for_each": {"items": [1, "a"], "item": "x", "child": {"log": "{x}"}}},
    {"transport": {"object": "cube", "to": {"beside": "cube"}, "keep": {"upright": "5 deg"}}},
)  # fmt: skip
WRAPPERS = (
    "sequence", "selector", "parallel", "retry", "repeat", "timeout", "delay", "rate", "inverter",
    "force_success", "force_failure", "run_once", "if", "while", "guard", "on_halt", "switch",
    "subtree", "reactive_sequence", "reactive_fallback", "if_then_else", "only_if", "skip_if",
    "until", "for_each", "all", "any", "not", "claim", "in_step",
)  # fmt: skip
PIECES = (
    "\n",
    "  ",
    ":",
    "-",
    "{",
    "}",
    "[",
    "]",
    '"',
    "'",
    "#",
    "&a ",
    "*a",
    "!t ",
    "<<: ",
    "\t",
    "%",
)


_DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
"""The dumper in C, if available: with the one in Python, writing took as long as checking."""


def mutated(data: Data, dice: random.Random) -> str:
    """Text of a file with a few mutations."""
    data = copy.deepcopy(data)
    # Often a single one: several are hardly ever accepted.
    for _ in range(dice.choice((1, 1, 2, 3, 4))):
        _mutate(data, dice)
    text: str = yaml.dump(data, Dumper=_DUMPER, sort_keys=False, allow_unicode=True)
    return _torn(text, dice) if dice.random() < 0.2 else text


def _mutate(data: Data, dice: random.Random) -> None:
    holder, key = dice.choice(list(_places(data)) or [([None], 0)])
    choice = dice.random()
    if choice < 0.3:
        holder[key] = copy.deepcopy(dice.choice(VALUES))
    elif choice < 0.45:
        holder[key] = copy.deepcopy(dice.choice(NODES))
    elif choice < 0.6:
        holder[key] = _wrapped(holder[key], dice)
    elif choice < 0.75:
        del holder[key]
    elif choice < 0.9 and isinstance(holder, dict):
        holder[dice.choice((f"{key}s", str(key)[:-1], "name", "child", "x", ""))] = holder.pop(key)
    else:
        other, place = dice.choice(list(_places(data)) or [([None], 0)])
        holder[key] = copy.deepcopy(other[place])


def _wrapped(node: Data, dice: random.Random) -> Data:
    body = {"child": node, "children": [node, "succeed"], "condition": node, "then": node}
    extra = {
        "times": 2,
        "seconds": 1,
        "hz": 5,
        "cleanup": "succeed",
        "cases": {"a": node},
        "use": "a",
        "items": [1, "{x}"],
        "item": "x",
        "until": "{x} > 1",
    }
    kept = {k: v for k, v in (body | extra).items() if dice.random() < 0.5}
    return {dice.choice(WRAPPERS): kept}


def _places(data: Data) -> Iterator[tuple[Any, Any]]:
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in items:
        yield data, key
        if isinstance(value, (dict, list)):
            yield from _places(value)


def _torn(text: str, dice: random.Random) -> str:
    start = dice.randrange(len(text) + 1)
    end = min(len(text), start + dice.randrange(20))
    return text[:start] + dice.choice(PIECES) + text[dice.choice((start, end)) :]
