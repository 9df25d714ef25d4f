"""Signals of arms and grippers: sampled in simulated time, however often a page asks for them."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from fractions import Fraction
from threading import Lock
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.live.physics import as_text
from bt_dualarm.live.places import Places, places_of
from bt_dualarm.pose import Vector
from bt_dualarm.runtime.arms import Arms
from bt_dualarm.runtime.parts import IdleObserver
from bt_dualarm.runtime.schedule import Periodic, exact
from bt_dualarm.spec.source import Json
from bt_dualarm.world.world import World

PERIOD: Final = Fraction(1, 25)
"""Simulated seconds between two samples."""

MOST_ROWS: Final = 6000
"""Samples of an arm that are kept: four minutes at 25 Hz; of longer runs every second one."""

COLUMNS: Final = ("time", "x", "y", "z", "error_deg", "torque_share", "opening_m", "force_n")
"""Numbers of a sample: simulated time in s, tool in m, the farthest joint from its set-point, the
torque of the motor that gives most of what it can as a share of that, how far the fingers are open,
and the force of a pad or cup; NaN where there is none."""

Row = tuple[float, ...]


def row_of(
    model: mujoco.MjModel, data: mujoco.MjData, arm: Places, sent: Vector, torque: Vector
) -> Row:
    """A sample without the gripper's force, which no state tells.

    Args:
        model: The compiled world.
        data: Its state, kinematics up to date.
        arm: The arm in it.
        sent: Positions of the set-point, of shape (dof,), rad.
        torque: Commanded torques, of shape (dof,), N m.
    """
    error = float(np.degrees(np.abs(sent - data.qpos[arm.qpos]).max()))
    share = arm.torque_share(model, torque)
    tool = data.site_xpos[arm.tool].tolist()
    return (float(data.time), *tool, error, share, arm.opening(data.qpos))


def series_text(arms: Mapping[str, Vector]) -> Json:
    """Samples of arms, each of shape (n, 8), ready for JSON: 32-bit numbers as base64."""
    return {"columns": COLUMNS, "arms": {name: as_text(rows) for name, rows in arms.items()}}


class Signals(IdleObserver):
    """An observer that keeps samples of all arms of a run that goes on.

    Args:
        world: The world.
        arms: Arms that are in it.
    """

    def __init__(self, world: World, arms: Arms) -> None:
        self._world, self._arms = world, arms
        self._due = Periodic(PERIOD, exact(world.timestep))
        self._steps = self._seen = 0
        self._stride = 1
        self._generation = -1
        self._places: dict[str, Places] = {}
        self._rows: dict[str, array[float]] = {}
        self._lock = Lock()

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the world knows it, too
        """Take a sample if one is due."""
        due = self._due.due(self._steps)
        self._steps += 1
        if due:
            if self._seen % self._stride == 0:
                self._sample()
            self._seen += 1

    def since(self, time: float) -> Json:
        """Samples after a time in s, ready for JSON."""
        with self._lock:
            kept = {name: np.array(rows) for name, rows in self._rows.items()}
        tables = {name: rows.reshape(-1, len(COLUMNS)) for name, rows in kept.items()}
        return series_text({name: rows[rows[:, 0] > time + 1e-4] for name, rows in tables.items()})

    def _sample(self) -> None:
        world = self._world
        if world.generation != self._generation:
            self._places = places_of(world.model, world.arms)
            self._generation = world.generation
        for present in self._arms.present:
            arm = self._places.get(present.name)
            if arm is not None:
                data, sent = world.data, present.controller.setpoint.q
                row = row_of(world.model, data, arm, sent, data.ctrl[arm.motors])
                gripper = world.grippers.get(present.name)
                with self._lock:
                    rows = self._rows.setdefault(present.name, array("f"))
                    rows.extend((*row, np.nan if gripper is None else gripper.force))
        if any(len(rows) > MOST_ROWS * len(COLUMNS) for rows in self._rows.values()):
            self._stride *= 2
            with self._lock:
                self._rows = {name: _thinned(rows) for name, rows in self._rows.items()}


def _thinned(rows: array[float]) -> array[float]:
    return array("f", np.array(rows).reshape(-1, len(COLUMNS))[::2].ravel())
