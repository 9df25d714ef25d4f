"""Finding skills: the shipped folder, folders of the user, installed packages."""

from __future__ import annotations

import importlib.metadata
import inspect
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Final

from pydantic import ValidationError

from bt_dualarm.errors import DualArmError
from bt_dualarm.share import share_dir
from bt_dualarm.skill.file_import import import_error, imported
from bt_dualarm.skill.skill import STANDARD_FAILURES, Skill
from bt_dualarm.spec.annotations import metadata_of
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.language import LANGUAGE
from bt_dualarm.spec.ports import PortModel
from bt_dualarm.spec.values import Refers

ENTRY_POINTS: Final = "bt_dualarm.skills"
"""Group in which an installed package names its skills: a class or a module each."""

_CODE: Final = re.compile(r"[A-Z][A-Z0-9_]*")
_SKILL_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,47}")
_NO_PORT: Final = "no port"
_RESERVED: Final = frozenset({"name", "child", "children"})


class RegistryError(DualArmError):
    """Skills cannot be used as they are; names each file with what is wrong in it."""

    def __init__(self, complaints: Iterable[str]) -> None:
        self.complaints = tuple(complaints)
        super().__init__("\n".join(self.complaints))


@dataclass(frozen=True)
class Registry:
    """The installed skills.

    Attributes:
        skills: Classes of skills, by their name in YAML.
        kinds: Descriptions for the check, by the same names.
    """

    skills: Mapping[str, type[Skill]]
    kinds: Mapping[str, Kind]

    @classmethod
    def load(cls, extra_dirs: Iterable[Path] = (), classes: Iterable[type[Skill]] = ()) -> Registry:
        """Import and check every skill there is.

        Args:
            extra_dirs: Folders of the user, searched besides the shipped one.
            classes: Skills of the user that are imported already.

        Raises:
            RegistryError: A file cannot be imported, a skill is badly made, two have one name.
        """
        found = list(_installed())
        for folder in (share_dir("skills"), *extra_dirs):
            found += _in_folder(folder)
        found += ((f"class {skill.__module__}.{skill.__qualname__}", skill) for skill in classes)
        return cls.of(found)

    @classmethod
    def of(cls, found: Iterable[tuple[str, type[Skill] | Exception]]) -> Registry:
        """A registry of skills, each with the place it comes from.

        Raises:
            RegistryError: As `load`.
        """
        skills: dict[str, type[Skill]] = {}
        kinds: dict[str, Kind] = {}
        complaints: list[str] = []
        for origin, skill in found:
            if isinstance(skill, Exception):
                complaints.append(f"{origin}: {skill}")
                continue
            name = yaml_name(skill)
            complaints += [f"{origin}: {skill.__name__}: {fault}" for fault in faults(skill)]
            if name in LANGUAGE:
                complaints.append(f"{origin}: '{name}' is a word of the language; rename the class")
            elif name in kinds and skills[name] is not skill:
                complaints.append(f"{origin}: skill '{name}' is already in {kinds[name].origin}")
            skills.setdefault(name, skill)
            kinds.setdefault(name, kind_of(skill, origin))
        if complaints:
            raise RegistryError(complaints)
        return cls(MappingProxyType(skills), MappingProxyType(kinds))


