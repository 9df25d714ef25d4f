"""Loads tree files, builds their trees, and reloads changed parts of them during a run.

`load_tree_file` reads a file, fills in parameters, parses and checks it, and reports all problems
at once. `build_tree` makes a tree that ticks from the checked nodes.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path as FilePath
from typing import Any, Final, TypeAlias, cast

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from pydantic import ValidationError

from bt_dualarm.behaviors.composites import Guard, Until, While
from bt_dualarm.behaviors.decorators import Timeout
from bt_dualarm.behaviors.faults import FaultInjector
from bt_dualarm.behaviors.language import LANGUAGE, LEAF_CLASSES, PARENT_CLASSES
from bt_dualarm.behaviors.leaf import FirstTick, LanguageLeaf, Leaf, Succeed, Test
from bt_dualarm.behaviors.node import (
    NAMES,
    Blackboard,
    BoundPorts,
    NodeParts,
    OutputWriter,
    ReportingNode,
    StatusReporter,
    detach_parent,
    reset,
)
from bt_dualarm.behaviors.report import (
    KeyWritten,
    LeafReports,
    NodeView,
    OnTraceEvent,
    PortsRead,
    StatusChange,
    StatusName,
)
from bt_dualarm.robots.mjcf_scene import read_mjcf
from bt_dualarm.skill.cell import ActiveNode, CellAccess
from bt_dualarm.skill.relative_poses import resolve_poses
from bt_dualarm.skill.skill import Skill, SkillContext
from bt_dualarm.spec.cell import CellSpec
from bt_dualarm.spec.checks import (
    Examination,
    declared_names,
    in_radians,
    unused,
    with_bare_numbers,
)
from bt_dualarm.spec.document import (
    LONGEST_NAME,
    ArmSpec,
    ObjectSpec,
    TreeContent,
    TreeFile,
    WorldSpec,
    expanded,
)
from bt_dualarm.spec.explain import explain, in_base_units
from bt_dualarm.spec.faults import fault_class, fault_problems, unique_names
from bt_dualarm.spec.goals import SECTIONS, ConditionSpec
from bt_dualarm.spec.node_types import (
    NodeSpec,
    NodeType,
    PortModel,
    all_of,
    in_words,
    reference_of,
    unknown,
    written_keys,
)
from bt_dualarm.spec.parser import (
    FORMAT,
    Libraries,
    ParseContext,
    Parser,
    Scope,
    SubtreeSpec,
    chosen,
    declared,
    fill_parameters,
    value_types,
)
from bt_dualarm.spec.path_file import texts_of
from bt_dualarm.spec.problems import Location, Problem, SpecError, errors, in_order
from bt_dualarm.spec.scene import VERSION, SceneFile, is_scene_path, read_scene
from bt_dualarm.spec.texture import NO_PICTURE, ImageError, Picture, read_image, refuse_pixels
from bt_dualarm.spec.values import PoseSpec, Value
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
) -> tuple[Problem, ...]:
    """Returns every error of a tree file, or every warning if it has none; arguments as `load`."""
    return load(tree, skills, params).problems


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


_OTHER_KINDS: Final = {
    VERSION: ("a scene", "world: {scene: FILE}"),
    "palm": ("a gripper", "arms: {arm1: {gripper: FILE}}"),
    "urdf": ("a robot", "arms: {arm1: {robot: FILE}}"),
}
"""What a file without trees describes, by a key of its own, and where a tree file names it."""


def _of_another_kind(source: Source) -> Problem | None:
    """The problem of a scene, robot or gripper that is given as a tree."""
    if not {"bt_dualarm", "arms", "subtrees"} & source.data.keys():
        for key, (kind, use) in _OTHER_KINDS.items():
            if key in source.data:
                message = f"this file describes {kind}, not a tree"
                return source.problem((key,), message, f"name it in a tree file: '{use}'")
    return None


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
        another = _of_another_kind(source)
        if another is not None:
            self.problems.append(another)
            return None
        self._check_version(source)
        specs = declared(source, ("params",), self.problems)
        values, complaints = chosen(specs, self.given, source.file)
        self.problems += complaints
        scope = Scope(values, types=value_types(specs))
        # Errors in their expressions are reported with the rest of the file.
        objects = fill_parameters(source, ("objects",), source.data.get("objects"), scope, [])
        scene = self._scene(source, scope)
        if scene is not None:
            fixtures = scene.source.get(("fixtures",))
            both = [one for one in (fixtures, objects) if isinstance(one, dict)]
            objects = {name: obj for one in both for name, obj in one.items()}
        libraries = Libraries(FilePath(source.file).parent, source.texts)
        library = libraries.of(source)
        self.problems += libraries.problems
        read = [] if scene is None else [scene.source]
        self._texts = {each.file: each.text for each in (source, *libraries.included, *read)}
        trees = {
            arm: with_bare_numbers(root, self._types)
            for arm, root in self._trees(ParseContext(source, ("arms",), scope, library)).items()
        }
        for root in trees.values():
            self._read_texts(root)
        examination = Examination(LANGUAGE, self.skills, declared_names(source, objects))
        self._examine_subtrees(source, library, examination)
        for root in trees.values():
            examination.tree(root)
        file = self._model(source, scope, trees, scene)
        readable = file or self.sound
        if readable is not None:
            examination.cell(readable.cell, source, trees)
            examination.conditions(readable, source)
            cameras = frozenset(name for name, arm in readable.arms.items() if arm.camera)
            self.problems += fault_problems(
                readable.faults, source, trees, readable.objects, cameras
            )
        self.problems += examination.problems
        if not errors(self.problems):
            subtrees = [subtree for subtree in library.values() if subtree.source is source]
            self.problems += unused(source, specs, subtrees, self._parser.used)
            for each in (source, *libraries.included, *read):
                self.problems += in_radians(each)
            if file is not None:
                self.problems += examination.warnings(file, source)
        return file

    def _read_texts(self, root: NodeSpec) -> None:
        """Read the files that ports name; they are part of the file, and of its record."""
        folder = FilePath(self.source.file).parent
        for found in texts_of(root, self.skills or {}, folder, self.source.texts):
            if isinstance(found, Problem):
                self.problems.append(found)
            else:
                self._texts[found[0]] = found[1]

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

    @property
    def _types(self) -> Mapping[str, NodeType]:
        """All node types; the skills of the file are imported on demand."""
        return all_of(self.skills or {}, LANGUAGE)

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
            scope = Scope(values, types=value_types(subtree.params))
            context = ParseContext(source, subtree.path, scope, subtree.library, (subtree,))
            root = self._parser.tree(context)
            if root is not None:
                examination.nodes(with_bare_numbers(root, self._types))

    def _model(
        self,
        source: Source,
        scope: Scope,
        trees: Mapping[str, NodeSpec],
        scene: SceneFile | None,
    ) -> TreeFile | None:
        if "arms" not in source.data and "subtrees" in source.data:
            return None  # a file to include
        data = {key: item for key, item in source.data.items() if key not in _NOT_OF_THE_MODEL}
        data = fill_parameters(source, (), data, scope, self.problems)
        path = FilePath(source.file)
        data.setdefault("name", path.stem.strip("<>")[:LONGEST_NAME])
        filled = with_tuples(data)
        for arm, root in trees.items():
            filled["arms"][arm]["tree"] = root
        filled = in_base_units(filled, TreeContent.model_validate, TreeContent)
        try:
            content = TreeContent.model_validate(filled)
        except ValidationError as error:
            for found in explain(error, TreeContent, filled, "field", _NOT_OF_THE_MODEL):
                self.problems.append(
                    source.problem(found.path, found.message, found.hint, key=found.at_key)
                )
            self.sound = self._what_is_sound(filled, path, scene)
            return None
        for obj in content.objects.values():
            obj.look_in(path.parent)
        fixtures = _fixtures(scene)
        for name in (
            fixtures.keys() & content.objects.keys() | fixtures.keys() & content.arms.keys()
        ):
            section = "objects" if name in content.objects else "arms"
            message = f"'{name}' is already the name of a fixture of the scene"
            self.problems.append(source.problem((section, name), message, key=True))
        in_scene, wrong = _in_scene(scene, content.objects, content.arms)
        entries = {name: group.entry for group in in_scene["groups"] for name in group.names}
        for name in (in_scene["objects"].keys() - fixtures.keys()) & content.arms.keys():
            message = f"'{name}' is the name of an object and of an arm: rename one"
            wrong.append((entries.get(name, name), message))
        for entry, message in wrong:
            self.problems.append(source.problem(("objects", entry), message, key=True))
        fields = dict(content) | in_scene
        file = TreeFile.model_construct(
            **fields, path=path, texts=self._texts, given=dict(scope.values)
        )
        self._read_images(file)
        file.anchor()
        return file

    def _read_images(self, file: TreeFile) -> None:
        """Read the images of textures; they are part of the file, and of its record."""
        known: dict[str, Picture] = {}
        seen: set[int] = set()
        for name, obj in file.objects.items():
            for path, texture in obj.textures:
                if texture.image is None or id(texture) in seen:
                    continue  # members of a group share their texture
                seen.add(id(texture))
                try:
                    shown, text, picture = read_image(texture, file.root, self.source.texts)
                    known[shown] = picture
                    refuse_pixels(known.values())
                except ImageError as error:
                    message = f"image {texture.image} {error}"
                    where = (*path, "image")
                    self.problems.append(file.object_problem(self.source, name, where, message))
                    texture.show(NO_PICTURE)  # the check goes on with the color alone
                    continue
                self._texts[shown] = text
                texture.show(picture)

    def _scene(self, source: Source, scope: Scope) -> SceneFile | None:
        """Returns the scene file that the tree file names, if it does and it can be read."""
        world = fill_parameters(source, ("world",), source.data.get("world"), scope, [])
        name = world.get("scene") if isinstance(world, dict) else None
        if not isinstance(name, str) or not is_scene_path(name):
            return None
        scene, problems = read_scene(
            source, name, FilePath(source.file).parent, source.texts, read_mjcf
        )
        self.problems += problems
        if scene is None or scene.content is None:
            self.left_out.add(("world", "scene"))
        return scene

    def _what_is_sound(
        self, filled: Mapping[str, Data], path: FilePath, scene: SceneFile | None
    ) -> TreeFile:
        """Returns world, objects and arms of a file with errors, without the invalid fields."""
        parts: dict[str, dict[str, Value]] = {}
        models: dict[str, Callable[[Data], type[Value]]] = {
            "objects": lambda _: ObjectSpec,
            "arms": lambda _: ArmSpec,
            **dict.fromkeys(SECTIONS, lambda _: ConditionSpec),
            "faults": fault_class,
        }
        for part, model in models.items():
            items = filled.get(part)
            sound = {
                name: self._sound_one(model(data), data, (part, name))
                for name, data in (items.items() if isinstance(items, dict) else ())
            }
            parts[part] = {name: one for name, one in sound.items() if one is not None}
        world = self._sound_one(WorldSpec, filled.get("world", {}), ("world",)) or WorldSpec()
        cell = self._sound_one(CellSpec, filled.get("cell", {}), ("cell",)) or CellSpec()
        for obj in parts["objects"].values():
            if isinstance(obj, ObjectSpec):
                obj.look_in(path.parent)
        objects = {
            name: one for name, one in parts["objects"].items() if isinstance(one, ObjectSpec)
        }
        arms = {name: one for name, one in parts["arms"].items() if isinstance(one, ArmSpec)}
        in_scene, _ = _in_scene(scene, objects, arms)
        fields: dict[str, Any] = {"world": world, "cell": cell, "path": path, **parts, **in_scene}
        return TreeFile.model_construct(name="", **fields)

    def _sound_one(self, model: type[Value], data: Data, path: DataPath) -> Value | None:
        """Returns a part of the file with its valid fields; None if a required one is missing."""
        fields = with_tuples(data) if isinstance(data, dict) else {}
        while True:
            try:
                return model.model_validate(fields)
            except ValidationError as error:
                wrong = {_innermost(fields, details["loc"]) for details in error.errors()}
            self.left_out |= {(*path, *found) for found in wrong}
            if () in wrong:  # a missing child cannot be omitted
                return None
            for *parents, name in wrong:
                holder = fields
                for part in parents:
                    holder = holder.get(part, {})
                holder.pop(name, None)


def _fixtures(scene: SceneFile | None) -> dict[str, ObjectSpec]:
    """Returns the fixtures of a scene as objects by name."""
    return {} if scene is None or scene.content is None else {**scene.content.fixtures}


def _in_scene(
    scene: SceneFile | None, objects: Mapping[str, ObjectSpec], arms: Mapping[str, ArmSpec]
) -> tuple[dict[str, Any], list[tuple[str, str]]]:  # as TreeFile.model_construct takes them
    """Returns the fields of a tree file that its scene adds to, and as `expanded` the errors."""
    fixtures = _fixtures(scene)
    found, groups, wrong = expanded({**fixtures, **objects})
    fields: dict[str, Any] = {"objects": found, "groups": groups, "arms": arms}
    fields["fixtures"] = frozenset(fixtures)
    if scene is not None and scene.content is not None:
        fields["arms"] = _on_mounts(arms, scene.content.cameras)
        fields["scene_source"] = scene.source
    return fields, wrong


def _on_mounts(arms: Mapping[str, ArmSpec], mounts: Mapping[str, PoseSpec]) -> dict[str, ArmSpec]:
    """Returns the arms with cameras at the poses of the scene's mounts that they name."""
    found = {}
    for name, arm in arms.items():
        camera = arm.camera
        if camera is not None and isinstance(camera.mount, str) and camera.mount in mounts:
            placed = camera.model_copy(update={"mount": mounts[camera.mount]})
            found[name] = arm.model_copy(update={"camera": placed})
        else:
            found[name] = arm
    return found


