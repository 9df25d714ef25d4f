"""Loads tree files: reads, fills in parameters, parses, checks; reports all problems at once."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Final

from pydantic import ValidationError

from bt_dualarm.behaviors.language import LANGUAGE
from bt_dualarm.behaviors.leaf import Succeed
from bt_dualarm.spec.cell import CellSpec
from bt_dualarm.spec.checks import Examination, declared_names, unused
from bt_dualarm.spec.document import (
    LONGEST_NAME,
    ArmSpec,
    ObjectSpec,
    TreeContent,
    TreeFile,
    WorldSpec,
)
from bt_dualarm.spec.explain import explain
from bt_dualarm.spec.node_types import NodeSpec, NodeType
from bt_dualarm.spec.parameters import Scope, chosen, declared, fill_parameters
from bt_dualarm.spec.parser import FORMAT, Libraries, ParseContext, Parser, SubtreeSpec
from bt_dualarm.spec.ports import in_words, unknown
from bt_dualarm.spec.problems import Location, Problem, SpecError, errors, in_order
from bt_dualarm.spec.values import Value
from bt_dualarm.spec.yaml_reader import Data, DataPath, Source, TreeInput, read_tree, with_tuples

_NOT_OF_THE_MODEL: Final = frozenset({"bt_dualarm", "params", "subtrees", "include"})
_STAND_IN: Final = NodeSpec(Succeed.node_type.name, Succeed.node_type.name, {})


@dataclass(frozen=True)
class Loaded:
    """A loaded tree file with its problems.

    Attributes:
        file: The file, None if it has errors, or subtrees only.
        problems: Every error in the file's order; if there is none, every warning, as some
            warnings only follow from errors.
        name: Name of the file in messages.
        sound: Part of a file with errors that is valid by itself, so that names in it that refer
            to other files can be checked, too.
        left_out: Paths of the fields that are not in ``sound`` because they have errors.
        source: Source of the file, None if it cannot be read.
    """

    file: TreeFile | None
    problems: tuple[Problem, ...]
    name: str
    sound: TreeFile | None = None
    left_out: frozenset[DataPath] = frozenset()
    source: Source | None = None

    @property
    def wrong(self) -> tuple[Problem, ...]:
        """Errors that keep the file from running, empty if it can run."""
        if self.file is not None:
            return ()
        nothing = Problem(Location(self.name), "has only subtrees: nothing to run")
        return errors(self.problems) or (nothing,)

    def runnable(self) -> TreeFile:
        """Returns the file.

        Raises:
            SpecError: It has errors, or nothing to run.
        """
        if self.file is not None:
            return self.file
        raise SpecError(self.wrong)


def load_tree_file(
    tree: TreeInput,
    skills: Mapping[str, NodeType] | None = None,
    params: Mapping[str, object] | None = None,
    folder: FilePath | None = None,
) -> TreeFile:
    """Returns a checked tree file; arguments as `load`.

    Raises:
        SpecError: The file has errors; carries every one.
    """
    return load(tree, skills, params, folder).runnable()


def check_file(
    tree: TreeInput,
    skills: Mapping[str, NodeType] | None = None,
    params: Mapping[str, object] | None = None,
    folder: FilePath | None = None,
) -> tuple[Problem, ...]:
    """Returns every error of a tree file, or every warning if it has none; arguments as `load`."""
    return load(tree, skills, params, folder).problems


def load(
    tree: TreeInput,
    skills: Mapping[str, NodeType] | None = None,
    params: Mapping[str, object] | None = None,
    folder: FilePath | None = None,
) -> Loaded:
    """Reads and checks a tree; never raises for a fault of the tree.

    Args:
        tree: Path of a file, YAML text, Python data, or a source that was already read.
        skills: Node types of the skills by name; None to check no leaves that are skills.
        params: Values of the tree's parameters by name: as text, as given on the command line, or
            as Python data.
        folder: Folder from which relative paths in text or data start, by default the current one.
    """
    try:
        source = read_tree(tree, folder)
    except SpecError as error:
        return Loaded(None, error.problems, error.problems[0].place.file)
    loading = _Loading(source, skills, params or {})
    file = loading.run()
    wrong = in_order(errors(loading.problems))
    if not wrong:
        return Loaded(file, in_order(loading.problems), source.file, source=source)
    left_out = frozenset(loading.left_out)
    return Loaded(None, wrong, source.file, file or loading.sound, left_out, source)


@dataclass
class _Loading:
    """State of loading one file."""

    source: Source
    skills: Mapping[str, NodeType] | None
    given: Mapping[str, object]
    problems: list[Problem] = field(default_factory=list)
    sound: TreeFile | None = None
    left_out: set[DataPath] = field(default_factory=set)

    def __post_init__(self) -> None:
        self._parser = Parser(LANGUAGE, self.problems)
        self._texts: dict[str, str] = {}

    def run(self) -> TreeFile | None:
        """Returns the file, or None with the reasons in the problems."""
        source = self.source
        if not isinstance(source.data, dict):
            message = f"expected a mapping with 'bt_dualarm: {FORMAT}', not "
            self.problems.append(source.problem((), message + in_words(source.data)))
            return None
        self._check_version(source)
        specs = declared(source, ("params",), self.problems)
        values, complaints = chosen(specs, self.given, source.file)
        self.problems += complaints
        libraries = Libraries(FilePath(source.file).parent, source.texts)
        library = libraries.of(source)
        self.problems += libraries.problems
        self._texts = {each.file: each.text for each in (source, *libraries.included)}
        trees = self._trees(ParseContext(source, ("arms",), Scope(values), library))
        examination = Examination(LANGUAGE, self.skills, declared_names(source))
        self._examine_subtrees(source, library, examination)
        for root in trees.values():
            examination.tree(root)
        file = self._model(source, values, trees)
        readable = file or self.sound
        if readable is not None:
            examination.cell(readable.cell, source, trees)
        self.problems += examination.problems
        if not errors(self.problems):
            own = [subtree for subtree in library.values() if subtree.source is source]
            self.problems += unused(source, specs, own, self._parser.used)
            if file is not None:
                self.problems += examination.warnings(file, source)
        return file

    def _check_version(self, source: Source) -> None:
        version = source.data.get("bt_dualarm")
        if version is None:
            hint = f"begin the file with 'bt_dualarm: {FORMAT}'"
            self.problems.append(source.problem((), "the version of the format is missing", hint))
        elif version != FORMAT or isinstance(version, bool):
            message = f"version {in_words(version)} of the format is not supported"
            self.problems.append(source.problem(("bt_dualarm",), message, f"available: {FORMAT}"))

    def _trees(self, arms: ParseContext) -> dict[str, NodeSpec]:
        """Returns the tree of each arm that has one; a stand-in if it cannot be parsed."""
        trees = {}
        for arm, body in arms.data.items() if isinstance(arms.data, dict) else ():
            if isinstance(body, dict) and "tree" in body:
                trees[arm] = self._parser.tree(arms.into(arm, "tree")) or _STAND_IN
        return trees

    def _examine_subtrees(
        self, source: Source, library: Mapping[str, SubtreeSpec], examination: Examination
    ) -> None:
        """Check the subtrees of this file that no tree uses yet."""
        for subtree in library.values():
            if subtree.source is not source or subtree in self._parser.used:
                continue
            values = {
                name: unknown(name) if spec.default is None else spec.default
                for name, spec in subtree.params.items()
            }
            context = ParseContext(source, subtree.path, Scope(values), subtree.library, (subtree,))
            root = self._parser.tree(context)
            if root is not None:
                examination.nodes(root)

    def _model(
        self, source: Source, values: Mapping[str, Data], trees: Mapping[str, NodeSpec]
    ) -> TreeFile | None:
        if "arms" not in source.data and "subtrees" in source.data:
            return None  # a file to include
        data = {key: item for key, item in source.data.items() if key not in _NOT_OF_THE_MODEL}
        data = fill_parameters(data, values)
        path = FilePath(source.file)
        data.setdefault("name", path.stem.strip("<>")[:LONGEST_NAME])
        filled = with_tuples(data)
        for arm, root in trees.items():
            filled["arms"][arm]["tree"] = root
        try:
            content = TreeContent.model_validate(filled)
        except ValidationError as error:
            for found in explain(error, TreeContent, filled, "field", _NOT_OF_THE_MODEL):
                self.problems.append(
                    source.problem(found.path, found.message, found.hint, key=found.at_key)
                )
            self.sound = self._what_is_sound(filled, path)
            return None
        return TreeFile.model_construct(
            **dict(content), path=path, texts=self._texts, given=dict(values)
        )

    def _what_is_sound(self, filled: Mapping[str, Data], path: FilePath) -> TreeFile:
        """Returns world, objects and arms of a file with errors, without the invalid fields."""
        parts: dict[str, dict[str, Value]] = {}
        for part, model in (("objects", ObjectSpec), ("arms", ArmSpec)):
            items = filled.get(part)
            sound = {
                name: self._sound_one(model, data, (part, name))
                for name, data in (items.items() if isinstance(items, dict) else ())
            }
            parts[part] = {name: one for name, one in sound.items() if one is not None}
        world = self._sound_one(WorldSpec, filled.get("world", {}), ("world",)) or WorldSpec()
        cell = self._sound_one(CellSpec, filled.get("cell", {}), ("cell",)) or CellSpec()
        return TreeFile.model_construct(
            name="", world=world, cell=cell, objects=parts["objects"], arms=parts["arms"], path=path
        )

    def _sound_one(self, model: type[Value], data: Data, path: DataPath) -> Value | None:
        """Returns a part of the file with its valid fields; None if a required one is missing."""
        fields = copy.deepcopy(data) if isinstance(data, dict) else {}
        while True:
            try:
                return model.model_validate(fields)
            except ValidationError as error:
                wrong = {_innermost(fields, details["loc"]) for details in error.errors()}
            self.left_out |= {(*path, *found) for found in wrong}
            if () in wrong:  # what is missing cannot be left out
                return None
            for *parents, name in wrong:
                holder = fields
                for part in parents:
                    holder = holder.get(part, {})
                holder.pop(name, None)


def _innermost(data: Data, location: Sequence[int | str]) -> DataPath:
    """Returns the path of the innermost field in nested mappings that an error is about."""
    path: list[int | str] = []
    for part in location:
        if not isinstance(data, dict) or part not in data:
            break
        data = data[part]
        path.append(part)
    return tuple(path)
