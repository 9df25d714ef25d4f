"""Warnings of what a file declares and nothing in it uses: parameters, subtrees."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Set
from dataclasses import replace

from bt_dualarm.spec.params import ParamSpec
from bt_dualarm.spec.ports import REFERENCE
from bt_dualarm.spec.problems import Problem
from bt_dualarm.spec.site import SubtreeSpec
from bt_dualarm.spec.source import Data, Path, Source


def unused(
    source: Source,
    params: Mapping[str, ParamSpec],
    subtrees: Iterable[SubtreeSpec],
    used: Set[SubtreeSpec],
) -> Iterator[Problem]:
    """Warn of parameters that no value refers to, and of subtrees that no tree uses.

    Args:
        source: A file without errors.
        params: Parameters that it declares.
        subtrees: Subtrees that it declares; one without arms declares them for others.
        used: Subtrees that are used by the arms' trees, and by each other. One that a parameter
            can choose by its name, ``use: "{grasp}"``, counts as used, too.
    """
    choices = {choice for param in params.values() for choice in param.choices or ()}
    outside = {part: item for part, item in source.data.items() if part not in _OF_SUBTREES}
    yield from _params(source, ("params",), params, outside)
    for subtree in subtrees:
        *path, tree = subtree.path
        yield from _params(source, (*path, "params"), subtree.params, source.get((*path, tree)))
        if "arms" in source.data and subtree not in used and subtree.name not in choices:
            message = f"nothing uses the subtree '{subtree.name}'"
            yield _warning(source, tuple(path), message)


_OF_SUBTREES = frozenset({"params", "subtrees", "include"})


def _params(
    source: Source, path: Path, params: Mapping[str, ParamSpec], data: Data
) -> Iterator[Problem]:
    texts = set(_texts(data))
    named = {match[1] for text in texts for match in REFERENCE.finditer(text)}
    for name, param in params.items():
        # What a parameter that is a key stands for is written without braces, too: {key: out}.
        if name not in named and not (param.type == "key" and name in texts):
            yield _warning(source, (*path, name), f"nothing uses the parameter '{name}'")


def _texts(data: Data) -> Iterator[str]:
    if isinstance(data, str):
        yield data
    elif isinstance(data, (dict, list)):
        for item in data.values() if isinstance(data, dict) else data:
            yield from _texts(item)


def _warning(source: Source, path: Path, message: str) -> Problem:
    return replace(source.problem(path, message, key=True), severity="warning")
