"""A record as messages over time: statuses, notes, joints, and where every body was."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import mujoco

from bt_dualarm.replay.record import Facts, Record

_EVERY: Final = 2
"""States from one message of bodies to the next: 25 a second."""


@dataclass(frozen=True)
class Message:
    """One message.

    Attributes:
        topic: Name of its channel.
        schema: Name of what it says; viewers know those that begin with ``foxglove.``.
        time_s: Simulated time in s.
        content: Fields, ready for JSON.
    """

    topic: str
    schema: str
    time_s: float
    content: Mapping[str, object]

    @property
    def nanoseconds(self) -> int:
        """Simulated time in ns."""
        return round(1e9 * self.time_s)


def messages_of(record: Record) -> list[Message]:
    """All messages, in the order of their times.

    ``/status`` has changes of status, ``/ARM/ports``, ``/ARM/wrote``, ``/ARM/frame``, ``/ARM/look``
    and ``/ARM/guard`` the notes, ``/ARM/joints`` set-points and torques in rad, s and N m,
    ``/bodies`` the poses of all bodies in the world, in m, as Foxglove's frame transforms.
    """
    found = [*_statuses(record), *_notes(record), *_joints(record), *_bodies(record)]
    return sorted(found, key=lambda message: message.time_s)


def _statuses(record: Record) -> Iterator[Message]:
    for event in record.events:
        yield Message("/status", "bt_dualarm.StatusChange", float(event["time_s"]), event)


def _notes(record: Record) -> Iterator[Message]:
    for note in record.notes:
        kind, arm = note["kind"], note["arm"]
        content = {name: value for name, value in note.items() if name not in ("kind", "arm")}
        schema = f"bt_dualarm.{str(kind).capitalize()}"
        yield Message(f"/{arm}/{kind}", schema, float(note["time_s"]), content)


def _joints(record: Record) -> Iterator[Message]:
    names = ("position", "velocity", "acceleration", "torque")
    for arm in record.arms:
        for index, time in enumerate(record.times.tolist()):
            row = record.arm_row(arm, index)
            if row is not None:
                content = {
                    name: [float(f"{x:.7g}") for x in part]
                    for name, part in zip(names, row, strict=True)
                }
                yield Message(f"/{arm}/joints", "bt_dualarm.Joints", time, content)


def _bodies(record: Record) -> Iterator[Message]:
    model, data = None, None
    for index in range(0, len(record.times), _EVERY):
        moment = record.moment(index)
        if model is not record.model(moment.generation) or data is None:
            model = record.model(moment.generation)
            data = mujoco.MjData(model)
        data.qpos[:] = moment.qpos
        mujoco.mj_kinematics(model, data)
        transforms = [_transform(model, data, body, moment.time) for body in range(1, model.nbody)]
        content: Facts = {"transforms": transforms}
        yield Message("/bodies", "foxglove.FrameTransforms", moment.time, content)


def _transform(model: mujoco.MjModel, data: mujoco.MjData, body: int, time: float) -> Facts:
    x, y, z = data.xpos[body].round(6).tolist()
    w, i, j, k = data.xquat[body].round(6).tolist()
    nanoseconds = round(1e9 * time)
    return {
        "timestamp": {"sec": nanoseconds // 10**9, "nsec": nanoseconds % 10**9},
        "parent_frame_id": "world",
        "child_frame_id": str(model.body(body).name),
        "translation": {"x": x, "y": y, "z": z},
        "rotation": {"x": i, "y": j, "z": k, "w": w},
    }
