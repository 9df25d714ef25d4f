"""Loading a tree file: read, fill in parameters, parse, check; all problems at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Final

from pydantic import ValidationError

from bt_dualarm.spec.check import Declared, check_tree
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.explain import describe, explain
from bt_dualarm.spec.language import LANGUAGE, Kind
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.params import chosen, declared
from bt_dualarm.spec.parse import Parser
from bt_dualarm.spec.problems import Problem, SpecError, errors, in_order
from bt_dualarm.spec.reader import read_file
from bt_dualarm.spec.scope import Scope, fill_parameters
from bt_dualarm.spec.source import Data, Source, with_tuples

FORMAT: Final = 1
"""Version of the format, the value of ``bt_dualarm:`` in a file."""

_NOT_OF_THE_MODEL: Final = frozenset({"bt_dualarm", "params"})
_STAND_IN: Final = NodeSpec("succeed", "succeed", {})


def load_tree_file(
    path: FilePath | str,
    skills: Mapping[str, Kind] | None = None,
    params: Mapping[str, str] | None = None,
) -> TreeFile:
    """Load and check a tree file.

    Args:
        path: Of the file.
        skills: The installed skills by name; without them leaves are not checked.
        params: Values of the file's parameters as text, as given on the command line.

    Raises:
        SpecError: With every error in the file.
    """
    loading = _Loading(FilePath(path), skills, params or {})
    file = loading.run()
    if file is None or errors(loading.problems):
        raise SpecError(errors(loading.problems))
    return file


def check_file(
    path: FilePath | str,
    skills: Mapping[str, Kind] | None = None,
    params: Mapping[str, str] | None = None,
) -> tuple[Problem, ...]:
    """Every error and warning of a tree file, in its order; arguments as `load_tree_file`."""
    loading = _Loading(FilePath(path), skills, params or {})
    try:
        loading.run()
    except SpecError as error:
        return error.problems
    return in_order(loading.problems)


@dataclass
class _Loading:
    """One file on its way from text to `TreeFile`."""

    path: FilePath
    skills: Mapping[str, Kind] | None
    given: Mapping[str, str]
    problems: list[Problem] = field(default_factory=list)

    def run(self) -> TreeFile | None:
        """The file, or None; the reasons are among the problems.

        Raises:
            SpecError: The text itself cannot be read.
        """
        source = read_file(self.path)
        if not isinstance(source.data, dict):
            message = f"expected a mapping with 'bt_dualarm: {FORMAT}', not "
            self.problems.append(source.problem((), message + describe(source.data)))
            return None
        self._check_version(source)
        specs = declared(source, ("params",), self.problems)
        values, complaints = chosen(specs, self.given, source.file)
        self.problems += complaints
        trees = self._trees(source, Scope(values))
        self._check_nodes(source, trees)
        return self._model(source, values, trees)

    def _check_version(self, source: Source) -> None:
        version = source.data.get("bt_dualarm")
        if version is None:
            hint = f"begin the file with 'bt_dualarm: {FORMAT}'"
            self.problems.append(source.problem((), "the version of the format is missing", hint))
        elif version != FORMAT or isinstance(version, bool):
            message = f"version {describe(version)} of the format is not known"
            self.problems.append(source.problem(("bt_dualarm",), message, f"known here: {FORMAT}"))

    def _trees(self, source: Source, scope: Scope) -> dict[str, NodeSpec]:
        arms = source.data.get("arms")
        trees = {}
        for arm, body in arms.items() if isinstance(arms, dict) else ():
            if isinstance(body, dict) and "tree" in body:
                parser = Parser()
                root = parser.node(body["tree"], source, ("arms", arm, "tree"), scope)
                self.problems += parser.problems
                trees[arm] = root or _STAND_IN
        return trees

    def _model(
        self, source: Source, values: Mapping[str, Data], trees: Mapping[str, NodeSpec]
    ) -> TreeFile | None:
        data = {key: item for key, item in source.data.items() if key not in _NOT_OF_THE_MODEL}
        data = fill_parameters(data, values)
        data.setdefault("name", self.path.stem)
        filled = with_tuples(data)
        for arm, root in trees.items():
            filled["arms"][arm]["tree"] = root
        try:
            file = TreeFile.model_validate(filled)
        except ValidationError as error:
            for found in explain(error, TreeFile, filled, "field", _NOT_OF_THE_MODEL):
                self.problems.append(
                    source.problem(found.path, found.message, found.hint, key=found.at_key)
                )
            return None
        return file.model_copy(update={"path": self.path})

    def _check_nodes(self, source: Source, trees: Mapping[str, NodeSpec]) -> None:
        sorts = {"object": source.data.get("objects"), "arm": source.data.get("arms")}
        names = {
            sort: frozenset(items) if isinstance(items, dict) else frozenset()
            for sort, items in sorts.items()
        }
        kinds = {**LANGUAGE, **(self.skills or {})}
        for root in trees.values():
            complete = self.skills is not None
            self.problems += check_tree(root, kinds, Declared(names), complete=complete)
