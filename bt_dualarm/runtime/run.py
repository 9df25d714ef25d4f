"""A run of a tree, advanced in steps or in one call, and hot reload of its edited file.

`Run` has handles on its arms and trees. `FileWatch` replaces trees of a file that is edited during
its run, between two steps.
"""

from __future__ import annotations

import ctypes
import itertools
import logging
import math
import operator
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import replace
from fractions import Fraction
from numbers import Real
from pathlib import Path, PurePosixPath
from threading import Event, Lock, Thread
from typing import Final

import numpy as np

from bt_dualarm.behaviors.report import NodeView, StatusName
from bt_dualarm.core.errors import DualArmError, OverlapError, RunError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.runtime.arm_runtime import Arms, ArmView, IdleObserver, Observer
from bt_dualarm.runtime.assembly import Assembly, OpenRecord, prepare
from bt_dualarm.runtime.clock import exact
from bt_dualarm.runtime.file_check import check
from bt_dualarm.runtime.history import tree_facts
from bt_dualarm.runtime.interruption import StopRequest, Watchdog
from bt_dualarm.runtime.kernels import compile_kernels, needed
from bt_dualarm.runtime.options import RunOptions, checked_seconds
from bt_dualarm.runtime.outcome import GoalResult, Outcome, RunResult, html_table
from bt_dualarm.sim.composition import CAMERA, ArmBody
from bt_dualarm.sim.frame import Image, Viewpoint
from bt_dualarm.sim.painter import StillRenderer, best_viewpoint
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.node_types import NodeSpec
from bt_dualarm.spec.problems import Named, Problem, suggestion


class ArmHandle:
    """Read-only view of one arm of a run, always current.

    Args:
        name: Name of the arm in the file.
        world: World of the run, whether the arm is present or not.
        arms: The arms of the run.

    Attributes:
        name: Name of the arm in the file.
    """

    def __init__(self, name: str, world: World, arms: Arms) -> None:
        self.name = name
        self._world = world
        self._arms = arms

    @property
    def robot(self) -> str:
        """Name of the robot in the catalog, or title of its own description file."""
        return self._arms.view(self.name).robot

    @property
    def is_present(self) -> bool:
        """Whether the arm is in the world."""
        return self.name in self._world.arms

    @property
    def outcome(self) -> Outcome | None:
        """Outcome of the tree since the last spawn; None while it runs or has not begun."""
        return self._arms.view(self.name).outcome

    @property
    def tool_pose(self) -> Pose:
        """Pose of the tool frame in the world.

        Raises:
            WorldError: The arm is not in the world.
        """
        return self._body().tool_pose

    @property
    def q(self) -> Vector:
        """Joint positions in rad, base to tip, of shape (dof,).

        Raises:
            WorldError: The arm is not in the world.
        """
        return self._body().q

    @property
    def v(self) -> Vector:
        """Joint velocities in rad/s, base to tip, of shape (dof,).

        Raises:
            WorldError: The arm is not in the world.
        """
        return self._body().v

    @property
    def holds(self) -> tuple[str, ...]:
        """Names of the objects that the arm holds, in the order of attachment."""
        return self._world.attachments.attached_to(self.name)

    def _body(self) -> ArmBody:
        return self._world.arms[self.name]

    def rebind(self, world: World, arms: Arms) -> None:
        """Show the arm in another world, after the run was reset."""
        self._world = world
        self._arms = arms

    def __repr__(self) -> str:
        state = self.outcome or ("RUNNING" if self.is_present else "not in the world")
        return f"<arm {self.name} ({self.robot}): {state}>"


