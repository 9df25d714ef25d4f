"""One run as an episode of a LeRobot data set: its features, numbers frame by frame, pictures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.replay.arm_parts import (
    GripperKind,
    file_part,
    gripper_kind,
    joints_of,
)
from bt_dualarm.replay.record import Facts, Moment, Record, ReplayError
from bt_dualarm.replay.video import Picture
from bt_dualarm.world.rendering.raycast import RayRenderer
from bt_dualarm.world.rendering.renderer import Exposure

FPS: Final = 25
"""Frames a second: every second state that is kept."""

STATE: Final = "observation.state"
"""Positions of joints in rad, openings of grippers in m, a cup's share of the full vacuum."""

VELOCITY: Final = "observation.velocity"
"""Velocities of joints in rad/s, speeds of openings in m/s."""

EFFORT: Final = "observation.effort"
"""Commanded torques of joints in N m, sensed forces of grippers in N."""

ACTION: Final = "action"
"""Set-points of joints in rad; of two fingers the opening (m), its speed (m/s) and force (N) that
were asked for; of a cup the force in N, 0 to let go."""

OBJECTS: Final = "observation.environment_state"
"""Poses of all objects that can move: place in m, quaternion (w, x, y, z)."""

DONE: Final = "next.done"
SUCCESS: Final = "next.success"

_POSE: Final = ("x", "y", "z", "qw", "qx", "qy", "qz")

Columns: TypeAlias = dict[str, npt.NDArray[np.generic]]


@dataclass(frozen=True, eq=False)
class CameraView:
    """What one camera has before it in all frames: whole pictures without noise.

    Attributes:
        record: The record.
        arm: Name of the camera's arm.
        width: Width in pixels, even: H.264 in 4:2:0 has no odd ones.
        height: Height in pixels, even.
        moments: The run in each frame.
    """

    record: Record
    arm: str
    width: int
    height: int
    moments: Sequence[Moment]

    def pictures(self) -> Iterator[Picture]:
        """A picture for each frame, of shape (height, width, 3); black without the camera."""
        renderer, model, data = RayRenderer(), None, None
        for moment in self.moments:
            if model is not self.record.model(moment.generation) or data is None:
                model = self.record.model(moment.generation)
                data = mujoco.MjData(model)
                kind = mujoco.mjtObj.mjOBJ_CAMERA
                camera = mujoco.mj_name2id(model, kind, f"{self.arm}/camera")
            if camera < 0:
                yield np.zeros((self.height, self.width, 3), np.uint8)
                continue
            data.qpos[:] = moment.qpos
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            yield renderer.render(model, data, Exposure(camera, self.width, self.height))


@dataclass(frozen=True, eq=False)
class Episode:
    """A run as the frames of a demonstration.

    Attributes:
        task: What it shows, in words.
        succeeded: Whether the run did.
        robots: Robot and gripper of each arm, in words, in the order of the file.
        columns: Numbers of all frames by feature, each of shape (frames, n).
        names: What the n numbers of a feature are, where n is not 1.
        views: What each camera has before it, by feature.
    """

    task: str
    succeeded: bool
    robots: str
    columns: Columns
    names: Mapping[str, Sequence[str]]
    views: Mapping[str, CameraView]

    @property
    def length(self) -> int:
        """Number of frames."""
        return len(self.columns[ACTION])

    @property
    def features(self) -> dict[str, Facts]:
        """What ``meta/info.json`` says of each feature."""
        found: dict[str, Any] = {}
        for name, values in self.columns.items():
            names = self.names.get(name)
            shape = [values.shape[1]]
            found[name] = {
                "dtype": str(values.dtype),
                "shape": shape,
                "names": None if names is None else list(names),
            }
        for name, view in self.views.items():
            found[name] = {
                "dtype": "video",
                "shape": [view.height, view.width, 3],
                "names": ["height", "width", "channels"],
                "info": {
                    "video.height": view.height,
                    "video.width": view.width,
                    "video.codec": "h264",
                    "video.pix_fmt": "yuv420p",
                    "video.is_depth_map": False,
                    "video.fps": FPS,
                    "video.channels": 3,
                    "has_audio": False,
                },
            }
        return found


