"""What of a compiled world is an arm's: its joints, its gripper, what the gripper holds."""

from __future__ import annotations

from typing import Literal, TypeAlias

import mujoco

from bt_dualarm.replay.record import Record, ReplayError
from bt_dualarm.spec.name import is_name
from bt_dualarm.world.grippers.gripper import FINGERS
from bt_dualarm.world.grippers.mjspec import CUP
from bt_dualarm.world.robots.mjspec import joint_motors

GripperKind: TypeAlias = Literal["fingers", "suction"]


def joints_of(model: mujoco.MjModel, arm: str, dof: int) -> list[int]:
    """Ids of an arm's own joints, base to tip; the fingers of its gripper are not among them.

    Raises:
        ReplayError: There are not as many as the record has numbers of.
    """
    joints: list[int] = model.actuator_trnid[joint_motors(model, arm), 0].tolist()
    if len(joints) != dof:
        raise ReplayError(
            f"the record has {dof} joints of {arm}, and {len(joints)} in its model: it is damaged"
        )
    return joints


def finger_joints(model: mujoco.MjModel, arm: str) -> list[int]:
    """Ids of the two joints of an arm's fingers; none where it has no fingers."""
    kind = mujoco.mjtObj.mjOBJ_JOINT
    found = [mujoco.mj_name2id(model, kind, f"{arm}/{finger}") for finger in FINGERS]
    return [joint for joint in found if joint >= 0]


def gripper_kind(model: mujoco.MjModel, arm: str) -> GripperKind | None:
    """Which kind of gripper an arm has; None without one, or where the arm is not in the model."""
    if finger_joints(model, arm):
        return "fingers"
    cup = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, f"{arm}/{CUP}")
    return None if cup < 0 else "suction"


def held_over_time(record: Record, arm: str) -> list[tuple[float, tuple[str, ...]]]:
    """What an arm was believed to hold, with its gripper or by a weld, each time that changed.

    Returns:
        Simulated time in s and the names of the objects, in the order of time; empty where nothing
        was ever held, and in records of versions that did not keep it.
    """
    return [
        (float(note["time_s"]), (*note["gripped"], *note["welded"]))
        for note in record.notes
        if note["kind"] == "holds" and note["arm"] == arm
    ]


def file_part(arm: str) -> str:
    """The name of an arm, for use in the name of a file.

    Raises:
        ReplayError: It is none that a tree file can give to an arm: the record was tampered with.
    """
    if not is_name(arm):
        raise ReplayError(f"the record names an arm {arm!r}, which no tree file can: not exported")
    return arm
