"""Random mutations of robot descriptions: of their structure, their values and their text."""

from __future__ import annotations

import copy
import random
from collections.abc import Iterator
from typing import Any

import yaml

Data = Any
"""Any value that YAML can represent."""

VALUES: tuple[Data, ...] = (
    None, True, 0, -1, 1, 2, 0.5, -0.5, 1e-300, 1e300, 1e-9, 1e9, float("nan"), float("inf"), 720,
    "", "a", "home", "base", "flange", "finger", "upper", "elbow", "shoulder", "slide",
    "hand_joint", "world", "tool", "small.urdf", "small.srdf", "../small.urdf", "/etc/passwd",
    "small.yaml", "x" * 300, "a\0b", "\x1b[2J", "\u2028", "\U0001f916", [], {}, [0, 0, 0],
    [0, 0, 1], [1, 0, 0], [[0]], ["elbow"], ["elbow", "shoulder"], ["shoulder", "shoulder"],
    [0, 0], [10, 20], [1e9, 1e9], {"xyz": [0, 0, 1]}, {"slide": 0.01}, {"elbow": 1},
    {"hand_joint": 10},
    {"value": 3, "source": "chosen for this test"},
)  # fmt: skip
PIECES = ("\n", "  ", ":", "-", "{", "}", "[", "]", '"', "'", "#", "&a ", "*a", "!t ", "<<: ", "\t")


_DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
"""The C dumper, if installed, is ten times as fast."""


def mutated(description: Data, dice: random.Random) -> str:
    """Text of a robot description with a few mutations."""
    description = copy.deepcopy(description)
    for _ in range(dice.randint(1, 3)):
        _mutate(description, dice)
    text: str = yaml.dump(description, Dumper=_DUMPER, sort_keys=False, allow_unicode=True)
    return _torn(text, dice) if dice.random() < 0.15 else text


def _mutate(description: Data, dice: random.Random) -> None:
    places = list(_places(description))
    if not places:
        return
    holder, key = dice.choice(places)
    other, place = dice.choice(places)
    choice = dice.random()
    if choice < 0.45:
        holder[key] = copy.deepcopy(dice.choice(VALUES))
    elif choice < 0.6:
        holder[key] = copy.deepcopy(other[place])
    elif choice < 0.7:
        del holder[key]
    elif choice < 0.8 and isinstance(holder, dict):
        names = (f"{key}s", str(key)[:-1], "flange", "base", "elbow", "home", "x", "default", "")
        holder[dice.choice(names)] = holder.pop(key)
    elif isinstance(holder[key], float | int):
        holder[key] *= dice.choice((-1, 0, 0.1, 0.999, 1.001, 10, 1e3, 1e6))
    elif isinstance(holder[key], list):
        dice.shuffle(holder[key])
        holder[key] += copy.deepcopy(holder[key][: dice.randint(0, 2)])
    else:
        holder[key], other[place] = copy.deepcopy(other[place]), copy.deepcopy(holder[key])


def _places(data: Data) -> Iterator[tuple[Data, Data]]:
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in items:
        yield data, key
        if isinstance(value, dict | list):
            yield from _places(value)


def _torn(text: str, dice: random.Random) -> str:
    start = dice.randrange(len(text) + 1)
    end = min(len(text), start + dice.randrange(20))
    return text[:start] + dice.choice(PIECES) + text[dice.choice((start, end)) :]