def _innermost(data: Data, location: Sequence[int | str]) -> DataPath:
    """Returns the path of the innermost field in nested mappings that an error is about."""
    path: list[int | str] = []
    for part in location:
        if not isinstance(data, dict) or part not in data:
            break
        data = data[part]
        path.append(part)
    return tuple(path)


TreeNode: TypeAlias = Leaf | ReportingNode
"""Node of a built tree."""


def build_tree(
    arm: str,
    root: NodeSpec,
    skills: Mapping[str, type[Skill]],
    make_context: Callable[[str], SkillContext],
    clock: Callable[[], float],
    on_event: Callable[[StatusChange], None],
    on_trace: OnTraceEvent | None = None,
    cell: CellAccess | None = None,
    faults: FaultInjector | None = None,
) -> ArmTree:
    """Builds one arm's tree with its own blackboard.

    Args:
        arm: Name of the arm.
        root: Root, checked by `load_tree_file` with these skills.
        skills: Skills by name.
        make_context: Function from the path of a leaf to the context of its skill.
        clock: Simulated time in seconds.
        on_event: Receiver of every status change.
        on_trace: Receiver of ports and keys, None if they are not recorded.
        cell: What the trees of the file share; nothing by default.
        faults: Faults of the file in this arm's leaves; none by default.
    """
    cell = cell or CellAccess.alone()
    reporter = StatusReporter(arm, clock, on_event)
    builder = _Builder(skills, make_context, reporter, on_trace, cell, faults)
    reloading = TreeReload(builder, root)
    return ArmTree(builder.node(root, root.name), builder.reports, reloading.reload, cell)