def episode_of(record: Record) -> Episode:
    """A record as an episode.

    An arm or object that is not in the world yet has zeros; of one that was removed the last values
    stay.

    Raises:
        ReplayError: The record has no state, or does not say what its grippers did: it is of an
            earlier version.
    """
    if not len(record.times):
        raise ReplayError(f"{record.folder} holds no state")
    count = int((record.until - record.times[0]) * FPS) + 1
    times = record.times[0] + np.arange(count) / FPS
    rows = [record.index_at(time) for time in times.tolist()]
    moments = tuple(map(record.moment, rows))
    names: dict[str, list[str]] = {name: [] for name in (STATE, VELOCITY, EFFORT, ACTION)}
    parts: dict[str, list[npt.NDArray[np.float64]]] = {name: [] for name in names}
    for arm in record.arms:
        for name, (own, values) in _of_arm(record, arm, rows, moments).items():
            names[name] += own
            parts[name].append(values)
    columns: Columns = {
        name: np.concatenate(each, axis=1).astype(np.float32) for name, each in parts.items()
    }
    objects = [name for name, facts in record.start["objects"].items() if not facts.get("fixed")]
    if objects:
        names[OBJECTS] = [f"{thing}.{part}" for thing in objects for part in _POSE]
        columns[OBJECTS] = _objects(record, objects, moments).astype(np.float32)
    succeeded = record.summary is not None and record.summary.get("outcome") == "SUCCESS"
    is_last = np.arange(count)[:, None] == count - 1
    columns |= {DONE: is_last, SUCCESS: is_last & succeeded}
    views = {}
    for arm, facts in record.arms.items():
        if facts.get("camera"):
            width, height = (int(side) // 2 * 2 for side in facts["camera"]["resolution"])
            view = CameraView(record, arm, width, height, moments)
            views[f"observation.images.{file_part(arm)}"] = view
    robots = [
        f"{facts['robot']} with {facts['gripper']}" if facts.get("gripper") else str(facts["robot"])
        for facts in record.arms.values()
    ]
    task = record.name.replace("_", " ")
    return Episode(task, succeeded, "+".join(robots), columns, names, views)


def _of_arm(
    record: Record, arm: str, rows: Sequence[int], moments: Sequence[Moment]
) -> dict[str, tuple[list[str], npt.NDArray[np.float64]]]:
    """Names and numbers of an arm and its gripper by feature, of shape (frames, n)."""
    arm = file_part(arm)  # names become parts of columns
    sent = [record.arm_row(arm, row) for row in rows]
    known = next(((at, row) for at, row in enumerate(sent) if row is not None), None)
    if known is None:
        return {name: ([], np.zeros((len(rows), 0))) for name in (STATE, VELOCITY, EFFORT, ACTION)}
    model, dof = record.model(moments[known[0]].generation), len(known[1][0])
    kind = gripper_kind(model, arm)
    joints = [str(model.joint(j).name).replace("/", ".") for j in joints_of(model, arm, dof)]
    grip = f"{arm}.gripper"
    names = {
        STATE: {"fingers": [f"{grip}.width"], "suction": [f"{grip}.vacuum"]},
        VELOCITY: {"fingers": [f"{grip}.speed"], "suction": []},
        EFFORT: {"fingers": [f"{grip}.force"], "suction": [f"{grip}.force"]},
        ACTION: {
            "fingers": [f"{grip}.{what}" for what in ("width", "speed", "force")],
            "suction": [f"{grip}.force"],
        },
    }
    own = {name: joints + (by_kind[kind] if kind else []) for name, by_kind in names.items()}
    found = {name: np.zeros((len(rows), len(each))) for name, each in own.items()}
    for number, (row, moment, arm_row) in enumerate(zip(rows, moments, sent, strict=True)):
        if arm_row is None:
            for values in found.values():
                values[number] = values[number - 1] if number else 0.0
            continue
        model = record.model(moment.generation)
        ids = joints_of(model, arm, dof)
        gripper = _gripper_numbers(record, arm, row, kind)
        joint_numbers = {
            STATE: moment.qpos[model.jnt_qposadr[ids]],
            VELOCITY: moment.qvel[model.jnt_dofadr[ids]],
            EFFORT: arm_row[3],
            ACTION: arm_row[0],
        }
        for name, values in found.items():
            values[number] = [*joint_numbers[name], *gripper[name]]
    return {name: (own[name], found[name]) for name in own}


def _gripper_numbers(
    record: Record, arm: str, row: int, kind: GripperKind | None
) -> dict[str, list[float]]:
    """What a gripper adds to each feature."""
    if kind is None:
        return {STATE: [], VELOCITY: [], EFFORT: [], ACTION: []}
    state = record.gripper(arm, row)
    if state is None:
        raise ReplayError(
            f"{record.folder} does not say what the gripper of {arm} did: it was recorded by an "
            "earlier version; run its tree again with --record"
        )
    if kind == "fingers":
        asked = [state.commanded_width, state.commanded_speed, state.commanded_force]
        return {STATE: [state.width], VELOCITY: [state.speed], EFFORT: [state.force], ACTION: asked}
    sucks = state.commanded_width <= 0.0
    asked = [state.commanded_force if sucks else 0.0]
    return {STATE: [state.vacuum], VELOCITY: [], EFFORT: [state.force], ACTION: asked}


def _objects(
    record: Record, objects: Sequence[str], moments: Sequence[Moment]
) -> npt.NDArray[np.float64]:
    """Poses of objects in each frame, of shape (frames, 7 n)."""
    found = np.zeros((len(moments), len(objects), len(_POSE)))
    for number, moment in enumerate(moments):
        model = record.model(moment.generation)
        for place, name in enumerate(objects):
            body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
            joint = int(model.body_jntadr[body]) if body >= 0 else -1
            if joint >= 0:
                address = int(model.jnt_qposadr[joint])
                found[number, place] = moment.qpos[address : address + len(_POSE)]
            elif number:
                found[number, place] = found[number - 1, place]
    return found.reshape(len(moments), -1)


def differences(features: Facts, others: Facts) -> list[str]:
    """Sentences on what of some features is not that of others, as ``meta/info.json`` has them."""
    found = []
    for name in sorted(features.keys() | others.keys()):
        ours, theirs = features.get(name), others.get(name)
        if ours is None or theirs is None:
            found.append(f"{'it has no' if ours is None else 'it alone has'} {name}")
        elif ours.get("names") != theirs.get("names"):
            lacks = [one for one in theirs["names"] or () if one not in (ours["names"] or ())]
            more = [one for one in ours["names"] or () if one not in (theirs["names"] or ())]
            said = [f"lacks {_listed(lacks)}"] if lacks else []
            said += [f"has {_listed(more)} besides"] if more else []
            found.append(f"its {name} {' and '.join(said) or 'is in another order'}")
        elif (ours["dtype"], ours["shape"]) != (theirs["dtype"], theirs["shape"]):
            found.append(
                f"its {name} is {ours['dtype']} of shape {ours['shape']}, "
                f"not {theirs['dtype']} of shape {theirs['shape']}"
            )
    return found


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return f"{', '.join(names[:3])}{more}"
