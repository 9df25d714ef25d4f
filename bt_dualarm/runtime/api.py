"""The front door: run a tree, open one to be stepped, check one; whatever form it has."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TypeAlias

from bt_dualarm.errors import RunError
from bt_dualarm.preflight.check import check as check_tree
from bt_dualarm.runtime.options import RunOptions, checked_folder, checked_reality
from bt_dualarm.runtime.result import RunResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.runtime.shipped import find_tree
from bt_dualarm.runtime.signals import StopRequest
from bt_dualarm.skill.registry import Registry
from bt_dualarm.skill.skill import Skill
from bt_dualarm.spec.problems import Problem
from bt_dualarm.spec.reality import RealitySpec
from bt_dualarm.spec.tree_input import TreeInput, is_yaml
from bt_dualarm.world.rendering.renderer import RendererKind

Tree: TypeAlias = str | os.PathLike[str] | Mapping[str, object]
"""A tree: the path of its file, YAML text, or Python data.

Text of several lines, or that begins with ``{``, is YAML; other text is what ``bt-run`` takes: a
path, or the name of a shipped tree. A `pathlib.Path` is always a path. Values of a mapping are
those that YAML could say; relative paths in text and data start from the current folder.
"""

Skills: TypeAlias = Iterable[type[Skill] | str | os.PathLike[str]]
"""Skills of one's own, besides the shipped ones: classes, or folders as of ``--skills``."""


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
) -> RunResult:
    """Run a tree to its end; what became of it is in the result, a failed tree raises nothing.

    Args:
        tree: The tree: a path, the name of a shipped tree, YAML text, or a mapping.
        params: Values of the parameters that the tree declares, by name.
        seed: Seed of everything random; by default the tree's.
        duration: Simulated seconds after which the run ends at the latest.
        renderer: Renderer of the cameras: ``gl``, ``ray`` or ``auto``; by default the tree's.
        reality: ``ideal``, ``lab``, ``rough``, or a mapping as in a tree; by default the tree's.
        record: Folder to write summary, events, samples and plots to; by default none.
        frames: Whether the record keeps the cameras' pictures, too.
        real_time: Whether to run no faster than the clock on the wall.
        watchdog: Seconds on the wall that a tick or callback of a skill gets; by default no limit.
        skills: Skills of one's own: classes, or folders of files.

    Raises:
        SpecError, NoSuchTree: The tree has errors, all in ``problems``; there is no such tree.
        RunError, RegistryError: An argument makes no sense; a skill is badly made.
        DualArmError: No world can be composed, no picture drawn, or no record written.
    """
    given = locals()  # all arguments, which `open` takes by the same names
    with open(**given) as opened:
        return opened.finish()


def open(  # noqa: A001 - read with the name of its module before it, as gzip.open is
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
) -> Run:
    """Make a tree ready to be run in steps of one's own; nothing has moved yet.

    Args:
        tree: Tree in any form that `run` takes.
        params: Values of parameters.
        seed: Seed of everything random.
        duration: Simulated seconds at most.
        stop: Request to end early that somebody else may make, such as a handler of signals.
        renderer: Renderer of the cameras.
        reality: How far the arms are from what is believed of them.
        record: Folder of the record, which is written when the run is closed.
        frames: Whether it keeps the cameras' pictures.
        real_time: Whether steps take their time on the wall.
        watchdog: Seconds on the wall that code of skills gets before it is interrupted where it
            stands, and the run ends.
        skills: Skills of one's own.

    Raises:
        DualArmError: Whatever `run` raises.
    """
    folder = None if record is None else checked_folder(record)
    realistic = None if reality is None else checked_reality(reality)
    options = RunOptions(seed, duration, renderer, realistic, folder, real_time, watchdog, frames)
    registry = registry_of(skills)
    # The run composes the world itself, and says the same of what cannot be composed.
    checked = check_tree(_input(tree), registry.kinds, params, build=False)
    return Run(checked.runnable(), registry, options, stop=stop, warnings=checked.problems)


def check(
    tree: Tree, *, params: Mapping[str, object] | None = None, skills: Skills = ()
) -> tuple[Problem, ...]:
    """Everything that is wrong with a tree: its errors in order; where there is none, warnings.

    Args:
        tree: Tree in any form that `run` takes.
        params: Values of parameters.
        skills: Skills of one's own.

    Raises:
        NoSuchTree: There is no file and no shipped tree of this name.
        RegistryError: A skill is badly made.
        RunError: An argument makes no sense.
    """
    return check_tree(_input(tree), registry_of(skills).kinds, params).problems


def registry_of(skills: Skills = ()) -> Registry:
    """The installed skills and those of one's own.

    Raises:
        RegistryError: A skill is badly made, or two have one name.
        RunError: Something is neither a skill's class nor a folder.
    """
    given = [skills] if isinstance(skills, (str, os.PathLike, type)) else list(skills)
    classes = [one for one in given if isinstance(one, type) and issubclass(one, Skill)]
    folders = [Path(one) for one in given if isinstance(one, (str, os.PathLike))]
    if len(classes) + len(folders) < len(given):
        raise RunError("skills are classes derived from Skill, or folders of files that have some")
    return Registry.load(folders, classes)


def _input(tree: Tree) -> TreeInput:
    if isinstance(tree, Mapping):
        return tree
    if isinstance(tree, str):
        return tree if is_yaml(tree) else find_tree(tree)
    if isinstance(tree, os.PathLike):
        return Path(tree)
    wanted = "a path, the name of a shipped tree, YAML text or a mapping"
    raise RunError(f"a tree is {wanted}, not {type(tree).__name__}")