def yaml_name(skill: type[Skill]) -> str:
    """``ReachToPose`` is ``reach_to_pose`` in YAML."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", skill.__name__).lower()


def kind_of(skill: type[Skill], origin: str) -> Kind:
    """What the check and the documentation need to know of a skill."""
    return Kind(
        yaml_name(skill),
        (inspect.getdoc(skill) or "").partition("\n")[0],
        skill.Ports,
        skill.Outputs,
        brings_in=frozenset(skill.brings_in),
        needs_camera=skill.needs_camera,
        needs_gripper=skill.needs_gripper,
        failures=skill.failures,
        example=skill.example,
        origin=origin,
    )


def faults(skill: type[Skill]) -> Iterator[str]:
    """Everything that an author forgot or got wrong, one sentence each."""
    if not _SKILL_NAME.fullmatch(yaml_name(skill)):
        yield f"its name in YAML would be '{yaml_name(skill)}'; rename the class"
    if sys.flags.optimize < 2 and not (vars(skill).get("__doc__") or "").strip():  # -OO strips it
        yield "has no docstring; its first line is what users are shown"
    if not inspect.isgeneratorfunction(skill.run):
        yield "run() has no yield: every yield ends a tick"
    if skill.run is Skill.run:
        yield "does not implement run()"
    for part in ("Ports", "Outputs"):
        model = getattr(skill, part)
        if not (isinstance(model, type) and issubclass(model, PortModel)):
            yield f"{part} is not a PortModel"
        else:
            yield from (*_port_faults(part, model), *_choice_faults(part, model))
            yield from _brought_faults(skill) if part == "Ports" else ()
    yield from _name_faults(skill)


def _port_faults(part: str, model: type[PortModel]) -> Iterator[str]:
    fields = model.model_fields
    refused = _refused_defaults(model)
    for name, field in fields.items():
        if not field.description:
            yield f"{part}.{name} has no description; declare it with port(default, description)"
        if name in refused:
            yield f"{part}.{name} refuses its own default: {refused[name]}"


def _refused_defaults(model: type[PortModel]) -> dict[str, str]:
    """What each port says of its own default, where it does not take it."""
    complaints: dict[str, str] = {}
    try:
        model.model_validate({_NO_PORT: None})  # so that no rule over several ports is asked
    except ValidationError as error:
        for one in error.errors(include_url=False):
            name = str(one["loc"][0]) if one["loc"] else _NO_PORT
            if one["type"] != "missing" and name != _NO_PORT:
                complaints.setdefault(name, one["msg"])
    return complaints


def _choice_faults(part: str, model: type[PortModel]) -> Iterator[str]:
    for name in model.exactly_one_of:
        field = model.model_fields.get(name)
        if field is None:
            yield f"{part}.exactly_one_of names '{name}', which is no port"
        elif field.is_required() or field.default is not None:
            yield f"{part}.{name} is one of several to choose from: its default must be None"
    for name in {*model.goes_with, *model.goes_with.values()} - model.model_fields.keys():
        yield f"{part}.goes_with names '{name}', which is no port"


def _brought_faults(skill: type[Skill]) -> Iterator[str]:
    for name in skill.brings_in:
        field = skill.Ports.model_fields.get(name)
        if field is None or metadata_of(field, Refers) is None:
            yield f"brings_in names '{name}', which is no port of an object's or an arm's name"


def _name_faults(skill: type[Skill]) -> Iterator[str]:
    fields = [set(getattr(m, "model_fields", {})) for m in (skill.Ports, skill.Outputs)]
    for name in sorted(_RESERVED & (fields[0] | fields[1])):
        yield f"'{name}' cannot be the name of a port: it has a meaning in every node"
    for name in sorted(fields[0] & fields[1]):
        yield f"'{name}' is a port and an output; call them differently"
    for code, meaning in skill.failures.items():
        if not _CODE.fullmatch(code):
            yield f"failure code '{code}' is not of capital letters, digits and _"
        if not meaning:
            yield f"failure code '{code}' has no meaning"
        if code in STANDARD_FAILURES and meaning == STANDARD_FAILURES[code]:
            yield f"failure code '{code}' is standard and need not be declared"


def _installed() -> Iterator[tuple[str, type[Skill] | Exception]]:
    for entry in importlib.metadata.entry_points(group=ENTRY_POINTS):
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


def _in_folder(folder: Path) -> Iterator[tuple[str, type[Skill] | Exception]]:
    if not folder.is_dir():
        yield str(folder), FileNotFoundError("there is no such folder of skills")
        return
    for file in sorted(folder.glob("*.py")):
        if file.name.startswith("_"):
            continue
        try:
            skills = list(_skills_in(imported(file)))
        except BaseException as error:  # noqa: BLE001 - a file may raise anything
            yield str(file), import_error(error, str(file))
            continue
        if not skills:
            yield str(file), TypeError("has no subclass of Skill")
        yield from ((str(file), skill) for skill in skills)


def _skills_in(module: ModuleType) -> Iterator[type[Skill]]:
    for item in vars(module).values():
        if (
            isinstance(item, type)
            and issubclass(item, Skill)
            and item.__module__ == module.__name__
            and not item.__name__.startswith("_")
        ):
            yield item
