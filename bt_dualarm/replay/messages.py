"""A record as messages over time: statuses, notes, joints, and where every body was."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import mujoco

from bt_dualarm.pose import Vector
from bt_dualarm.replay.camera_messages import camera_frame, camera_messages
from bt_dualarm.replay.message import Message, timestamp
from bt_dualarm.replay.record import Facts, Record
from bt_dualarm.world.nominal.camera_pose import camera_pose
from bt_dualarm.world.robots.mjspec import joint_motors

_EVERY: Final = 2
"""States from one message of bodies to the next: 25 a second."""

_INFO, _ERROR = 2, 4  # levels of foxglove.Log


def messages_of(record: Record) -> list[Message]:
    """All messages, in the order of their times.

    ``/status`` has changes of status, ``/log`` the same for people; ``/ARM/ports``,
    ``/ARM/wrote``, ``/ARM/frame``, ``/ARM/look``, ``/ARM/found`` and ``/ARM/guard`` the notes;
    ``/ARM/joints`` where the joints were, with the torques that were commanded,
    ``/ARM/set_point`` what was sent, in rad, s and N m; ``/bodies`` the poses of all bodies and
    cameras in the world, in m; ``/ARM/camera/…`` what `camera_messages` says.
    """
    found = [
        *_statuses(record),
        *_notes(record),
        *_joints(record),
        *_bodies(record),
        *camera_messages(record),
    ]
    return sorted(found, key=lambda message: message.time_s)


def _statuses(record: Record) -> Iterator[Message]:
    for event in record.events:
        time = float(event["time_s"])
        yield Message("/status", "bt_dualarm.StatusChange", time, event)
        said = ": ".join(filter(None, (event["new"], event["code"], event["reason"])))
        content = {
            "timestamp": timestamp(time),
            "level": _ERROR if event["new"] == "FAILURE" else _INFO,
            "message": said,
            "name": f"{event['arm']}:{event['path']}",
            "file": "",
            "line": 0,
        }
        yield Message("/log", "foxglove.Log", time, content)


def _notes(record: Record) -> Iterator[Message]:
    for note in record.notes:
        kind, arm = note["kind"], note["arm"]
        content = {name: value for name, value in note.items() if name not in ("kind", "arm")}
        schema = f"bt_dualarm.{str(kind).capitalize()}"
        yield Message(f"/{arm}/{kind}", schema, float(note["time_s"]), content)


def _joints(record: Record) -> Iterator[Message]:
    """Measured and sent: by the model's own names, as `foxglove.JointStates`."""
    for arm in record.arms:
        for index, time in enumerate(record.times.tolist()):
            row = record.arm_row(arm, index)
            if row is not None:
                q, v, a, torque = ([float(f"{x:.7g}") for x in part] for part in row)
                moment = record.moment(index)
                model = record.model(moment.generation)
                joints = joints_of(model, arm)
                at, to = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
                names = [str(model.joint(joint).name) for joint in joints]
                where, how = moment.qpos[at].round(9).tolist(), moment.qvel[to].round(9).tolist()
                now = {"position": where, "velocity": how, "effort": torque}
                sent = {"position": q, "velocity": v, "acceleration": a}
                yield _states(f"/{arm}/joints", time, names, now)
                yield _states(f"/{arm}/set_point", time, names, sent)


def _states(
    topic: str, time: float, names: Sequence[str], values: Mapping[str, Sequence[float]]
) -> Message:
    joints = [
        {"name": name, **{what: each[place] for what, each in values.items()}}
        for place, name in enumerate(names)
    ]
    content = {"timestamp": timestamp(time), "joints": joints}
    return Message(topic, "foxglove.JointStates", time, content)


def joints_of(model: mujoco.MjModel, arm: str) -> list[int]:
    """Numbers of an arm's joints in the model, base to tip; a gripper's are none of them."""
    joints: list[int] = model.actuator_trnid[joint_motors(model, arm), 0].tolist()
    return joints


def _bodies(record: Record) -> Iterator[Message]:
    model, data = None, None
    for index in range(0, len(record.times), _EVERY):
        moment = record.moment(index)
        if model is not record.model(moment.generation) or data is None:
            model = record.model(moment.generation)
            data = mujoco.MjData(model)
        data.qpos[:] = moment.qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        poses = [
            (str(model.body(body).name), data.xpos[body], data.xquat[body])
            for body in range(1, model.nbody)
        ]
        for arm in record.arms:
            camera = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, camera_frame(arm))
            if camera >= 0:
                pose = camera_pose(data, camera)
                poses.append((camera_frame(arm), pose.position, pose.quaternion))
        transforms = [_transform(name, place, turn, moment.time) for name, place, turn in poses]
        content: Facts = {"transforms": transforms}
        yield Message("/bodies", "foxglove.FrameTransforms", moment.time, content)


def _transform(name: str, position: Vector, quaternion: Vector, time: float) -> Facts:
    x, y, z = position.round(6).tolist()
    w, i, j, k = quaternion.round(6).tolist()
    return {
        "timestamp": timestamp(time),
        "parent_frame_id": "world",
        "child_frame_id": name,
        "translation": {"x": x, "y": y, "z": z},
        "rotation": {"x": i, "y": j, "z": k, "w": w},
    }
