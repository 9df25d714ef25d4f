"""Everything that can be known of a file before its run, in one go."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from bt_dualarm.errors import CatalogueError, OverlapError, WorldError
from bt_dualarm.preflight.loads import overloads
from bt_dualarm.preflight.markers import unborne_markers
from bt_dualarm.preflight.reaching import out_of_reach
from bt_dualarm.preflight.robots import Names
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.language import LANGUAGE
from bt_dualarm.spec.load import load
from bt_dualarm.spec.problems import Place, Problem, SpecError, errors, in_order
from bt_dualarm.spec.source import Source
from bt_dualarm.spec.tree_input import TreeInput
from bt_dualarm.world.world import World


@dataclass(frozen=True)
class Checked:
    """A file and what was found in it.

    Attributes:
        file: None where it has errors, or subtrees only.
        problems: Every error in the file's order; where there is none, every warning.
    """

    file: TreeFile | None
    problems: tuple[Problem, ...]

    def runnable(self) -> TreeFile:
        """The file.

        Raises:
            SpecError: It has errors, or nothing to run.
        """
        if self.file is None:
            raise SpecError(errors(self.problems))
        return self.file


def check(
    tree: TreeInput,
    skills: Mapping[str, Kind],
    params: Mapping[str, object] | None = None,
    *,
    folder: Path | None = None,
    build: bool = True,
) -> Checked:
    """Check a tree, and the robots, postures, mounts, scene and poses that it names.

    Args:
        tree: Path of a file, YAML text, Python data, or one already read.
        skills: The installed skills by name.
        params: Values of the tree's parameters by name: as text, as given on the command line, or
            as Python data.
        folder: Folder from which relative paths in text or data start, by default the current one.
        build: Whether to compile the world, too, as a run would.
    """
    loaded = load(tree, skills, params, folder)
    kinds = {**LANGUAGE, **skills}
    file, source = loaded.file or loaded.sound, loaded.source
    if file is None or source is None:
        return Checked(None, loaded.wrong)
    names = Names(file, source, kinds, loaded.left_out)
    names.look_up()
    wrong = [*errors(loaded.problems), *names.problems]
    if build and not names.problems and not loaded.left_out:
        wrong += _problems_of_the_world(file, source, loaded.name)
    if wrong or loaded.file is None:
        return Checked(None, in_order(wrong))
    robots = names.robots
    warnings = (
        *out_of_reach(file, robots, kinds),
        *overloads(file, robots, kinds),
        *unborne_markers(file, kinds),
    )
    return Checked(file, in_order((*loaded.problems, *warnings)))


def _problems_of_the_world(file: TreeFile, source: Source, name: str) -> list[Problem]:
    """Why a world cannot be composed, or what stands inside of what there."""
    try:
        world = World(file, file.world.seed)
    except (CatalogueError, WorldError) as error:
        return [Problem(Place(name), str(error))]
    return [_overlap(file, source, error) for error in world.overlaps()]


def _overlap(file: TreeFile, source: Source, error: OverlapError) -> Problem:
    """Said where the thing is put, or where it is declared if the file does not say where."""
    part, place = ("arms", "base") if error.thing in file.arms else ("objects", "pose")
    if source.get((part, error.thing, place)) is None:
        return source.problem((part, error.thing), str(error), key=True)
    return source.problem((part, error.thing, place), str(error))
