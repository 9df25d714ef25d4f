"""The programming interface: run, open (to step) or check a tree given in any form."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

from bt_dualarm.core.errors import RunError
from bt_dualarm.runtime.file_check import Checked, checked_faults
from bt_dualarm.runtime.file_check import check as check_tree
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.runtime.options import (
    RunOptions,
    checked_params,
    checked_path,
    checked_reality,
    find_tree,
    listed,
)
from bt_dualarm.runtime.outcome import RunResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.frame import RendererKind
from bt_dualarm.skill.registry import Registry
from bt_dualarm.skill.skill import Skill
from bt_dualarm.spec.document import RealitySpec, TreeFile
from bt_dualarm.spec.problems import Problem
from bt_dualarm.spec.yaml_reader import TreeInput, is_yaml

Tree: TypeAlias = str | os.PathLike[str] | Mapping[str, object]
"""A tree: the path of its file, YAML text, or Python data.

Text of several lines, or text that begins with ``{``, is YAML; other text is an argument of
``bt-run``: a path, or the name of a shipped tree. A `pathlib.Path` is always a path. A mapping
has the values that YAML can express; relative paths in text and data start from the current folder.
"""

GivenFaults: TypeAlias = str | os.PathLike[str] | Mapping[str, Mapping[str, object]]
"""Faults: the path of a file with a section ``faults``, or a mapping from names to faults."""

Skills: TypeAlias = Iterable[type[Skill] | str | os.PathLike[str]]
"""Skills in addition to the shipped ones: classes, or folders as for ``--skills``."""


def run(
    tree: Tree,
    *,
    params: Mapping[str, object] | None = None,
    seed: int | None = None,
    duration: float | None = None,
    renderer: RendererKind | None = None,
    reality: str | RealitySpec | Mapping[str, object] | None = None,
    record: str | os.PathLike[str] | None = None,
    frames: bool = False,
    real_time: bool = False,
    watchdog: float | None = None,
    skills: Skills = (),
    faults: GivenFaults | None = None,
) -> RunResult:
    """Run a tree to its end and return the result; a failed tree raises no error.

    Args:
        tree: The tree: a path, the name of a shipped tree, YAML text, or a mapping.
        params: Values of the parameters that the tree declares, by name.
        seed: Seed of all random numbers; by default the tree's.
        duration: Longest simulated duration of the run, s.
        renderer: Renderer of the cameras: ``gl``, ``ray`` or ``auto``; by default the tree's.
        reality: ``ideal``, ``lab``, ``rough``, or a mapping as in a tree; by default the tree's.
        record: Folder to write summary, events, samples and plots to; by default none.
        frames: Whether the record includes the cameras' images.
        real_time: Whether to run no faster than the wall clock.
        watchdog: Wall-clock budget of a tick or callback of a skill, s; by default no limit.
        skills: Additional skills: classes, or folders of files.
        faults: Faults to inject in addition to the tree's: a file with a section ``faults``, or a
            mapping from names to faults.

    Raises:
        SpecError, NoSuchTree: The tree has errors, listed in ``problems``; there is no such tree.
        RunError, RegistryError: An argument is invalid; a skill is invalid.
        DualArmError: The world cannot be composed, or the record cannot be written.
    """
    given = locals()  # all arguments, which `open` takes by the same names
    with open(**given) as opened:
        return opened.finish()


def open(  # noqa: A001 - used with the name of its module before it, as gzip.open is
    tree: Tree,
    *,
    params: Mapping[str, object] | None = None,
    seed: int | None = None,
    duration: float | None = None,
    stop: StopRequest | None = None,
    renderer: RendererKind | None = None,
    reality: str | RealitySpec | Mapping[str, object] | None = None,
    record: str | os.PathLike[str] | None = None,
    frames: bool = False,
    real_time: bool = False,
    watchdog: float | None = None,
    skills: Skills = (),
    faults: GivenFaults | None = None,
) -> Run:
    """Prepare a run that the caller advances in steps; nothing has moved yet.

    Args:
        tree: Tree in any form that `run` takes.
        params: Values of parameters.
        seed: Seed of all random numbers.
        duration: Simulated seconds at most.
        stop: Request to end early, made by a signal handler or another thread.
        renderer: Renderer of the cameras.
        reality: Deviations of the simulated arms from the nominal model.
        record: Folder of the record, which is written when the run is closed.
        frames: Whether it includes the cameras' images.
        real_time: Whether to run no faster than the wall clock.
        watchdog: Wall-clock budget of skill code, s; code that exceeds it is interrupted, and the
            run ends.
        skills: Additional skills.
        faults: Faults to inject in addition to the tree's.

    Raises:
        DualArmError: The same errors as `run`.
    """
    folder = None if record is None else checked_path(record, "record")
    realistic = None if reality is None else checked_reality(reality)
    options = RunOptions(seed, duration, renderer, realistic, folder, real_time, watchdog, frames)
    registry = registry_of(skills)
    checked = _checked(tree, params, registry)
    file = checked.runnable()
    if faults is not None:
        options = replace(options, faults=checked_faults(file, faults_input(faults)))
    return Run(file, registry, options, stop=stop, warnings=checked.problems)


def check(
    tree: Tree, *, params: Mapping[str, object] | None = None, skills: Skills = ()
) -> tuple[Problem, ...]:
    """Errors of a tree in the file's order, or its warnings if it has no errors.

    Args:
        tree: Tree in any form that `run` takes.
        params: Values of parameters.
        skills: Additional skills.

    Raises:
        NoSuchTree: There is no file and no shipped tree of this name.
        RegistryError: A skill is invalid.
        RunError: An argument is invalid.
    """
    kinds = registry_of(skills).kinds
    return check_tree(tree_input(tree), kinds, checked_params(params)).problems


def checked_file(
    tree: Tree, params: Mapping[str, object] | None, skills: Skills
) -> tuple[TreeFile, Registry]:
    """A file that can run, and its skills; raises the same errors as `run`."""
    registry = registry_of(skills)
    return _checked(tree, params, registry).runnable(), registry


def _checked(tree: Tree, params: Mapping[str, object] | None, registry: Registry) -> Checked:
    # build=False: the run composes the world itself and raises the same errors.
    return check_tree(tree_input(tree), registry.kinds, checked_params(params), build=False)


def registry_of(skills: Skills = ()) -> Registry:
    """Registry of the installed and the additional skills.

    Raises:
        RegistryError: A skill is invalid, or two have the same name.
        RunError: An element is neither a skill class nor a folder.
    """
    given = listed(skills)
    classes = [one for one in given if isinstance(one, type) and issubclass(one, Skill)]
    folders = [checked_path(one, "skills") for one in given if isinstance(one, (str, os.PathLike))]
    if len(classes) + len(folders) < len(given):
        raise RunError("skills are classes derived from Skill, or folders of files that have some")
    return Registry.load(folders, classes)


def faults_input(faults: GivenFaults) -> TreeInput:
    """Faults in the form of a file's section.

    Raises:
        RunError: They are neither a path nor a mapping.
    """
    if isinstance(faults, Mapping):
        return {"faults": dict(faults)}
    return checked_path(faults, "faults")


def tree_input(tree: Tree) -> TreeInput:
    """A tree, with the path of a shipped one for its name.

    Raises:
        NoSuchTree: There is no file and no shipped tree of this name.
        RunError: It is no tree in any form.
    """
    if isinstance(tree, Mapping):
        return tree
    if isinstance(tree, str):
        return tree if is_yaml(tree) else find_tree(tree)
    if isinstance(tree, os.PathLike):
        return Path(tree)
    allowed = "a path, the name of a shipped tree, YAML text or a mapping"
    raise RunError(f"a tree is {allowed}, not {type(tree).__name__}")
