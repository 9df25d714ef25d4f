"""Registry of skills: from the shipped folder, folders of the user and installed packages."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.util
import inspect
import os
import re
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Final, TypeVar

from pydantic import ValidationError
from pydantic.errors import PydanticUserError

from bt_dualarm.core.errors import DualArmError, Interruption, Overrun
from bt_dualarm.core.share import kind_at, share_dir
from bt_dualarm.skill.condition import Condition
from bt_dualarm.skill.skill import STANDARD_FAILURES, Skill
from bt_dualarm.spec.node_types import (
    CONDITION_FIELDS,
    RESERVED_NAMES,
    Counterpart,
    NodeType,
    PortModel,
    metadata_of,
)
from bt_dualarm.spec.values import Refers

_FLAGS: Final = (
    "needs_camera",
    "needs_gripper",
    "needs_held",
    "takes_hold",
    "lets_go",
    "begins_anywhere",
)
"""Attributes of a skill that are True or False."""

_OUTSIDE: Final = (KeyboardInterrupt, Interruption, Overrun)
"""Exceptions that end an import from outside, even if the file itself has raised them."""


def imported(file: Path) -> ModuleType:
    """Import a file under a module name that is derived from its path."""
    digest = hashlib.sha256(str(file.resolve()).encode()).hexdigest()[:12]
    name = f"bt_dualarm_skills_{digest}_{file.stem}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise ImportError("is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def import_error(error: BaseException, origin: str) -> ImportError:
    """Error that states why ``origin`` cannot be imported.

    Raises:
        BaseException: The error itself, with a note, if it ends the import from outside.
    """
    line = " ".join(str(error).split())
    sentence = f"cannot be imported: {type(error).__name__}" + (f": {line}" if line else "")
    if isinstance(error, _OUTSIDE):
        error.add_note(f"{origin}: {sentence}")
        raise error
    return ImportError(sentence)


ENTRY_POINTS: Final = "bt_dualarm.skills"
"""Entry-point group of skills in installed packages; each names a class or a module."""

_CODE: Final = re.compile(r"[A-Z][A-Z0-9_]*")
_SKILL_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,47}")
_NO_PORT: Final = "no port"
_RESERVED: Final = frozenset({"name", "child", "children", *CONDITION_FIELDS})


class RegistryError(DualArmError):
    """Skills are faulty; the message names each file and its faults."""

    def __init__(self, complaints: Iterable[str]) -> None:
        self.complaints = tuple(complaints)
        super().__init__("\n".join(self.complaints))


Item = TypeVar("Item")


class _OnDemand(Mapping[str, Item]):
    """Mapping whose values may be made when they are read first.

    Args:
        later: Names of the values that are made on demand.
        make: Makes the value of a name.
        given: Further values, by name.
    """

    def __init__(
        self, later: Iterable[str], make: Callable[[str], Item], given: Mapping[str, Item]
    ) -> None:
        self._names = dict.fromkeys((*later, *given))
        self._make = make
        self._made = dict(given)

    def __getitem__(self, name: str) -> Item:
        if name not in self._made:
            if name not in self._names:
                raise KeyError(name)
            self._made[name] = self._make(name)
        return self._made[name]

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


@dataclass(frozen=True)
class Registry:
    """All available skills.

    A shipped skill is imported when it is read first: its file has its name.

    Attributes:
        skills: Classes of skills, by their name in YAML.
        kinds: Their node types for the check of trees, by the same names.
    """

    skills: Mapping[str, type[Skill]]
    kinds: Mapping[str, NodeType]

    @classmethod
    def load(cls, extra_dirs: Iterable[Path] = (), classes: Iterable[type[Skill]] = ()) -> Registry:
        """Import and check all skills but the shipped ones, whose names are known.

        Args:
            extra_dirs: Folders of the user, searched in addition to the shipped one.
            classes: Skills that are already imported.

        Raises:
            RegistryError: A file cannot be imported, a skill is faulty, or two have the same name.
        """
        found = list(_installed())
        for folder in extra_dirs:
            found += _in_folder(folder)
        found += ((f"class {skill.__module__}.{skill.__qualname__}", skill) for skill in classes)
        return cls.of(found, {file.stem: file for file in _files_in(share_dir("skills"))})

    @classmethod
    def of(
        cls,
        found: Iterable[tuple[str, type[Skill] | Exception]],
        shipped: Mapping[str, Path] = MappingProxyType({}),
    ) -> Registry:
        """Registry of skills, each given with its origin or import error.

        Args:
            found: The skills.
            shipped: Files of further skills, by the skill's name.

        Raises:
            RegistryError: As `load`.
        """
        skills: dict[str, type[Skill]] = {}
        kinds: dict[str, NodeType] = {}
        complaints: list[str] = []
        for origin, skill in found:
            if isinstance(skill, Exception):
                complaints.append(f"{origin}: {skill}")
                continue
            name = yaml_name(skill)
            wrong = [f"{origin}: {skill.__name__}: {fault}" for fault in faults(skill)]
            complaints += wrong
            if name in RESERVED_NAMES:
                complaints.append(
                    f"{origin}: '{name}' is a node type of the language; rename the class"
                )
            elif name in kinds and skills[name] is not skill:
                complaints.append(f"{origin}: skill '{name}' is already in {kinds[name].origin}")
            elif name in shipped and _shipped(shipped[name]) is not skill:
                complaints.append(f"{origin}: skill '{name}' is already in {shipped[name]}")
            if not wrong:
                skills.setdefault(name, skill)
                kinds.setdefault(name, replace(kind_of(skill, origin), takes_hold=True))
        if complaints:
            raise RegistryError(complaints)
        return cls(
            _OnDemand(shipped, lambda name: _shipped(shipped[name]), skills),
            _OnDemand(
                shipped, lambda name: kind_of(_shipped(shipped[name]), str(shipped[name])), kinds
            ),
        )


def is_shipped_only(folders: Sequence[Path]) -> bool:
    """Returns whether `Registry.load` imports nothing: no skills are installed or in folders."""
    return not folders and not _entry_points()


def yaml_name(skill: type[Skill]) -> str:
    """Name of a skill in YAML: ``reach_to_pose`` for ``ReachToPose``."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", skill.__name__).lower()