class ArmTree:
    """Tree of one arm, which runs once.

    Args:
        root: Root with attached nodes.
        leaves: Reports that the leaves fill.
        reload: Function from the root and a changed definition to the root of the changed tree.
        cell: What the trees of the file share.

    Attributes:
        leaves: Report of each run of a leaf, in the order of their starts.
    """

    def __init__(
        self,
        root: TreeNode,
        leaves: LeafReports,
        reload: Callable[[TreeNode, NodeSpec], TreeNode],
        cell: CellAccess,
    ) -> None:
        self._cell = cell
        self._root = root
        self._reload = reload
        self.leaves = leaves

    @property
    def status(self) -> StatusName:
        """Status of the root."""
        return NAMES[self._root.status]

    def tick(self) -> None:
        """Tick once; no effect on a tree that has ended."""
        if self._root.status not in (Status.SUCCESS, Status.FAILURE):
            self._root.tick_once()

    def halt(self) -> None:
        """Halt the running nodes; no effect on a tree that has ended."""
        if self._root.status is Status.RUNNING:
            self._root.stop(Status.INVALID)

    def change(self, spec: NodeSpec) -> None:
        """Reload a changed definition between two ticks; no effect on a tree that has ended.

        Args:
            spec: Checked definition.
        """
        if self._root.status not in (Status.SUCCESS, Status.FAILURE):
            self._root = self._reload(self._root, spec)

    def view(self) -> NodeView:
        """Returns the current state of all nodes."""
        return _view(self._root, self._cell)

    def active(self) -> Iterator[ActiveNode]:
        """Yields the running nodes without running children."""
        waiting: list[tuple[TreeNode, bool]] = [(self._root, False)]
        while waiting:
            node, may_be_halted = waiting.pop()
            if node.status is not Status.RUNNING:
                continue
            running = [child for child in node.children if child.status is Status.RUNNING]
            if not running:
                yield ActiveNode(node.path, may_be_halted)
                continue
            may_be_halted = may_be_halted or _may_halt(node)
            waiting += [(cast("TreeNode", child), may_be_halted) for child in running]


