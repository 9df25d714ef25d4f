"""Running the commands in this process, and the results of ``bt-run``."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TextIO, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm import cli


@dataclass(frozen=True)
class Ran:
    """Output and record of a finished process.

    Attributes:
        code: Its exit code.
        out: What it wrote to standard output.
        err: What it wrote to standard error.
        folder: Folder of ``--record``.
    """

    code: int
    out: str
    err: str
    folder: Path

    @cached_property
    def summary(self) -> dict[str, Any]:
        """``summary.json``."""
        content: dict[str, Any] = json.loads(self._text("summary.json"))
        return content

    @cached_property
    def events(self) -> list[dict[str, Any]]:
        """``events.jsonl``."""
        return [json.loads(line) for line in self._text("events.jsonl").splitlines()]

    @cached_property
    def samples(self) -> dict[str, npt.NDArray[np.float64]]:
        """``samples.npz``: ``time``, ``tool_<arm>``, ``object_<name>``."""
        with np.load(self.folder / "samples.npz") as archive:
            return {name: archive[name] for name in archive.files}

    def leaves(self, arm: str, skill: str) -> list[dict[str, Any]]:
        """Reports of all runs of leaves with a skill."""
        return [leaf for leaf in self.summary["arms"][arm]["leaves"] if leaf["skill"] == skill]

    def _text(self, name: str) -> str:
        return (self.folder / name).read_text(encoding="utf-8")


BtRun: TypeAlias = Callable[..., Ran]
"""Function that takes the arguments of ``bt-run``."""


def in_this_process(program: str, arguments: Sequence[str | Path], out: TextIO, err: TextIO) -> int:
    """Run a command and return its exit code, without the second of imports of a fresh process.

    Args:
        program: Name of the command, such as ``bt-run``.
        arguments: As typed after it.
        out: Stream for its standard output.
        err: Stream for its standard error.
    """
    command = getattr(cli, program.removeprefix("bt-").replace("-", "_"))
    with redirect_stdout(out), redirect_stderr(err):
        try:
            return int(command([str(argument) for argument in arguments]))
        except SystemExit as ended:  # --help, or invalid arguments
            return int(ended.code or 0)