class TreeHandle:
    """Read-only view of one arm's behavior tree, always current.

    Args:
        arm: The arm's name in the file.
        spec: The tree in the file.
        arms: The arms of the run.

    Attributes:
        arm: The arm's name in the file.
    """

    def __init__(self, arm: str, spec: NodeSpec, arms: Arms) -> None:
        self.arm = arm
        self._spec = spec
        self._arms = arms

    @property
    def status(self) -> StatusName:
        """Status of the root; INVALID before the first tick and after a halt."""
        return self.snapshot().status

    def snapshot(self) -> NodeView:
        """Immutable copy of the current state of all nodes."""
        return self._arms.view(self.arm).tree or _never_ticked(self._spec)

    def rebind(self, arms: Arms) -> None:
        """Show the tree of the run after a reset."""
        self._arms = arms

    def __repr__(self) -> str:
        return f"<tree of {self.arm}: {self.status}>"


_RUNS: Final = itertools.count()
"""Runs that this process has begun."""


def _return_freed_memory() -> None:
    """Let the C library return what earlier runs have freed to the system.

    It keeps freed memory in its heap, whose pieces fit the next run less and less: a process that
    runs a tree of four arms over and over grew by 10 MB with each run.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:  # glibc has it, other C libraries do not
        trim(0)


_PICTURE: Final = (640, 480)
"""Width and height in pixels of an image without a camera."""

_LARGEST_PX: Final = 4096


def _checked_size(size: tuple[int, int]) -> tuple[int, int]:
    """Width and height in pixels.

    Raises:
        RunError: They are not two whole numbers from 1 to 4096.
    """
    try:
        width, height = (operator.index(side) for side in size)
    except (TypeError, ValueError):
        width = height = 0
    if not (1 <= width <= _LARGEST_PX and 1 <= height <= _LARGEST_PX):
        raise RunError(f"size: {size!r} is not two whole numbers from 1 to {_LARGEST_PX}")
    return width, height


def _checked_viewpoint(
    eye: Sequence[float] | None, look_at: Sequence[float] | None, fov: float
) -> Viewpoint:
    """A viewpoint.

    Raises:
        RunError: A point is missing or not three finite numbers, they are above each other, or the
            field of view is not from 1 to 170 degrees.
    """
    points = []
    for name, given in (("eye", eye), ("look_at", look_at)):
        try:
            point = np.asarray(given, dtype=float)
        except (TypeError, ValueError):
            point = np.empty(0)
        if point.shape != (3,) or not np.isfinite(point).all():
            raise RunError(f"{name}: {given!r} is not a point of three numbers")
        points.append(point)
    if np.linalg.norm((points[0] - points[1])[:2]) < 1e-6:
        raise RunError("eye is straight above or below look_at: move it a little to one side")
    if not isinstance(fov, Real) or not 1.0 <= float(fov) <= 170.0:
        raise RunError(f"fov: {fov!r} is not from 1 to 170 degrees")
    return Viewpoint(points[0], points[1], float(fov))


def _never_ticked(spec: NodeSpec) -> NodeView:
    """View of the tree of an arm that has not been spawned yet."""
    children = tuple(_never_ticked(child) for child in spec.children)
    return NodeView(spec.name, spec.kind, "INVALID", 0.0, children=children)


class Run:
    """One run of a tree, in steps or in one call; nothing has moved at first.

    Use it in a ``with`` block, whose end closes the run: a run that is not over is ended at once,
    and the record is written, if one was requested. The result stays available afterwards.

    Args:
        file: Tree file, checked with the skills of ``registry``.
        registry: Skills by name.
        options: Overrides of the file's settings.
        stop: Request to end early, made by a signal or another thread.
        warnings: Warnings of the check of the file.

    Attributes:
        warnings: Warnings of the check of the file.

    Raises:
        CatalogError: A robot or scene is unknown or broken.
        RendererError: The requested renderer does not work here.
        WorldError: The parts do not compile to one world, or two of them overlap.
        RecordError: The folder of the record cannot be used.
    """

    def __init__(
        self,
        file: TreeFile,
        registry: Registry,
        options: RunOptions | None = None,
        *,
        stop: StopRequest | None = None,
        warnings: Sequence[Problem] = (),
    ) -> None:
        self.warnings = tuple(warnings)
        self._given_stop = stop
        self._file = file
        self._registry = registry
        self._options = options or RunOptions()
        self._is_busy = False
        self._is_closed = False
        self._watching: list[Observer] = []
        # Before the run captures the log: compiling is not part of its record.
        compile_kernels(needed(file))
        self._begin()
        world = self.world
        arms = self.assembly.arms
        self._arms = {name: ArmHandle(name, world, arms) for name in file.arms}
        self._trees = {name: TreeHandle(name, arm.tree, arms) for name, arm in file.arms.items()}

    def _begin(self) -> None:
        """Prepare the first step."""
        if next(_RUNS):
            _return_freed_memory()
        self._stop = self._given_stop or StopRequest()
        self._parts = prepare(self._file, self._registry, self._options, self._stop)
        self._parts.feed.watch(*self._watching)
        self._requested_s = Fraction(0)
        self._is_recorded = self._parts.open_record is None
        self._viewpoint: Viewpoint | None = None
        self._result: RunResult | None = None

    @property
    def name(self) -> str:
        """Name of the tree file."""
        return self._parts.name

    @property
    def assembly(self) -> Assembly:
        """World, arms and services of the run; read it, do not advance it."""
        return self._parts.assembly

    @property
    def time(self) -> float:
        """Simulated time in seconds."""
        return self._parts.runner.time

    @property
    def done(self) -> bool:
        """Whether the run has ended: all trees ended and all arms at rest, or an error."""
        return self._result is not None

    @property
    def result(self) -> RunResult:
        """Result of the run.

        Raises:
            RunError: The run is not over.
        """
        if self._result is None:
            raise RunError(f"the run is not over: it is at {self.time:.3f} s of simulated time")
        return self._result

    @property
    def world(self) -> World:
        """Current world; changes made to it become part of the run."""
        return self.assembly.world

    @property
    def arms(self) -> Mapping[str, ArmHandle]:
        """Handles on the arms of the file, by name."""
        return Named("arm", self._arms)

    @property
    def trees(self) -> Mapping[str, TreeHandle]:
        """Handles on the arms' trees, by the arm's name."""
        return Named("arm", self._trees)

    @property
    def goals(self) -> Mapping[str, GoalResult]:
        """Whether each goal of the file is met in the true world now, by name."""
        return self._parts.referee.results()

    @property
    def violation(self) -> str:
        """Sentence on the invariant of the file that was violated, which ends the run; or empty."""
        return self._parts.referee.violation

    @property
    def seed(self) -> int:
        """Random seed."""
        return self.assembly.seed

    @property
    def renderer(self) -> str | None:
        """``gl``, ``ray``, or None if no arm has a camera."""
        return self._parts.renderer

    @property
    def renderer_message(self) -> str:
        """Which renderer is used and why, in one sentence; empty without cameras."""
        return self.assembly.message

    def step(self, seconds: float | Fraction) -> None:
        """Advance by a simulated duration, or to the end of the run if that comes first.

        Only whole physics steps are made, as many as fit into the total time requested so far.
        The result is therefore bitwise the same for any division into steps.

        Args:
            seconds: Simulated seconds, above 0.

        Raises:
            RunError: The run has ended or is closed, or ``seconds`` is not a number above 0.
        """
        number = checked_seconds(seconds, "step")
        if self._result is not None:
            raise RunError(f"the run ended at {self.time:.3f} s: it cannot be stepped any further")
        # Numbers of NumPy become those of Python, because fractions of its integers overflow.
        given = seconds if isinstance(seconds, Fraction) else number
        # `exact` rounds a tiny duration to 0; counting it as given lets repeated calls add up.
        requested = self._requested_s + (exact(given) or Fraction(given))
        self._advance(requested // exact(self.world.timestep))
        self._requested_s = requested

    def finish(self) -> RunResult:
        """Run to the end and return the result; a run that has ended is not changed."""
        if self._result is None:
            self._advance(math.inf)
        return self.result

    def stop(self) -> None:
        """Request the end: trees are halted, arms brought to rest; a second call ends it at once.

        Thread-safe; takes effect while the run is advanced.
        """
        self._stop.ask()

    def reset(self, seed: int | None = None) -> None:
        """Begin again, as a new run of the file would: nothing has moved, and no result is there.

        Handles on arms and trees stay valid, and observers that were added stay; the world, its
        model and data are new objects. Equal seeds give bitwise equal runs, whatever ran before.

        Args:
            seed: Seed of all random numbers from now on; None for the same as before.

        Raises:
            RunError: The run has a record, which is of one run; it is closed, or is being advanced;
                or the seed is not an integer from 0 to 2³² - 1.
        """
        if self._parts.open_record is not None:
            raise RunError("a run with a record cannot be reset: the record is of one run")
        if self._is_busy:
            raise RunError("the run is being advanced; its own parts cannot reset it")
        if self._is_closed:
            raise RunError("the run is closed; open another one")
        options = self._options
        if seed is not None:
            options = replace(options, seed=seed)
        with self._parts.resources, self._parts.at_work():
            self._parts.runner.abandon()
        self._options = options
        self._begin()
        for name, handle in self._arms.items():
            handle.rebind(self.world, self.assembly.arms)
            self._trees[name].rebind(self.assembly.arms)

    def render(
        self,
        camera: str | None = None,
        *,
        size: tuple[int, int] | None = None,
        eye: Sequence[float] | None = None,
        look_at: Sequence[float] | None = None,
        fov: float = 45.0,
    ) -> Image:
        """Image of the world as it is now, of shape (height, width, 3): red, green, blue.

        It is rendered from a copy of the state and changes nothing. Without arguments it shows
        everything with shadows, from a viewpoint that is chosen once for the run.

        Args:
            camera: An arm, for what its camera sees (the whole image, without shadows, noise and
                latency), or a camera of the scene.
            size: Width and height in pixels; by default those of the arm's camera, or 640 by 480.
            eye: Position of a viewer in the world, of shape (3,), m, instead of a camera.
            look_at: Point in the middle of the viewer's image, of shape (3,), m; with ``eye``.
            fov: Vertical field of view of the viewer, degrees.

        Raises:
            RunError: There is no such camera, or an argument is out of range.
        """
        width, height = self._image_size(camera) if size is None else _checked_size(size)
        still = StillRenderer.of(self.world)
        if not still.is_sound:
            raise RunError("the world cannot be rendered: the simulation has diverged")
        if camera is not None:
            if eye is not None or look_at is not None:
                raise RunError("give either a camera, or eye and look_at of a viewer")
            return still.through(self._camera_id(camera), width, height)
        if eye is not None or look_at is not None:
            return still.draw(_checked_viewpoint(eye, look_at, fov), width, height)
        if self._viewpoint is None:
            self._viewpoint = best_viewpoint([still], width / height)
        if self._viewpoint is None:
            raise RunError("nothing to see: the world has neither arms nor objects")
        return still.draw(self._viewpoint, width, height)

    def _image_size(self, camera: str | None) -> tuple[int, int]:
        spec = None if camera not in self._file.arms else self._file.arms[str(camera)].camera
        return _PICTURE if spec is None else spec.resolution

    def _camera_id(self, camera: str) -> int:
        """Id of a camera in the model, by the name of its arm, or its own."""
        model = self.world.model
        names = [model.camera(number).name for number in range(model.ncam)]
        for name in (f"{camera}/{CAMERA}", camera):
            if name in names:
                return int(model.camera(name).id)
        known = [name.removesuffix(f"/{CAMERA}") for name in names]
        if not known:
            raise RunError(f"there is no camera '{camera}': no arm in the world has one")
        raise RunError(f"there is no camera '{camera}'; {suggestion(camera, known, 'camera')}")

    def watch(self, observer: Observer) -> None:
        """Add an observer, notified after those that are already registered.

        Raises:
            RunError: It lacks a method of an observer.
        """
        if not isinstance(observer, Observer):
            raise RunError(
                f"watch: {observer!r} is not an observer: it needs the methods on_event, "
                "after_ticks and after_step"
            )
        self._watching.append(observer)
        self._parts.feed.watch(observer)

    @property
    def open_record(self) -> OpenRecord | None:
        """Parts of the record that are written during the run, None without a record."""
        return self._parts.open_record

    @property
    def watchdog(self) -> Watchdog:
        """Limits the wall-clock time of skill code."""
        return self._parts.watchdog

    def spawn_all(self) -> None:
        """Spawn every arm that the file declares, before the first step.

        Those that overlap others stay away: a file may spawn them when these have been removed.
        """
        for name in self._arms:
            if name not in self.world.arms:
                try:
                    self.world.spawn_arm(name)
                except OverlapError as error:
                    _log.warning("%s, unless that was removed before", error)
        self.assembly.arms.follow(0, ticked_from=0)

    def views(self) -> tuple[ArmView, ...]:
        """Current state of every arm of the file, as displays show it."""
        return self._parts.runner.views()

    def write_record(self) -> None:
        """Write the record now, if one was requested, instead of at the end of the ``with`` block.

        Raises:
            RunError: The run is not over.
            RecordError: The disk is full, or the folder is gone.
        """
        result = self.result
        open_record = self._parts.open_record
        if open_record is not None and not self._is_recorded:
            self._is_recorded = True
            open_record.recorder.write(result, self._stop)

    def close(self) -> None:
        """End the run if it is not over, write the record, and release all resources.

        Raises:
            RecordError: The disk is full, or the folder is gone.
        """
        self._end()

    def discard(self) -> None:
        """End the run without a record, and release all resources.

        An earlier record in its folder stays.
        """
        if self.open_record is not None and not self._is_recorded:
            self._is_recorded = True
            self.open_record.recorder.close()
            self.open_record.folder.withdraw()
        self._end(quietly=True)

    def _end(self, *, quietly: bool = False) -> None:
        self._is_closed = True
        with self._parts.resources, self._parts.at_work():
            if self._result is None:
                self._parts.runner.break_off(quietly=quietly)
                self._take_result()
            self.write_record()

    def __enter__(self) -> Run:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        """Close the run; an error of the block takes precedence over an error of closing.

        A run that an error ends before its first step is discarded.
        """
        try:
            if error is not None and self.time == 0.0:
                self.discard()
            else:
                self.close()
        except DualArmError as another:
            if error is None:
                raise
            error.add_note(str(another))

    def __repr__(self) -> str:
        arms = ", ".join(
            f"{arm.name} {arm.outcome or ('RUNNING' if arm.is_present else 'not in the world')}"
            for arm in self._arms.values()
        )
        return f"<Run {self.name} {'over' if self.done else 'at'} {self.time:.3f} s: {arms}>"

    def _repr_html_(self) -> str:
        """Table for notebooks: the state of arms and nodes, or the result of a run that has ended.

        A row for each node, indented as in the tree.
        """
        if self._result is not None:
            return self._result._repr_html_()
        rows = []
        for arm in self._arms.values():
            state = arm.outcome or ("RUNNING" if arm.is_present else "not in the world")
            rows.append((f"{arm.name} ({arm.robot})", str(state), ""))
            nodes = [(1, self._trees[arm.name].snapshot())]
            while nodes:
                depth, node = nodes.pop()
                progress = "" if node.progress is None else f"{100 * node.progress:.0f} %"
                indent = "\u2003" * depth  # em spaces: HTML collapses plain ones
                rows.append((indent + node.name, node.status, node.reason or progress))
                nodes += [(depth + 1, child) for child in reversed(node.children)]
        caption = f"{self.name}, seed {self.seed}: at {self.time:.2f} s"
        return html_table(caption, ("arm, node", "status", "progress, or why it failed"), rows)

    def _advance(self, until: float) -> None:
        """Make physics steps up to this total number of steps."""
        if self._is_busy:
            raise RunError("the run is already being advanced; its own parts cannot advance it")
        self._is_busy = True
        try:
            with self._parts.at_work():
                self._parts.runner.advance(until)
        finally:
            self._is_busy = False
        self._take_result()

    def _take_result(self) -> None:
        result = self._parts.runner.result
        if result is not None:
            self._result = self._parts.completed(result)


def apply_edit(run: Run, before: TreeFile, now: TreeFile) -> list[str]:
    """Replace the trees of a run by those of an edited file, between two steps.

    Leaves with the same path, node type and ports keep running; other running leaves are halted and
    restarted. Trees that have ended are not changed. A leaf that starts from now on reads the files
    that its ports name as they are now.

    Args:
        run: The run.
        before: The file as it was last applied.
        now: The edited file, checked with the same skills.

    Returns:
        A sentence on each changed tree.

    Raises:
        RunError: The edit changes more than trees; nothing is applied.
    """
    other = [*changes_besides_trees(before, now)]
    if other:
        raise RunError(f"{', '.join(other)}: during a run, only trees can be changed; restart it")
    texts = now.texts_by_name
    edited = {name for name, text in texts.items() if run.assembly.texts.get(name) != text}
    run.assembly.texts.update(texts)
    present = {arm.name: arm for arm in run.assembly.arms.present}
    messages = []
    for name, arm in now.arms.items():
        if same(before.arms[name].tree, arm.tree) and not _names(arm.tree, edited):
            continue
        run.assembly.trees[name] = arm.tree
        if name not in present:
            messages.append(f"{name}: its initial tree has changed")
            continue
        with run.watchdog:
            replaced = present[name].change(arm.tree, run.time)
        messages.append(f"{name}: {'its tree has changed' if replaced else 'its tree has ended'}")
        if replaced and run.open_record is not None:
            run.open_record.trace.of_edit(name, tree_facts(arm.tree))
    return messages


def _names(tree: NodeSpec, files: Set[str]) -> bool:
    """Whether a port of a tree names one of these files."""
    values = (str(value) for node in tree.walk() for value in node.ports.values())
    return any(PurePosixPath(value).as_posix() in files for value in values)


def same(one: NodeSpec, other: NodeSpec) -> bool:
    """Whether two trees have equal node types, names, ports and children."""
    alike = (one.kind, one.name, one.ports, one.slots) == (
        other.kind,
        other.name,
        other.ports,
        other.slots,
    )
    return (
        alike
        and len(one.children) == len(other.children)
        and all(map(same, one.children, other.children))
    )


def changes_besides_trees(before: TreeFile, now: TreeFile) -> Iterator[str]:
    """Yields the paths of the changes outside trees."""
    if before.world != now.world:
        yield "world"
    if before.objects != now.objects:
        yield "objects"
    if before.cell != now.cell:
        yield "cell"
    for part in ("goal", "always", "never", "faults"):
        if getattr(before, part) != getattr(now, part):
            yield part
    if [*before.arms] != [*now.arms]:
        yield "arms"
        return
    for name, arm in now.arms.items():
        if before.arms[name].model_copy(update={"tree": arm.tree}) != arm:
            yield f"arms.{name}"


_POLL_S: Final = 0.3
"""Wall-clock seconds between two checks of the file's time stamp."""