def _may_halt(node: TreeNode) -> bool:
    """Returns whether a node halts running children on its own; parallels do not count.

    The other children of a parallel are active nodes of the same arm, which count by themselves.
    """
    return (
        isinstance(node, (Timeout, Guard, Until, While)) or getattr(node, "memory", True) is False
    )


def _view(node: TreeNode, cell: CellAccess) -> NodeView:
    is_running = node.status is Status.RUNNING
    return NodeView(
        node.name,
        node.kind,
        NAMES[node.status],
        node.since,
        tuple(_view(cast("TreeNode", child), cell) for child in node.children),
        node.progress if isinstance(node, Leaf) else None,
        f"{node.code}: {node.reason}" if node.status is Status.FAILURE and node.code else "",
        node.halted,
        cell.shared.waiting(cell.arm, node.path) if is_running else "",
    )


class TreeReload:
    """Reloads changed definitions of one arm's tree between two of its ticks.

    Nodes with the same path and kind are the same node. A leaf with the same ports continues;
    another one is halted, and starts again when its parent ticks it. A node with children continues
    with its new children; with other ports it starts counting, or waiting, again.

    Args:
        builder: Builder of new nodes.
        spec: Definition of the current tree.
    """

    def __init__(self, builder: _Builder, spec: NodeSpec) -> None:
        self._builder = builder
        self._spec = spec

    def reload(self, root: TreeNode, now: NodeSpec) -> TreeNode:
        """Returns the root of the changed tree.

        Args:
            root: Root of the current tree.
            now: Checked definition of the changed tree.
        """
        was = self._spec
        self._spec = now
        if was.name != now.name:
            return self._replace(root, now, now.name)
        return self._node(root, was, now, now.name)

    def _node(self, old: TreeNode, was: NodeSpec, now: NodeSpec, path: str) -> TreeNode:
        if was.kind != now.kind or bool(was.children) != bool(now.children):
            return self._replace(old, now, path)
        if not isinstance(old, ReportingNode):
            return old if was.ports == now.ports else self._replace(old, now, path)
        children, became = self._children(old, was, now, path)
        continues = old.swap_children(children, now.slots, became)
        if was.ports != now.ports:
            continues = old.swap_ports(self._builder.bound(now)) and continues
        if not continues:
            reset((old,))
        return old

    def _children(
        self, old: ReportingNode, was: NodeSpec, now: NodeSpec, path: str
    ) -> tuple[list[Behaviour], dict[Behaviour, Behaviour]]:
        """Returns the new children, and the new child in the position of each old one."""
        names = zip(unique_names(was.children), old.children, was.children, strict=True)
        there = {name: (cast("TreeNode", child), spec) for name, child, spec in names}
        children: list[Behaviour] = []
        became: dict[Behaviour, Behaviour] = {}
        for spec, name in zip(now.children, unique_names(now.children), strict=True):
            below = f"{path}/{name}"
            if name in there:
                child, before = there.pop(name)
                became[child] = self._node(child, before, spec, below)
                children.append(became[child])
            else:
                children.append(self._builder.node(spec, below))
            children[-1].parent = None
        for gone, _ in there.values():
            reset((gone,))
        return children, became

    def _replace(self, old: TreeNode, now: NodeSpec, path: str) -> TreeNode:
        reset((old,))
        return self._builder.node(now, path)