def kind_of(skill: type[Skill], origin: str) -> NodeType:
    """Node type of a skill, for the check of trees and the documentation."""
    return NodeType(
        yaml_name(skill),
        (inspect.getdoc(skill) or "").partition("\n")[0],
        skill.Ports,
        skill.Outputs,
        brings_in=frozenset(skill.brings_in),
        takes_out=frozenset(skill.takes_out),
        needs_camera=skill.needs_camera,
        needs_gripper=skill.needs_gripper,
        needs_held=skill.needs_held,
        takes_hold=skill.takes_hold,
        lets_go=skill.lets_go,
        counterpart=skill.counterpart,
        failures=skill.failures,
        example=skill.example,
        origin=origin,
        shift=skill.shift,
    )


def faults(skill: type[Skill]) -> Iterator[str]:
    """Faults of a skill class, one message each."""
    if not _SKILL_NAME.fullmatch(yaml_name(skill)):
        yield f"its name in YAML would be '{yaml_name(skill)}'; rename the class"
    if sys.flags.optimize < 2 and not (vars(skill).get("__doc__") or "").strip():  # -OO strips it
        yield "has no docstring; its first line is shown to users"
    if not inspect.isgeneratorfunction(skill.run):
        yield "run() has no yield: every yield ends a tick"
    if skill.run is Skill.run:
        yield "does not implement run()"
    if skill.run is Condition.run and vars(skill).get("check") is None:
        yield "does not implement check()"
    for part in ("Ports", "Outputs"):
        model = getattr(skill, part)
        if not (isinstance(model, type) and issubclass(model, PortModel)):
            yield f"{part} is not a PortModel"
            continue
        try:
            model.model_rebuild()
        except PydanticUserError as error:
            why = error.message.partition(". ")[0]
            yield f"{part} has a port of a type that a file cannot hold: {why}"
            continue
        yield from (*_port_faults(part, model), *_choice_faults(part, model))
        yield from _brought_faults(skill) if part == "Ports" else ()
    yield from _attribute_faults(skill)
    yield from _name_faults(skill)