_log = logging.getLogger(__name__)


class FileWatch(IdleObserver):
    """Observer that replaces a run's trees when their file is saved.

    The file is checked in a separate thread and applied between two steps. If it has errors, they
    are logged and the old trees keep running. A change of skill code is not applied, only logged.

    Args:
        run: The run.
        path: Path of its tree file.
        registry: Skills to check it with.
        params: Values of its parameters, by name.

    Raises:
        SpecError: The file has errors.
    """

    def __init__(
        self, run: Run, path: Path, registry: Registry, params: Mapping[str, object]
    ) -> None:
        self._run = run
        self._path = path
        self._registry = registry
        self._params = params
        self._file = self._checked()
        self._stamps = _stamps(self._parts())
        self._code = _stamps(_code_of(self._file, registry))
        self._lock = Lock()
        self._end = Event()
        self._ready: TreeFile | None = None
        self._problems = ""
        self._saved_code: list[str] = []
        self._thread = Thread(target=self._look_on, name="watch", daemon=True)

    def __enter__(self) -> FileWatch:
        self._run.watch(self)
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        """Stop watching."""
        self._end.set()
        self._thread.join(5.0)

    def look(self) -> None:
        """Check the file if it or an included file has been saved since the last call."""
        self._look_at_code()
        stamps = _stamps(self._parts())
        if stamps == self._stamps:
            return
        self._stamps = stamps
        ready = None
        problems = ""
        try:
            ready = self._checked()
            self._stamps = _stamps({*ready.texts, str(self._path)})
        except DualArmError as error:
            problems = str(error)
        with self._lock:
            self._ready = ready
            self._problems = problems

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the run knows it, too
        """Apply pending changes."""
        self.take()

    def take(self) -> bool:
        """Apply a valid edit, log problems; returns whether there was anything to do."""
        if self._ready is None and not self._problems and not self._saved_code:
            return False
        with self._lock:
            ready = self._ready
            problems = self._problems
            saved_code = self._saved_code
            self._ready = None
            self._problems = ""
            self._saved_code = []
        for file in saved_code:
            _log.warning("%s was saved: skill code takes effect in the next run", file)
        if problems:
            message = "%s was saved with errors; the run continues unchanged\n%s"
            _log.warning(message, self._path.name, problems)
        if ready is not None:
            self._apply(ready)
        return True

    def _apply(self, ready: TreeFile) -> None:
        try:
            messages = apply_edit(self._run, self._file, ready)
        except RunError as error:
            _log.warning("%s was saved, but cannot take effect: %s", self._path.name, error)
            return
        self._file = ready
        for sentence in messages:
            _log.info("at %.3f s: %s", self._run.time, sentence)

    def _look_at_code(self) -> None:
        """Collect the skill files used by the trees that were saved since the last call."""
        code = _stamps(_code_of(self._file, self._registry))
        saved = [file for file in code if self._code.get(file, code[file]) != code[file]]
        self._code |= code
        with self._lock:
            self._saved_code += saved

    def _parts(self) -> set[str]:
        return {*self._file.texts, str(self._path)}

    def _checked(self) -> TreeFile:
        checked = check(self._path, self._registry.kinds, self._params, build=False)
        return checked.runnable()

    def _look_on(self) -> None:
        while not self._end.wait(_POLL_S):
            self.look()


def _code_of(file: TreeFile, registry: Registry) -> set[str]:
    """Files of the skills that the trees of a file use."""
    kinds = {node.kind for arm in file.arms.values() for node in arm.tree.walk()}
    origins = {registry.kinds[kind].origin for kind in kinds & registry.kinds.keys()}
    return {origin for origin in origins if origin.endswith(".py")}


def _stamps(files: Iterable[str]) -> dict[str, tuple[int, int]]:
    """Modification time in ns and size in bytes of each file."""
    found = {}
    for file in sorted(files):
        try:
            state = Path(file).stat()
            found[file] = state.st_mtime_ns, state.st_size
        except OSError:  # an editor is replacing the file
            found[file] = 0, 0
    return found
