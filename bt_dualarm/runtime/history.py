"""The history of a run, written during the run: the data for replay, resume and diagnosis."""

from __future__ import annotations

import hashlib
import inspect
import logging
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Final

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.control.controller import JointController
from bt_dualarm.robots.robot import is_description_path
from bt_dualarm.runtime.arm_runtime import ArmRuntime, IdleObserver
from bt_dualarm.runtime.clock import Periodic, exact
from bt_dualarm.runtime.history_file import Block, HistoryWriter, ModelWriter
from bt_dualarm.runtime.observations import HASH_PERIOD, TraceEvents
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.summary import json_ready, processor, versions
from bt_dualarm.sim.world import World
from bt_dualarm.skill.skill import Skill
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.node_types import NodeSpec

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Start:
    """Facts that a run starts from: tree file, skills, options, seed, versions.

    Attributes:
        file: The tree file.
        skills: Classes of all skills, by name.
        options: Overrides of the file's settings.
        seed: Seed of all random numbers.
        renderer: Renderer of the cameras, None without any.
        timestep: Seconds of one physics step.
    """

    file: TreeFile
    skills: Mapping[str, type[Skill]]
    options: RunOptions
    seed: int
    renderer: str | None
    timestep: float

    def block(self) -> Block:
        """Returns the first block of a history."""
        file = self.file
        options = self.options
        objects = {name: spec.model_dump(mode="json") for name, spec in file.objects.items()}
        data = {
            "name": file.name,
            "path": str(file.root.absolute() / file.path.name),
            "texts": dict(file.texts),
            "params": dict(file.given),
            "seed": self.seed,
            "renderer": self.renderer,
            "reality": _reality(options),
            "duration": options.duration,
            "faults": {
                name: fault.model_dump(mode="json", exclude_defaults=True) | {"kind": fault.kind}
                for name, fault in options.faults.items()
            },
            "timestep": self.timestep,
            "time_limit": file.world.time_limit,
            "objects": objects,
            "arms": {name: self._arm(name) for name in file.arms},
            "pages": {name: _digest(path) for name, path in self._descriptions()},
            "skills": self._skills(),
            "versions": versions(),
            "processor": processor(),
        }
        # Exact, because a replay computes with these numbers.
        exactly = {name: json_ready(value, decimals=None) for name, value in data.items()}
        return Block("start", exactly)

    def _arm(self, name: str) -> dict[str, object]:
        arm = self.file.arms[name]
        return {**arm.model_dump(mode="json", exclude={"tree"}), "tree": tree_facts(arm.tree)}

    def _descriptions(self) -> Iterator[tuple[str, Path]]:
        """Yields the names and paths of robot descriptions that the tree file refers to by path."""
        for arm in self.file.arms.values():
            if is_description_path(arm.robot):
                yield arm.robot, self.file.root / arm.robot

    def _skills(self) -> dict[str, dict[str, str]]:
        """Files of the skills used by the trees, and SHA-256 digests of their code."""
        kinds = {node.kind for arm in self.file.arms.values() for node in arm.tree.walk()}
        found = {}
        for kind in sorted(kinds & self.skills.keys()):
            path = _file_of(self.skills[kind])
            found[kind] = {"file": str(path or ""), "sha256": "" if path is None else _digest(path)}
        return found


def _reality(options: RunOptions) -> object:
    if options.reality is None or isinstance(options.reality, str):
        return options.reality
    return options.reality.model_dump(mode="json", exclude_unset=True)


def tree_facts(node: NodeSpec) -> dict[str, object]:
    """A node with its children and its location in the file, as a JSON-ready mapping."""
    location = node.location
    return {
        "kind": node.kind,
        "name": node.name,
        "ports": json_ready(dict(node.ports)),
        "place": (
            f"{Path(location.file).name}:{location.line}"
            if location.line
            else Path(location.file).name
        ),
        "children": [tree_facts(child) for child in node.children],
    }


def _file_of(skill: type[Skill]) -> Path | None:
    """File of a skill class; None for a class defined interactively."""
    try:
        path = Path(inspect.getfile(skill))
    except (OSError, TypeError):
        return None
    return path if path.is_file() else None