def _attribute_faults(skill: type[Skill]) -> Iterator[str]:
    """Faults of the attributes that describe a skill to the check of trees."""
    for name in _FLAGS:
        if not isinstance(getattr(skill, name), bool):
            yield f"{name} is {getattr(skill, name)!r}: it is True or False"
    if not isinstance(skill.example, str):
        yield f"example is {skill.example!r}: it is text in YAML"
    if isinstance(skill.needs, str):
        yield f"needs is the text {skill.needs!r}: it is a tuple of module names"
    else:
        for module in skill.needs:
            if find_spec(module.partition(".")[0]) is None:
                yield f"needs names the module '{module}', which is not installed"
    joint: object = skill.counterpart
    if isinstance(joint, Counterpart):
        for name in (joint.partner, *joint.same, *joint.by_one):
            if name not in getattr(skill.Ports, "model_fields", {}):
                yield f"counterpart names '{name}', which is not a port"
    elif joint is not None:
        yield f"counterpart is {joint!r}: it is a Counterpart"


def _port_faults(part: str, model: type[PortModel]) -> Iterator[str]:
    fields = model.model_fields
    refused = _refused_defaults(model)
    for name, field in fields.items():
        if not field.description:
            yield f"{part}.{name} has no description; declare it with port(default, description)"
        if name in refused:
            yield f"{part}.{name} refuses its own default: {refused[name]}"


def _refused_defaults(model: type[PortModel]) -> dict[str, str]:
    """Validation messages of ports that refuse their own default, by name."""
    complaints: dict[str, str] = {}
    try:
        model.model_validate(
            {_NO_PORT: None}
        )  # an unknown port keeps validators of the whole model from running
    except ValidationError as error:
        for one in error.errors(include_url=False):
            name = str(one["loc"][0]) if one["loc"] else _NO_PORT
            if one["type"] != "missing" and name != _NO_PORT:
                complaints.setdefault(name, one["msg"])
    return complaints


def _choice_faults(part: str, model: type[PortModel]) -> Iterator[str]:
    for name in (*model.exactly_one_of, *model.at_most_one_of):
        field = model.model_fields.get(name)
        if field is None:
            rule = "exactly_one_of" if name in model.exactly_one_of else "at_most_one_of"
            yield f"{part}.{rule} names '{name}', which is not a port"
        elif field.is_required() or field.default is not None:
            yield f"{part}.{name} is one of several alternatives: its default must be None"
    for name in {*model.goes_with, *model.goes_with.values()} - model.model_fields.keys():
        yield f"{part}.goes_with names '{name}', which is not a port"


def _brought_faults(skill: type[Skill]) -> Iterator[str]:
    for attribute in ("brings_in", "takes_out"):
        for name in getattr(skill, attribute):
            field = skill.Ports.model_fields.get(name)
            if field is None or metadata_of(field, Refers) is None:
                what = "a port with the name of an object or arm"
                yield f"{attribute} names '{name}', which is not {what}"


def _name_faults(skill: type[Skill]) -> Iterator[str]:
    fields = [set(getattr(m, "model_fields", {})) for m in (skill.Ports, skill.Outputs)]
    for name in sorted(_RESERVED & (fields[0] | fields[1])):
        yield f"'{name}' cannot be the name of a port: it is reserved in every node"
    for name in sorted(fields[0] & fields[1]):
        yield f"'{name}' is a port and an output; rename one of them"
    failures: object = skill.failures
    if not isinstance(failures, Mapping):
        yield f"failures is {failures!r}: it is a mapping from each code to its meaning"
        return
    for code, meaning in failures.items():
        if not isinstance(code, str) or not isinstance(meaning, str):
            yield f"failures has {code!r}: {meaning!r}: codes and their meanings are text"
            continue
        if not _CODE.fullmatch(code):
            yield f"failure code '{code}' must consist of capital letters, digits and _"
        if not meaning:
            yield f"failure code '{code}' has no description"
        if code in STANDARD_FAILURES and meaning == STANDARD_FAILURES[code]:
            yield f"failure code '{code}' is standard and need not be declared"


