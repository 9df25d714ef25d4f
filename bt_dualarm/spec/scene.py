"""Scene files: tables, walls, shelves and other fixtures, and mounts of fixed cameras.

A tree file names one as ``world: {scene: scenes/cell.yaml}``. Its fixtures become fixed objects of
the tree, which skills and conditions can name; its cameras are mounts that arms can name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, TypeAlias

from pydantic import Field, ValidationError

from bt_dualarm.spec.document import FixtureSpec
from bt_dualarm.spec.explain import explain, in_base_units
from bt_dualarm.spec.node_types import in_words, port
from bt_dualarm.spec.problems import Name, Problem, SpecError
from bt_dualarm.spec.values import PoseSpec, Value
from bt_dualarm.spec.yaml_reader import Source, read_file, read_text, text_of, with_tuples

MOST_FIXTURES: Final = 100
MOST_CAMERAS: Final = 16
"""Largest numbers of fixtures and of cameras of a scene."""

SCENE_FORMAT: Final = 1
"""Version of the format, the value of the key `VERSION`."""

VERSION: Final = "bt_dualarm_scene"


class SceneContent(Value):
    """A scene file."""

    description: Annotated[str, Field(max_length=500)] = port("", "One-line description")
    fixtures: Annotated[dict[Name, FixtureSpec], Field(max_length=MOST_FIXTURES)] = port(
        {}, "Fixed objects by name"
    )
    cameras: Annotated[dict[Name, PoseSpec], Field(max_length=MOST_CAMERAS)] = port(
        {}, "Poses in the world of camera mounts by name, with z forward and y down"
    )


@dataclass(frozen=True)
class SceneFile:
    """A scene file that was read.

    Attributes:
        source: Its source.
        content: Its content; None if it has errors.
    """

    source: Source
    content: SceneContent | None


def is_scene_path(name: object) -> bool:
    """Whether a scene is given by the path of a file."""
    return isinstance(name, str) and name.endswith((".yaml", ".yml", ".xml"))


SceneReader: TypeAlias = Callable[[str, str], tuple[SceneFile | None, list[Problem]]]
"""Reads the text of a scene; its arguments are the text and the path for messages."""


def read_scene(
    tree: Source, name: str, root: Path, texts: Mapping[str, str], read_xml: SceneReader
) -> tuple[SceneFile | None, list[Problem]]:
    """Reads a scene file, and returns it with its problems; None if it cannot be read.

    Args:
        tree: Source of the tree file that names it.
        name: Path relative to the tree file.
        root: Folder outside which no file is read, wherever a symlink leads.
        texts: Texts of files by path, used instead of those on the disk.
        read_xml: Reader of scenes in MJCF.
    """

    def refused(message: str, found: tuple[Problem, ...] = ()) -> tuple[None, list[Problem]]:
        return None, [*found, tree.problem(("world", "scene"), message)]

    shown = Path(tree.file).parent / name
    try:
        resolved = shown.resolve()
        if resolved.is_symlink():
            raise RuntimeError("a loop of symlinks")
    except (OSError, RuntimeError, ValueError) as error:
        return refused(f"'{name}' cannot be resolved: {error}")
    if Path(name).is_absolute() or not resolved.is_relative_to(root.resolve()):
        return refused(f"'{name}' is outside the folder {root}")
    if name.endswith(".xml"):
        try:
            scene, found = read_xml(texts.get(str(shown)) or text_of(shown), str(shown))
        except SpecError as error:
            return refused(f"scene '{name}' cannot be used", error.problems)
        if scene is None:
            return refused(f"scene '{name}' cannot be used", tuple(found))
        for fixture in () if scene.content is None else scene.content.fixtures.values():
            fixture.look_in(shown.parent)
        return scene, found
    try:
        text = texts.get(str(shown))
        source = read_file(shown) if text is None else read_text(text, str(shown))
    except SpecError as error:
        return refused(f"scene '{name}' cannot be used", error.problems)
    data = source.data
    if not isinstance(data, dict) or data.get(VERSION) != SCENE_FORMAT:
        hint = f"begin it with '{VERSION}: {SCENE_FORMAT}'"
        what = in_words(data) if not isinstance(data, dict) else "its version is missing or unknown"
        problem = source.problem((), f"is not a scene: {what}", hint)
        return refused(f"scene '{name}' cannot be used", (problem,))
    filled = with_tuples({key: item for key, item in data.items() if key != VERSION})
    filled = in_base_units(filled, SceneContent.model_validate, SceneContent)
    try:
        content = SceneContent.model_validate(filled)
    except ValidationError as error:
        problems = [
            source.problem(found.path, found.message, found.hint, key=found.at_key)
            for found in explain(error, SceneContent, filled, "field", frozenset({VERSION}))
        ]
        return SceneFile(source, None), problems
    for fixture in content.fixtures.values():
        fixture.look_in(shown.parent)
    return SceneFile(source, content), []