def _digest(path: Path) -> str:
    """SHA-256 of a file in hexadecimal, empty if it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


FRAME_PERIOD: Final[Fraction] = HASH_PERIOD
"""Seconds between two states that are kept: the states that the hash of the run covers."""

BLOCK_S: Final = 1
"""Simulated seconds in a block: the most that is lost if the process is killed."""

_KEY_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class Frames:
    """Collects checksums, states and set-points of one compiled model until a block is full.

    Args:
        world: The world.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._due = Periodic(FRAME_PERIOD, exact(world.timestep))
        self._per_block = max(1, round(BLOCK_S / world.timestep))
        self._steps = 0
        self._begin()

    def _begin(self) -> None:
        self._first = self._steps
        self._generation = self._world.generation
        data = self._world.data
        # Views, because looking them up costs more than reading them.
        self._q = data.qpos
        self._v = data.qvel
        self._checksums: list[int] = []
        self._rows: list[int] = []
        self._states: list[npt.NDArray[np.float64]] = []
        self._arms: dict[str, list[npt.NDArray[np.float64]]] = {}
        self._grippers: dict[str, list[tuple[float, ...]]] = {}

    @property
    def outdated(self) -> bool:
        """Whether the world was recompiled, so that the collected data belong to another model."""
        return self._world.generation != self._generation

    @property
    def full(self) -> bool:
        """Whether there are enough steps for a block."""
        return len(self._checksums) >= self._per_block

    def after_step(self) -> bool:
        """Add the checksum of the last step; returns whether its state is to be kept."""
        self._checksums.append(zlib.crc32(self._v, zlib.crc32(self._q)))
        self._steps += 1
        return self._due.due(self._steps - 1)

    def keep(self, controllers: Iterable[tuple[str, JointController]]) -> None:
        """Keep the state after the last step, and the commands of arms and grippers.

        Args:
            controllers: Arms that are present, with their controllers.
        """
        self._rows.append(self._steps - 1)
        self._states.append(np.concatenate(((self._world.data.time,), self._q, self._v)))
        for name, controller in controllers:
            setpoint = controller.setpoint
            drives = self._world.hardware[name]
            row = np.concatenate((setpoint.q, setpoint.v, setpoint.a, drives.commanded))
            self._arms.setdefault(name, []).append(row)
            gripper = self._world.grippers.get(name)
            if gripper is not None:
                command = gripper.commanded
                sensed = gripper.width, gripper.speed, gripper.force, gripper.vacuum
                self._grippers.setdefault(name, []).append(
                    (*sensed, command.width, command.speed, command.force)
                )

    def block(self, notes: list[dict[str, object]]) -> Block:
        """Returns the collected data as a block, and starts the next one.

        Args:
            notes: Trace events of the same time, JSON-ready.
        """
        arrays: dict[str, npt.NDArray[np.generic]] = {
            "checksums": np.array(self._checksums, np.uint32),
            "rows": np.array(self._rows, np.uint32),
        }
        if self._states:
            arrays["states"] = np.array(self._states)
        if not self.outdated:
            arrays["key"] = self._key()
        for name, rows in self._arms.items():
            arrays[f"arm:{name}"] = np.array(rows, np.float32)
        for name, states in self._grippers.items():
            arrays[f"gripper:{name}"] = np.array(states, np.float32)
        data = {"first_step": self._first, "generation": self._generation, "notes": notes}
        self._begin()
        return Block("second", data, arrays)

    def _key(self) -> npt.NDArray[np.float64]:
        """Full integration state after the last step, from which the simulation can continue."""
        model = self._world.model
        state = np.empty(mujoco.mj_stateSize(model, _KEY_STATE))
        mujoco.mj_getState(model, self._world.data, state, _KEY_STATE)
        return state


_STATES_PER_GUARD_CHECK: Final = 5
"""Kept states from one check of the guards' counts to the next: a tenth of a second."""


class History(IdleObserver):
    """Observer that writes a block for each simulated second and for each compiled model.

    The file is created with the first step. At most one second is kept in memory. A write error
    does not end the run; `finish` raises it.

    Args:
        path: File to write.
        world: The world.
        arms: Returns the arms that are present.
        trace: Trace events, taken second by second.
        start: Makes the first block.
    """

    def __init__(
        self,
        path: Path,
        world: World,
        arms: Callable[[], Sequence[ArmRuntime]],
        trace: TraceEvents,
        start: Callable[[], Block],
    ) -> None:
        self._writer = HistoryWriter(path)
        self._world = world
        self._arms = arms
        self._trace = trace
        self._failure: Exception | None = None
        self._models = ModelWriter()
        self._frames = Frames(world)
        self._kept = 0
        self._begun = False
        self._waiting: deque[Block] = deque()
        self._add(start, self._model)

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the world knows it, too
        """Add the step; write blocks that are full."""
        if not self._begun:
            self._begun = True
            self._add()
        if self._failure is not None:
            self._trace.take()
            return
        if self._frames.outdated:
            self._flush()
            self._add(self._model)
        if self._frames.after_step():
            self._keep()
            if self._frames.full:
                self._flush()

    def _keep(self) -> None:
        arms = self._arms()
        self._frames.keep((arm.name, arm.controller) for arm in arms)
        self._trace.of_holding(self._world.attachments)
        self._kept += 1
        if self._kept % _STATES_PER_GUARD_CHECK == 0:
            for arm in arms:
                self._trace.of_guard(arm.name, arm.controller)

    def flush(self) -> None:
        """Write the collected data; to be called between two steps."""
        if self._begun:
            self._flush()

    def finish(self, sha256: str) -> None:
        """Write the remaining data and the end block.

        Args:
            sha256: Hash of the states of the run, in hexadecimal.

        Raises:
            OSError: The history could not be written, or the disk is full.
            ValueError: A block could not be encoded.
        """
        self._begun = True
        self._flush()
        self._add(lambda: Block("end", {"state_sha256": sha256}))
        if isinstance(self._failure, OSError):
            raise self._failure
        if self._failure is not None:
            raise ValueError(str(self._failure)) from self._failure
        self._writer.finish()

    def close(self) -> None:
        """Close the file."""
        self._writer.close()

    def _flush(self) -> None:
        self._add(lambda: self._frames.block(self._trace.take()))

    def _add(self, *makers: Callable[[], Block]) -> None:
        """Make blocks; write them and those that are queued, once the run has begun."""
        if self._failure is not None:
            return
        try:
            self._waiting.extend(make() for make in makers)
            while self._begun and self._waiting:
                self._writer.add(self._waiting.popleft())
        except (OSError, ValueError) as error:
            self._failure = error
            self._waiting.clear()
            _log.warning("the history is no longer written: %s", error)

    def _model(self) -> Block:
        """Block of the parts of the compiled model that are not written yet."""
        return self._models.block(self._world.model, self._world.generation)