def _installed() -> Iterator[tuple[str, type[Skill] | Exception]]:
    for entry in _entry_points():
        origin = f"entry point '{entry.name}' ({entry.value})"
        try:
            loaded = entry.load()
        except BaseException as error:  # noqa: BLE001 - a file may raise anything
            yield origin, import_error(error, origin)
            continue
        if isinstance(loaded, ModuleType):
            yield from ((origin, skill) for skill in _skills_in(loaded))
        elif isinstance(loaded, type) and issubclass(loaded, Skill):
            yield origin, loaded
        else:
            yield origin, TypeError("is neither a skill nor a module of skills")


def _entry_points() -> tuple[importlib.metadata.EntryPoint, ...]:
    """Entry points of installed skills; of a package that is installed meanwhile, too."""
    return _entry_points_in(tuple((folder, _changed(folder)) for folder in sys.path))


@lru_cache(maxsize=1)
def _entry_points_in(
    _folders: tuple[tuple[str, int], ...],
) -> tuple[importlib.metadata.EntryPoint, ...]:
    """Reading the metadata of all packages takes 20 ms, a fifth of the start of a run.

    Args:
        _folders: Folders that packages are imported from, and when each was changed.
    """
    return tuple(importlib.metadata.entry_points(group=ENTRY_POINTS))


def _changed(folder: str) -> int:
    """Time of the last change of what is in a folder, ns; 0 if there is no such folder."""
    try:
        return os.stat(folder or ".").st_mtime_ns  # noqa: PTH116 - not always a path
    except (OSError, ValueError):
        return 0


def _in_folder(folder: Path) -> Iterator[tuple[str, type[Skill] | Exception]]:
    if kind_at(folder) != "folder":
        yield str(folder), FileNotFoundError("there is no such folder of skills")
        return
    for file in _files_in(folder):
        try:
            skills = list(_skills_in(imported(file)))
        except BaseException as error:  # noqa: BLE001 - a file may raise anything
            origin = _raised_at(file, error)
            yield origin, import_error(error, origin)
            continue
        if not skills:
            yield str(file), TypeError("has no subclass of Skill")
        yield from ((str(file), skill) for skill in skills)


def _raised_at(file: Path, error: BaseException) -> str:
    """Returns a file and its line that raised an error, if one did."""
    # A loader makes the path of a file absolute.
    path = str(Path.cwd() / file)
    lines = [at.lineno for at in traceback.extract_tb(error.__traceback__) if at.filename == path]
    return f"{file}:{lines[-1]}" if lines else str(file)


def _files_in(folder: Path) -> list[Path]:
    """Files of a folder that contain skills."""
    return [file for file in sorted(folder.glob("*.py")) if not file.name.startswith("_")]


def _shipped(file: Path) -> type[Skill]:
    """The skill of a shipped file, the one that has its name; the project's tests check it.

    Raises:
        RegistryError: The file cannot be imported, or has no such skill.
    """
    try:
        skills = {yaml_name(skill): skill for skill in _skills_in(imported(file))}
    except Exception as error:  # a damaged installation
        raise RegistryError([f"{file}: {import_error(error, str(file))}"]) from error
    if file.stem not in skills:
        raise RegistryError([f"{file}: has no skill '{file.stem}'"])
    return skills[file.stem]


def _skills_in(module: ModuleType) -> Iterator[type[Skill]]:
    for item in vars(module).values():
        if (
            isinstance(item, type)
            and issubclass(item, Skill)
            and item.__module__ == module.__name__
            and not item.__name__.startswith("_")
        ):
            yield item
