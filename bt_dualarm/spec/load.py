"""Loading a tree file: read, fill in parameters, parse, check; all problems at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Final

from pydantic import ValidationError

from bt_dualarm.spec.document import LONGEST_NAME, TreeFile
from bt_dualarm.spec.examine import Examination, declared_names
from bt_dualarm.spec.explain import describe, explain
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.library import FORMAT, Libraries
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.params import chosen, declared
from bt_dualarm.spec.parse import Parser
from bt_dualarm.spec.ports import unknown
from bt_dualarm.spec.problems import Place, Problem, SpecError, errors, in_order
from bt_dualarm.spec.reader import read_file
from bt_dualarm.spec.scope import Scope, fill_parameters
from bt_dualarm.spec.site import Site, SubtreeSpec
from bt_dualarm.spec.source import Data, Source, with_tuples

_NOT_OF_THE_MODEL: Final = frozenset({"bt_dualarm", "params", "subtrees", "include"})
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
    if file is None and not errors(loading.problems):
        loading.problems.append(Problem(Place(str(path)), "has subtrees only: nothing to run"))
    if file is None or errors(loading.problems):
        raise SpecError(errors(loading.problems))
    return file


def check_file(
    path: FilePath | str,
    skills: Mapping[str, Kind] | None = None,
    params: Mapping[str, str] | None = None,
) -> tuple[Problem, ...]:
    """Every error of a tree file in its order, else every warning; arguments as `load_tree_file`.

    Warnings wait for the errors to be mended: some of them only follow from those.
    """
    loading = _Loading(FilePath(path), skills, params or {})
    try:
        loading.run()
    except SpecError as error:
        return error.problems
    return in_order(errors(loading.problems) or loading.problems)


@dataclass
class _Loading:
    """One file on its way from text to `TreeFile`."""

    path: FilePath
    skills: Mapping[str, Kind] | None
    given: Mapping[str, str]
    problems: list[Problem] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._parser = Parser(self.problems)

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
        libraries = Libraries(self.path.parent)
        library = libraries.of(source)
        self.problems += libraries.problems
        trees = self._trees(Site(source, ("arms",), Scope(values), library))
        examination = Examination(self.skills, declared_names(source))
        self._examine_subtrees(source, library, examination)
        for root in trees.values():
            examination.tree(root)
        file = self._model(source, values, trees)
        if file is not None and not errors((*self.problems, *examination.problems)):
            examination.file(file, source)
        self.problems += examination.problems
        return file

    def _check_version(self, source: Source) -> None:
        version = source.data.get("bt_dualarm")
        if version is None:
            hint = f"begin the file with 'bt_dualarm: {FORMAT}'"
            self.problems.append(source.problem((), "the version of the format is missing", hint))
        elif version != FORMAT or isinstance(version, bool):
            message = f"version {describe(version)} of the format is not known"
            self.problems.append(source.problem(("bt_dualarm",), message, f"known here: {FORMAT}"))

    def _trees(self, arms: Site) -> dict[str, NodeSpec]:
        """The tree of each arm that has one; a stand-in where it cannot be parsed."""
        trees = {}
        for arm, body in arms.data.items() if isinstance(arms.data, dict) else ():
            if isinstance(body, dict) and "tree" in body:
                trees[arm] = self._parser.tree(arms.into(arm, "tree")) or _STAND_IN
        return trees

    def _examine_subtrees(
        self, source: Source, library: Mapping[str, SubtreeSpec], examination: Examination
    ) -> None:
        """Look at those of this file's subtrees, too, that no tree uses yet."""
        for subtree in library.values():
            if subtree.source is not source or subtree in self._parser.used:
                continue
            values = {
                name: unknown(name) if spec.default is None else spec.default
                for name, spec in subtree.params.items()
            }
            site = Site(source, subtree.path, Scope(values), subtree.library, (subtree,))
            root = self._parser.tree(site)
            if root is not None:
                examination.nodes(root)

    def _model(
        self, source: Source, values: Mapping[str, Data], trees: Mapping[str, NodeSpec]
    ) -> TreeFile | None:
        if "arms" not in source.data and "subtrees" in source.data:
            return None  # a file to include
        data = {key: item for key, item in source.data.items() if key not in _NOT_OF_THE_MODEL}
        data = fill_parameters(data, values)
        data.setdefault("name", self.path.stem[:LONGEST_NAME])
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