class _Builder:
    """Builds nodes that share one blackboard; arguments as `build_tree`."""

    def __init__(
        self,
        skills: Mapping[str, type[Skill]],
        make_context: Callable[[str], SkillContext],
        reporter: StatusReporter,
        on_trace: OnTraceEvent | None,
        cell: CellAccess,
        faults: FaultInjector | None,
    ) -> None:
        self._cell = cell
        self._faults = faults
        self._skills = skills
        self._make_context = make_context
        self._reporter = reporter
        self._on_trace = on_trace
        self._blackboard = Blackboard()
        self.reports = LeafReports()

    def node(self, spec: NodeSpec, path: str) -> TreeNode:
        """Returns a node with its descendants, attached at a path."""
        children = tuple(
            self.node(child, f"{path}/{name}")
            for child, name in zip(spec.children, unique_names(spec.children), strict=True)
        )
        node: TreeNode
        if children:
            write = partial(self._write, path)
            parts = NodeParts(spec.name, children, spec.slots, self.bound(spec), self._cell, write)
            node = PARENT_CLASSES[spec.kind].of(parts)
            for child in children:
                detach_parent(child)
        else:
            node = self._leaf(spec, path)
        node.attach(self._reporter, path, spec.kind)
        return node

    def bound(self, spec: NodeSpec) -> BoundPorts:
        """Returns the ports of a node with children."""
        return BoundPorts(PARENT_CLASSES[spec.kind].node_type.ports, spec.ports, self._blackboard)

    def _leaf(self, spec: NodeSpec, path: str) -> Leaf:
        skill = LEAF_CLASSES[spec.kind] if spec.kind in LEAF_CLASSES else self._skills[spec.kind]
        outputs = skill.Outputs.model_fields.keys() - skill.Ports.model_fields.keys()
        named = {name: reference_of(spec.ports.get(name)) for name in outputs}
        keys = {name: key for name, key in named.items() if key is not None}
        ports = {name: value for name, value in spec.ports.items() if name not in keys}
        for port, written in written_keys(skill.Ports).items():
            keys[written.port] = spec.ports[port]
        bound = BoundPorts(skill.Ports, ports, self._blackboard)
        writer = OutputWriter(skill.Outputs, keys, self._blackboard, partial(self._trace_key, path))
        context = self._make_context(path)
        for module in skill.needs:
            importlib.import_module(module)

        inject = None if self._faults is None else self._faults.of_leaf(path)

        first = FirstTick()

        def begin() -> Skill:
            resolved = resolve_poses(bound.now(), context.arm)
            self._trace_ports(path, resolved.ports)
            made = skill(resolved.ports, context, writer.write)
            made.metrics |= resolved.metrics
            made.relative_to = resolved.names
            if isinstance(made, LanguageLeaf) and first.time is not None:
                made.first_tick = first.time
            if isinstance(made, Test):
                made.worded = partial(bound.worded, "expression")
            return made if inject is None else inject(made)

        return Leaf(spec.name, begin, context.arm, self.reports, first)

    def _write(self, path: str, key: str, value: Data) -> None:
        """Write a key on behalf of the node at a path."""
        self._blackboard.write(key, value)
        self._trace_key(path, key, value)

    def _trace_ports(self, path: str, ports: PortModel) -> None:
        if self._on_trace is not None:
            time = self._reporter.clock()
            arm = self._reporter.arm
            self._on_trace(PortsRead(time, arm, path, ports.model_dump(mode="json")))

    def _trace_key(self, path: str, key: str, value: Data) -> None:
        if self._on_trace is not None:
            time = self._reporter.clock()
            arm = self._reporter.arm
            self._on_trace(KeyWritten(time, arm, path, key, value))
