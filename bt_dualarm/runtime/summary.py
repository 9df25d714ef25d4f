"""``summary.json``: what a run did, for programs."""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import version
from types import MappingProxyType

from bt_dualarm.runtime.processor import processor
from bt_dualarm.runtime.result import ArmResult, RunResult

_PACKAGES = (
    "bt_dualarm",
    "example-robot-data",
    "mujoco",
    "numpy",
    "ompl",
    "opencv-python-headless",
    "placo",
    "py_trees",
    "ruckig",
    "scipy",
)


@cache
def versions() -> Mapping[str, str]:
    """Of Python and of every package that can change a result; found once, as it takes 9 ms."""
    found = {"python": platform.python_version()} | {name: version(name) for name in _PACKAGES}
    return MappingProxyType(found)


def summary_of(
    result: RunResult, attachments: Sequence[Mapping[str, object]], attachments_left_out: int
) -> dict[str, object]:
    """The content of ``summary.json``; names carry their units.

    Args:
        result: What the run did.
        attachments: Every attachment, or the first and the last ones if there were many.
        attachments_left_out: Number of attachments in between.
    """
    summary = {
        "outcome": result.outcome,
        "ending": result.ending,
        "error": result.error,
        "at_rest": result.at_rest,
        "sim_time_s": result.sim_time_s,
        "wall_time_s": result.wall_time_s,
        "real_time_factor": result.real_time_factor,
        "seed": result.seed,
        "reality": result.reality,
        "state_sha256": result.state_sha256,
        "processor": processor(),
        "versions": versions(),
        "renderer": result.renderer,
        "attachments": attachments,
        "attachments_left_out": attachments_left_out,
        "arms": {arm.name: _arm(arm) for arm in result.arms.values()},
    }
    return {name: json_ready(value) for name, value in summary.items()}


def _arm(arm: ArmResult) -> dict[str, object]:
    return {
        "outcome": arm.outcome,
        "robot": arm.robot,
        "fault": arm.fault,
        "lives": [vars(life) for life in arm.lives],
        "lives_left_out": arm.lives_left_out,
        "clipped_setpoints": arm.clipped_setpoints,
        "guard": arm.guard,
        "slow_ticks": [vars(tick) for tick in arm.slow_ticks],
        "runs_left_out": arm.runs_left_out,
        "leaves": [run.as_dict() for run in arm.runs],
    }


def json_ready(value: object) -> object:
    """The same with what JSON knows: NumPy's scalars made plain, times rounded to nanoseconds.

    Numbers that are not finite become null: JSON has none.
    """
    if isinstance(value, Mapping):
        return {str(key): json_ready(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_ready(item) for item in value]
    if hasattr(value, "tolist"):
        return json_ready(value.tolist())
    if isinstance(value, float):
        return round(value, 9) if math.isfinite(value) else None
    return str(value) if isinstance(value, str) else value
