"""A run of the command ``bt-run``, as it looks from outside."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class Ran:
    """What a finished process said and left behind.

    Attributes:
        code: Its exit code.
        out: What it wrote to standard output.
        err: What it wrote to standard error.
        folder: Of ``--record``.
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
        """Reports of all runs of leaves of one kind."""
        return [leaf for leaf in self.summary["arms"][arm]["leaves"] if leaf["skill"] == skill]

    def _text(self, name: str) -> str:
        return (self.folder / name).read_text(encoding="utf-8")


BtRun: TypeAlias = Callable[..., Ran]
"""Takes the arguments of ``bt-run``."""
