"""Subtrees of a file and of those that it includes, from below the root alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Final

from bt_dualarm.spec.params import declared
from bt_dualarm.spec.ports import KEY
from bt_dualarm.spec.problems import Problem, SpecError, suggestion
from bt_dualarm.spec.reader import read_file, read_text
from bt_dualarm.spec.site import SubtreeSpec
from bt_dualarm.spec.source import Path, Source
from bt_dualarm.spec.wording import in_words

FORMAT: Final = 1
"""Version of the format, the value of ``bt_dualarm:`` in a file."""

MAX_FILES: Final = 50
"""Files that one file may include, those of its includes among them."""

_FIELDS: Final = frozenset({"bt_dualarm", "description", "include", "subtrees"})
_SUBTREE_FIELDS: Final = frozenset({"description", "params", "tree"})


@dataclass
class Libraries:
    """Reads the subtrees of files, each file once.

    Args:
        root: No file outside of this folder is read, wherever a symlink leads.
        texts: Texts of files, by their paths, that are taken in place of those on the disk.

    Attributes:
        problems: Found so far.
        included: Files that were included, in the order in which they were read.
    """

    root: FilePath
    texts: Mapping[str, str] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    included: list[Source] = field(default_factory=list)
    _known: dict[FilePath, dict[str, SubtreeSpec]] = field(default_factory=dict)

    def of(self, source: Source, stack: tuple[FilePath, ...] = ()) -> dict[str, SubtreeSpec]:
        """Subtrees that the trees of ``source`` may use, by name."""
        here = FilePath(source.file).resolve()
        library: dict[str, SubtreeSpec] = {}
        self._known[here] = library
        library.update(self._declared(source, library))
        for index, path in self._included(source):
            place: Path = ("include", index)
            for name, subtree in self._file(source, place, path, (*stack, here)).items():
                if library.setdefault(name, subtree) is not subtree:
                    other = library[name].source.file
                    message = f"subtree '{name}' is already declared in {other}"
                    self.problems.append(source.problem(place, message, "rename one of the two"))
        return library

    def _declared(
        self, source: Source, library: dict[str, SubtreeSpec]
    ) -> Iterator[tuple[str, SubtreeSpec]]:
        subtrees = source.data.get("subtrees")
        if subtrees is not None and not isinstance(subtrees, dict):
            message = f"subtrees: expected a mapping, not {in_words(subtrees)}"
            self.problems.append(source.problem(("subtrees",), message))
            return
        for name, body in (subtrees or {}).items():
            path: Path = ("subtrees", name)
            if not KEY.fullmatch(name):
                hint = "a subtree's name has letters, digits and _ and begins with a letter"
                message = f"'{name}' cannot be a name"
                self.problems.append(source.problem(path, message, hint, key=True))
            elif not isinstance(body, dict) or "tree" not in body:
                message = f"subtree '{name}' has no tree"
                hint = "name: {params: {…}, tree: node}"
                self.problems.append(source.problem(path, message, hint, key=True))
            else:
                self._refuse_others(source, path, frozenset(body), _SUBTREE_FIELDS)
                params = declared(source, (*path, "params"), self.problems)
                yield name, SubtreeSpec(name, source, (*path, "tree"), params, library)

    def _refuse_others(
        self, source: Source, path: Path, given: frozenset[str], allowed: frozenset[str]
    ) -> None:
        self.problems += [
            source.problem(
                (*path, name),
                f"unknown field '{name}'",
                suggestion(name, allowed, "field"),
                key=True,
            )
            for name in sorted(given - allowed)
        ]

    def _included(self, source: Source) -> Iterator[tuple[int, str]]:
        include = source.data.get("include")
        if include is not None and not isinstance(include, list):
            message = f"include: expected a list of files, not {in_words(include)}"
            self.problems.append(source.problem(("include",), message))
            return
        for index, path in enumerate(include or ()):
            if isinstance(path, str):
                yield index, path
            else:
                message = f"include: expected a file, not {in_words(path)}"
                self.problems.append(source.problem(("include", index), message))

    def _file(
        self, source: Source, place: Path, path: str, stack: tuple[FilePath, ...]
    ) -> dict[str, SubtreeSpec]:
        """The library of an included file; empty where it cannot be used."""
        shown = FilePath(source.file).parent / path
        try:
            resolved = shown.resolve()
            if resolved.is_symlink():  # from Python 3.13 on, resolve() lets a loop pass
                raise RuntimeError("a loop of symlinks")
        except (OSError, RuntimeError, ValueError) as error:  # a name too long, a loop
            return self._refuse(source, place, f"'{path}' leads nowhere: {error}")
        if FilePath(path).is_absolute() or not resolved.is_relative_to(self.root.resolve()):
            return self._refuse(source, place, f"'{path}' is outside of the folder {self.root}")
        if resolved in stack:
            names = " → ".join(file.name for file in (*stack[stack.index(resolved) :], resolved))
            return self._refuse(source, place, f"files include each other: {names}")
        if resolved in self._known:
            return self._known[resolved]
        if len(self._known) > MAX_FILES:
            return self._refuse(source, place, f"more than {MAX_FILES} files are included")
        return self._read(source, place, shown, stack)

    def _read(
        self, source: Source, place: Path, shown: FilePath, stack: tuple[FilePath, ...]
    ) -> dict[str, SubtreeSpec]:
        try:
            text = self.texts.get(str(shown))
            included = read_file(shown) if text is None else read_text(text, str(shown))
        except SpecError as error:
            self.problems += error.problems
            return self._refuse(source, place, f"'{shown}' cannot be used")
        if not isinstance(included.data, dict) or included.data.get("bt_dualarm") != FORMAT:
            return self._refuse(
                source, place, f"'{shown}' does not begin with 'bt_dualarm: {FORMAT}'"
            )
        self._refuse_others(included, (), frozenset(included.data), _FIELDS)
        self.included.append(included)
        return self.of(included, stack)

    def _refuse(self, source: Source, place: Path, message: str) -> dict[str, SubtreeSpec]:
        self.problems.append(source.problem(place, f"include: {message}"))
        return {}
