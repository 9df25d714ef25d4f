"""A record as messages over time: statuses, notes, joints, grippers, where every body was."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import mujoco

from bt_dualarm.pose import Vector
from bt_dualarm.replay.arm_parts import finger_joints, gripper_kind, held_over_time, joints_of
from bt_dualarm.replay.camera_messages import camera_frame, camera_messages
from bt_dualarm.replay.message import Message, timestamp
from bt_dualarm.replay.record import Facts, GripperState, Moment, Record
from bt_dualarm.replay.scene_messages import scene_messages
from bt_dualarm.world.nominal.camera_pose import camera_pose

_EVERY: Final = 2
"""States from one message of bodies to the next: 25 a second."""

_INFO, _ERROR = 2, 4  # levels of foxglove.Log


def messages_of(record: Record) -> list[Message]:
    """All messages, in the order of their times.

    ``/status`` has changes of status, ``/log`` the same for people; ``/ARM/ports``,
    ``/ARM/wrote``, ``/ARM/frame``, ``/ARM/look``, ``/ARM/found``, ``/ARM/holds`` and ``/ARM/guard``
    the notes; ``/ARM/joints`` where the joints were, those of fingers too, with the torques that
    were commanded, ``/ARM/set_point`` what was sent, in rad, s and N m (m and N of fingers);
    ``/ARM/gripper`` what a gripper sensed, was asked for and held; ``/bodies`` the poses of all
    bodies and cameras in the world, in m; ``/scene/…`` what they look like (`scene_messages`),
    ``/ARM/camera/…`` what `camera_messages` says.
    """
    found = [
        *_statuses(record),
        *_notes(record),
        *_joints(record),
        *_grippers(record),
        *_bodies(record),
        *scene_messages(record),
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
            if row is None:
                continue
            q, v, a, torque = ([float(f"{x:.7g}") for x in part] for part in row)
            moment = record.moment(index)
            model = record.model(moment.generation)
            joints = joints_of(model, arm, len(q))
            now = _measured(model, moment, joints, torque)
            sent = [
                {"name": joint["name"], "position": q[j], "velocity": v[j], "acceleration": a[j]}
                for j, joint in enumerate(now)
            ]
            fingers = finger_joints(model, arm)
            gripper = record.gripper(arm, index)  # of earlier versions: what the state has, no more
            grip = None if gripper is None else _rounded(gripper)
            now += _measured(
                model, moment, fingers, [grip["force_n"]] * len(fingers) if grip else None
            )
            if grip is not None:
                asked = grip["commanded_width_m"] / 2, grip["commanded_force_n"]
                sent += [
                    {"name": str(model.joint(joint).name), "position": asked[0], "effort": asked[1]}
                    for joint in fingers
                ]
            for topic, joints_now in ((f"/{arm}/joints", now), (f"/{arm}/set_point", sent)):
                content = {"timestamp": timestamp(time), "joints": joints_now}
                yield Message(topic, "foxglove.JointStates", time, content)


def _measured(
    model: mujoco.MjModel, moment: Moment, joints: Sequence[int], efforts: Sequence[float] | None
) -> list[Facts]:
    """Name, position, velocity and effort, where it is known, as `foxglove.JointState`."""
    at, to = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
    where, how = moment.qpos[at].round(9).tolist(), moment.qvel[to].round(9).tolist()
    found: list[Facts] = [
        {"name": str(model.joint(joint).name), "position": q, "velocity": v}
        for joint, q, v in zip(joints, where, how, strict=True)
    ]
    if efforts is not None:
        found = [{**joint, "effort": effort} for joint, effort in zip(found, efforts, strict=True)]
    return found


def _grippers(record: Record) -> Iterator[Message]:
    """What each gripper sensed, was asked for, and was believed to hold."""
    for arm in record.arms:
        changes = held_over_time(record, arm)
        held: tuple[str, ...] = ()
        for index, time in enumerate(record.times.tolist()):
            while changes and changes[0][0] <= time + 1e-9:
                held = changes.pop(0)[1]
            state = record.gripper(arm, index)
            if state is not None:
                kind = gripper_kind(record.model(record.moment(index).generation), arm)
                content = {"time_s": time, "takes_by": kind, **_rounded(state), "held": [*held]}
                yield Message(f"/{arm}/gripper", "bt_dualarm.Gripper", time, content)


def _rounded(state: GripperState) -> dict[str, float]:
    """Numbers of a gripper by name and unit, as exact as the record has them."""
    named = {
        "width_m": state.width,
        "speed_m_s": state.speed,
        "force_n": state.force,
        "vacuum": state.vacuum,
        "commanded_width_m": state.commanded_width,
        "commanded_speed_m_s": state.commanded_speed,
        "commanded_force_n": state.commanded_force,
    }
    return {name: float(f"{value:.7g}") for name, value in named.items()}


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
