"""A record as arrays over time: joints, tools, grippers, objects, camera images."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from typing import Any, Final, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.errors import DualArmError, RunError
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.replay.record import Facts, Record, ReplayError
from bt_dualarm.replay.timeline import (
    RecordedFrame,
    gripper_kind,
    held_over_time,
    recorded_frames,
)
from bt_dualarm.robots.mjspec import TOOL_SITE, joint_motors
from bt_dualarm.runtime.history_file import MOST_MEMORY
from bt_dualarm.runtime.options import checked_path
from bt_dualarm.spec.node_types import counted
from bt_dualarm.spec.problems import Named, suggestion

Column: TypeAlias = npt.NDArray[np.float64]

_AXES: Final = ("x", "y", "z")
_QUATERNION: Final = ("qw", "qx", "qy", "qz")


@dataclass(frozen=True, eq=False)
class GripperTrack:
    """A gripper over time, at the times of `RunData.time`; NaN while its arm is not in the world.

    Attributes:
        kind: ``fingers`` or ``suction``.
        width: Opening from the encoder, of shape (n,), m; 0 for a cup.
        speed: Speed of the opening, positive when opening, of shape (n,), m/s.
        force: Force of a pad from the motor's current, or of a cup, of shape (n,), N.
        vacuum: Fraction of the full vacuum that a cup measures, of shape (n,).
        commanded_width: Commanded opening, of shape (n,), m.
        commanded_speed: Commanded speed of the opening, of shape (n,), m/s.
        commanded_force: Commanded largest force, of shape (n,), N.
    """

    kind: str
    width: Column
    speed: Column
    force: Column
    vacuum: Column
    commanded_width: Column
    commanded_speed: Column
    commanded_force: Column


@dataclass(frozen=True, eq=False)
class ArmTrack:
    """An arm over time, at the times of `RunData.time`; NaN while it is not in the world.

    Positions and velocities are the simulator's truth, set-points and torques what its controller
    commanded. Angles are in rad (m for a linear joint).

    Attributes:
        name: Name of the arm in the file.
        robot: Name of its robot.
        joints: Names of its joints, base to tip.
        q: Joint positions, of shape (n, dof).
        v: Joint velocities, of shape (n, dof), rad/s.
        setpoint_q: Positions of the set-point, of shape (n, dof).
        setpoint_v: Velocities of the set-point, of shape (n, dof), rad/s.
        setpoint_a: Accelerations of the set-point, of shape (n, dof), rad/s².
        torque: Commanded torques, of shape (n, dof), N m.
        tool_position: Position of the tool frame in the world, of shape (n, 3), m.
        tool_quaternion: Orientation of the tool frame in the world, (w, x, y, z), of shape (n, 4).
        gripper: Its gripper; None if it has none.
        held: Objects that it was assumed to hold, with the time from which it was so in s.
    """

    name: str
    robot: str
    joints: tuple[str, ...]
    q: Matrix
    v: Matrix
    setpoint_q: Matrix
    setpoint_v: Matrix
    setpoint_a: Matrix
    torque: Matrix
    tool_position: Matrix
    tool_quaternion: Matrix
    gripper: GripperTrack | None
    held: tuple[tuple[float, tuple[str, ...]], ...]


@dataclass(frozen=True, eq=False)
class ObjectTrack:
    """An object over time, at the times of `RunData.time`; NaN while it is not in the world.

    Attributes:
        name: Name of the object in the file.
        position: True position of its center in the world, of shape (n, 3), m.
        quaternion: True orientation in the world, (w, x, y, z), of shape (n, 4).
    """

    name: str
    position: Matrix
    quaternion: Matrix


@dataclass(frozen=True, eq=False)
class _Kinematics:
    """Poses (position, quaternion) over time, each of shape (n, 7), and joints, by name."""

    tools: dict[str, Matrix]
    objects: dict[str, Matrix]
    joints: dict[str, tuple[str, ...]]
    grippers: dict[str, str]
    q: dict[str, Matrix]
    v: dict[str, Matrix]

    def begin(
        self, arm: str, model: mujoco.MjModel, joints: npt.NDArray[np.int64], count: int
    ) -> None:
        """Make room for an arm that is in a model.

        Raises:
            ReplayError: It had another number of joints in an earlier model.
        """
        kind = gripper_kind(model, arm)
        if kind is not None:
            self.grippers[arm] = kind
        if arm not in self.q:
            self.joints[arm] = tuple(
                model.joint(joint).name.removeprefix(f"{arm}/") for joint in joints.tolist()
            )
            self.q[arm] = np.full((count, len(joints)), np.nan)
            self.v[arm] = np.full((count, len(joints)), np.nan)
            self.tools[arm] = np.full((count, 7), np.nan)
        elif self.q[arm].shape[1] != len(joints):
            raise ReplayError(
                f"{arm} has {len(joints)} joints in one model of the record, and "
                f"{self.q[arm].shape[1]} in another: it is damaged"
            )


class RunData:
    """A record of a run as arrays; all arrays have one row for each of its ``n`` states, 50 Hz.

    Args:
        record: The validated record.
    """

    def __init__(self, record: Record) -> None:
        self._record = record

    @property
    def name(self) -> str:
        """Name of the tree file."""
        return self._record.name

    @property
    def seed(self) -> int:
        """Seed of all random numbers."""
        return int(self._record.start["seed"])

    @property
    def outcome(self) -> str | None:
        """Outcome of the run; None if it was killed."""
        summary = self._record.summary or {}
        return None if "outcome" not in summary else str(summary["outcome"])

    @property
    def summary(self) -> Facts | None:
        """Content of ``summary.json``: results of arms and leaves; None if the run was killed."""
        return self._record.summary

    @property
    def torn(self) -> str:
        """Sentence on what is missing at the end of the record, empty if it is complete."""
        return self._record.torn

    @property
    def events(self) -> tuple[Facts, ...]:
        """Status changes in order: time_s, arm, path, kind, old, new, code, reason, metrics."""
        return self._record.events

    @property
    def notes(self) -> tuple[Facts, ...]:
        """Trace events in order, such as ports, blackboard writes, detections, guard actions."""
        return self._record.notes

    @property
    def time(self) -> Column:
        """Simulated times of all states, of shape (n,), s."""
        return self._record.times

    @cached_property
    def arms(self) -> Mapping[str, ArmTrack]:
        """Arms that were ever in the world, by name.

        Raises:
            ReplayError: This MuJoCo cannot read the models of the record.
        """
        names = self._kinematics.q
        return Named("arm", {name: self._arm(name) for name in self._record.arms if name in names})

    @cached_property
    def objects(self) -> Mapping[str, ObjectTrack]:
        """Objects that were ever in the world, by name.

        Raises:
            ReplayError: This MuJoCo cannot read the models of the record.
        """
        poses = self._kinematics.objects
        tracks = {
            name: ObjectTrack(name, pose[:, :3], pose[:, 3:])
            for name, pose in poses.items()
            if not np.isnan(pose).all()
        }
        return Named("object", tracks)

    def blackboard(self, arm: str) -> dict[str, list[tuple[float, Any]]]:  # any data
        """Every value that an arm's tree wrote, by key: pairs of simulated time in s and value.

        Raises:
            ReplayError: There is no such arm.
        """
        self._must_have(arm)
        found: dict[str, list[tuple[float, Any]]] = {}
        for note in self._record.notes:
            if note["kind"] == "wrote" and note["arm"] == arm:
                written = (float(note["time_s"]), note["value"])
                found.setdefault(str(note["key"]), []).append(written)
        return found

    def frames(self, arm: str | None = None) -> Iterator[RecordedFrame]:
        """Yields the recorded camera frames in order; none unless recorded with ``frames``.

        Args:
            arm: Arm whose camera's frames are requested; None for all.

        Raises:
            ReplayError: There is no such arm.
            HistoryError: The file of frames is damaged.
        """
        if arm is not None:
            self._must_have(arm)
        return (frame for frame in recorded_frames(self._record) if arm in (None, frame.arm))

    @cached_property
    def signals(self) -> Mapping[str, Column]:
        """All numbers over time by name, each of shape (n,), ``time_s`` first.

        Names are ``ARM.q_rad.JOINT``, ``ARM.v_rad_s.JOINT``, ``ARM.setpoint_rad.JOINT``,
        ``ARM.torque_nm.JOINT``, ``ARM.tool_m.x``, ``ARM.tool.qw``, ``ARM.gripper.width_m`` (and
        ``speed_m_s``, ``force_n``, ``vacuum``), ``OBJECT.position_m.x``, ``OBJECT.qw``. A data
        frame of pandas can be made of it.
        """
        found = {"time_s": self.time}
        for arm in self.arms.values():
            for quantity, values in (
                ("q_rad", arm.q),
                ("v_rad_s", arm.v),
                ("setpoint_rad", arm.setpoint_q),
                ("torque_nm", arm.torque),
            ):
                columns = zip(arm.joints, values.T, strict=True)
                found |= {f"{arm.name}.{quantity}.{joint}": column for joint, column in columns}
            found |= _named(f"{arm.name}.tool_m.", _AXES, arm.tool_position)
            found |= _named(f"{arm.name}.tool.", _QUATERNION, arm.tool_quaternion)
            if arm.gripper is not None:
                found |= {
                    f"{arm.name}.gripper.width_m": arm.gripper.width,
                    f"{arm.name}.gripper.speed_m_s": arm.gripper.speed,
                    f"{arm.name}.gripper.force_n": arm.gripper.force,
                    f"{arm.name}.gripper.vacuum": arm.gripper.vacuum,
                }
        for obj in self.objects.values():
            found |= _named(f"{obj.name}.position_m.", _AXES, obj.position)
            found |= _named(f"{obj.name}.", _QUATERNION, obj.quaternion)
        return Named("signal", found)

    def table(self) -> Any:  # Any: pyarrow has no types
        """All `signals` as a `pyarrow.Table`, whose ``to_pandas()`` is a data frame.

        Raises:
            DualArmError: pyarrow is not installed; the message states how to install it.
        """
        try:
            import pyarrow as pa
        except ImportError as error:
            raise DualArmError(
                "a table of a record needs pyarrow: pip install 'bt_dualarm[export]'; "
                "`signals` has the same columns as NumPy arrays"
            ) from error
        return pa.table(dict(self.signals))

    def __repr__(self) -> str:
        return (
            f"<RunData {self.name}: {self.outcome or 'killed'}, "
            f"{counted(len(self.time), 'state')} until {self._record.until:.2f} s, "
            f"arms {', '.join(self._record.arms)}>"
        )

    def _must_have(self, arm: str) -> None:
        if arm not in self._record.arms:
            hint = suggestion(arm, self._record.arms, "arm")
            raise ReplayError(f"there is no arm '{arm}'; {hint}")

    def _arm(self, name: str) -> ArmTrack:
        kinematics = self._kinematics
        count, dof = kinematics.q[name].shape
        rows = np.full((count, 4, dof), np.nan)
        for index in range(count):
            row = self._record.arm_row(name, index)
            if row is not None and len(row[0]) == dof:
                rows[index] = row
        tool = kinematics.tools[name]
        return ArmTrack(
            name,
            str(self._record.arms[name]["robot"]),
            kinematics.joints[name],
            kinematics.q[name],
            kinematics.v[name],
            rows[:, 0],
            rows[:, 1],
            rows[:, 2],
            rows[:, 3],
            tool[:, :3],
            tool[:, 3:],
            self._gripper(name),
            tuple(held_over_time(self._record, name)),
        )

    def _gripper(self, name: str) -> GripperTrack | None:
        kind = self._kinematics.grippers.get(name)
        if kind is None:
            return None
        rows = np.full((len(self.time), 7), np.nan)
        for index in range(len(rows)):
            state = self._record.gripper(name, index)
            if state is not None:
                rows[index] = [*vars(state).values()]
        return GripperTrack(kind, *rows.T)

    @cached_property
    def _kinematics(self) -> _Kinematics:
        """Everything that needs the models, in one pass over all states."""
        record = self._record
        count = len(record.times)
        found = _Kinematics({}, {}, {}, {}, {}, {})
        generation = None
        for index in range(count):
            moment = record.moment(index)
            if moment.generation != generation:
                generation = moment.generation
                model = record.model(generation)
                data = mujoco.MjData(model)
                bodies = [
                    (name, body)
                    for name in record.start["objects"]
                    if (body := mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)) >= 0
                ]
                arms = [*_arms_in(model, record.arms)]
                for name, joints, _ in arms:
                    found.begin(name, model, joints, count)
            data.qpos[:] = moment.qpos
            mujoco.mj_kinematics(model, data)
            for name, body in bodies:
                pose = found.objects.setdefault(name, np.full((count, 7), np.nan))
                pose[index, :3] = data.xpos[body]
                pose[index, 3:] = data.xquat[body]
            for name, joints, site in arms:
                found.q[name][index] = moment.qpos[model.jnt_qposadr[joints]]
                found.v[name][index] = moment.qvel[model.jnt_dofadr[joints]]
                found.tools[name][index, :3] = data.site_xpos[site]
                mujoco.mju_mat2Quat(found.tools[name][index, 3:], data.site_xmat[site])
        return found


def _arms_in(
    model: mujoco.MjModel, names: Iterable[str]
) -> Iterator[tuple[str, npt.NDArray[np.int64], int]]:
    """Yields the arms in a model: name, ids of the joints, id of the tool's site."""
    for name in names:
        site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"{name}/{TOOL_SITE}")
        if site >= 0:
            yield name, model.actuator_trnid[joint_motors(model, name), 0], int(site)


def _named(prefix: str, names: tuple[str, ...], values: Matrix) -> dict[str, Vector]:
    return {f"{prefix}{name}": column for name, column in zip(names, values.T, strict=True)}


def load(folder: str | os.PathLike[str], *, most_memory: int = MOST_MEMORY) -> RunData:
    """Read the record of a run as arrays.

    A record may come from an untrusted source: it is validated first, and no code is loaded from
    it.

    Args:
        folder: Folder that ``record`` or ``--record`` named.
        most_memory: Largest size of the record in memory, bytes.

    Raises:
        ReplayError: There is no such folder, or no record in it.
        HistoryError: A file is damaged or takes too much memory; the message states which and why.
        RunError: An argument is invalid.
    """
    # Absolute: images are read from it when they are asked for.
    path = checked_path(folder, "folder").absolute()
    if not isinstance(most_memory, Real) or isinstance(most_memory, bool) or not most_memory > 0:
        raise RunError(f"most_memory: {most_memory!r} is not a number of bytes above 0")
    return RunData(Record.read(path, int(most_memory)))
