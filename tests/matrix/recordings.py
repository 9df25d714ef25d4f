"""Recorded runs of the columns, each made once for all cells of the column and all workers."""

from __future__ import annotations

import fcntl
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco

import bt_dualarm as bt
from bt_dualarm.replay.record import Record
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.runtime.outcome import Ending
from bt_dualarm.runtime.run import Run
from tests.commands import in_this_process
from tests.families import WHOLE
from tests.matrix.columns import Column

BEGINNING_S = 0.7 if WHOLE else 0.4
"""Simulated duration of recordings for videos, s, where whole ones would take too long."""


def driven(column: Column, run: Run) -> bt.RunResult:
    """Advances a run to its end, and stops it if the column says so."""
    if column.stop_at is not None:
        run.step(column.stop_at - run.time)
        run.stop()
    return run.finish()


def run_of(column: Column, tree: Path | str | Mapping[str, object], **options: Any) -> bt.RunResult:
    """Result of a run of a column's tree; options take precedence over the column's."""
    with bt.open(tree, **(column.options | options)) as run:
        return driven(column, run)


@dataclass(frozen=True)
class Output:
    """Exit code, standard output and standard error of a command."""

    code: int
    out: str
    err: str


def output_of(program: str, *arguments: str | Path) -> Output:
    """Runs a command in this process."""
    out = io.StringIO()
    err = io.StringIO()
    code = in_this_process(program, arguments, out, err)
    output = Output(code, out.getvalue(), err.getvalue())
    assert "Traceback" not in output.err, output.err
    assert "internal error" not in output.err, output.err
    return output


@dataclass(frozen=True)
class Recording:
    """The recorded run of a column.

    Attributes:
        column: The column.
        tree: The tree file.
        folder: Folder of the record.
        output: Output of the command that made the record; None if no command did.
    """

    column: Column
    tree: Path
    folder: Path
    output: Output | None

    @cached_property
    def record(self) -> Record:
        """The record, read once."""
        return Record.read(self.folder)

    @cached_property
    def summary(self) -> dict[str, Any]:
        """``summary.json``."""
        content: dict[str, Any] = json.loads((self.folder / "summary.json").read_text())
        return content

    @property
    def digest(self) -> str:
        """Hash of all states of the run."""
        return str(self.summary["state_sha256"])

    @cached_property
    def events(self) -> list[dict[str, Any]]:
        """``events.jsonl``."""
        lines = (self.folder / "events.jsonl").read_text().splitlines()
        return [json.loads(line) for line in lines]

    @cached_property
    def statuses(self) -> dict[tuple[str, str], str]:
        """Last status of each node, by arm and path.

        In a tree that was halted as a whole, nodes that had ended keep their status.
        """
        lasts = {event["arm"]: event for event in self.events}
        found = {}
        for event in self.events:
            last = lasts[event["arm"]]  # a halt goes from the leaves to the root
            of_halt = (last["old"], last["new"]) == ("RUNNING", "INVALID")
            wiped = of_halt and event["time_s"] == last["time_s"] and event["new"] == "INVALID"
            if not (wiped and event["old"] in ("SUCCESS", "FAILURE")):
                found[event["arm"], event["path"]] = event["new"]
        return found

    @cached_property
    def nodes(self) -> dict[str, int]:
        """Number of nodes of each arm's tree."""
        return {name: _count(arm["tree"]) for name, arm in self.record.arms.items()}

    @property
    def cameras(self) -> list[str]:
        """Arms that have a camera."""
        return [name for name, arm in self.record.arms.items() if arm.get("camera")]

    @property
    def frame_counts(self) -> dict[str, int]:
        """Number of camera frames, by the camera's arm."""
        frames = [note["arm"] for note in self.record.notes if note["kind"] == "frame"]
        return {arm: frames.count(arm) for arm in frames}

    @cached_property
    def models(self) -> list[mujoco.MjModel]:
        """Models of the recorded states, in order."""
        count = len(self.record.times)
        generations = dict.fromkeys(self.record.moment(row).generation for row in range(count))
        return [self.record.model(generation) for generation in generations]

    @property
    def bodies(self) -> set[str]:
        """Names of all bodies that were ever in the world: links, fingers, objects."""
        return {model.body(i).name for model in self.models for i in range(1, model.nbody)}

    @property
    def joints(self) -> set[str]:
        """Names of all joints of arms and grippers that were ever in the world."""
        return {
            model.joint(i).name
            for model in self.models
            for i in range(model.njnt)
            if "/" in model.joint(i).name
        }

    @property
    def objects(self) -> set[str]:
        """Names of the declared objects that were ever in the world."""
        return set(self.record.start["objects"]) & self.bodies

    def arm_joints(self, arm: str) -> list[str]:
        """Names of an arm's own joints in the model, base to tip."""
        return [f"{arm}/{name}" for name in load_robot(self.record.arms[arm]["robot"]).joints]

    def grippers(self) -> list[str]:
        """Arms that have a gripper and were ever in the world."""
        return [name for name in self.present if self.record.arms[name].get("gripper")]

    @property
    def present(self) -> list[str]:
        """Arms that were ever in the world."""
        return [name for name in self.record.arms if self.arm_joints(name)[0] in self.joints]


def _count(node: dict[str, Any]) -> int:
    return 1 + sum(map(_count, node["children"]))


class Recordings:
    """Records of columns below a folder that all workers of a test run share.

    Args:
        folder: The folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._last: Recording | None = None

    def tree(self, column: Column) -> Path:
        """The tree file of a column."""
        folder = self._folder / column.name
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            path = folder / f"{column.name}.yaml"
            return path if path.exists() else column.write(folder)

    def of(self, column: Column) -> Recording:
        """The recording of a column, made on first use by any worker."""
        if self._last is None or self._last.column.name != column.name:
            self._last = self._made(column, "record")
        return self._last

    def beginning(self, column: Column, seconds: float = BEGINNING_S) -> Recording:
        """The recording of the first moments of a column's run."""
        begun = {"outcome": "UNFINISHED", "ending": Ending.DURATION, "duration": seconds}
        name = f"beginning_{seconds:g}"
        return self._made(replace(column, stop_at=None, failed=None, **begun), name)  # type: ignore[arg-type]  # they fit

    def _made(self, column: Column, name: str) -> Recording:
        tree = self.tree(column)
        folder = self._folder / column.name
        record = folder / name
        note = folder / f"{name}.json"
        with (folder / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not note.exists():
                output = _recorded(column, tree, record)
                note.write_text(json.dumps(output and vars(output)))
        found = json.loads(note.read_text())
        return Recording(column, tree, record, None if found is None else Output(**found))


def _recorded(column: Column, tree: Path, folder: Path) -> Output | None:
    if column.stop_at is not None:  # no command stops a run at a simulated time
        run_of(column, tree, record=folder, renderer="ray")
        return None
    given = ["--renderer", "ray", "--display", "log", *column.arguments]
    return output_of("bt-run", tree, "--record", folder, *given)
