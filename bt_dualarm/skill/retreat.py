"""Straight retreats of an open hand from a placed object."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.motions import ArmMotions
from bt_dualarm.arm.past_others import PastOthers
from bt_dualarm.arm.payload import jaw_measures
from bt_dualarm.collision.checker import contact_of_links
from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.core.pose import Matrix, Pose
from bt_dualarm.trajectory.trajectory import Trajectory

_BESIDE_LINKS_M: Final = 0.003  # clearance of the arm's links from it
_BESIDE_M: Final = 0.005  # clearance of fingertips or lip from the placed object


def is_beyond(arm: Arm, name: str, object_pose: Pose) -> bool:
    """Whether an object at a pose in the world reaches neither between the pads nor to the cup."""
    return _distance_beyond(arm, name, arm.tool_pose.inverse @ object_pose) > _BESIDE_M


def _distance_beyond(arm: Arm, name: str, in_tool: Pose) -> float:
    """Distance of an object beyond the fingertips or the cup along the tool's axis, m.

    Args:
        arm: Arm with the gripper.
        name: Name of the object.
        in_tool: Pose of the object in the tool's frame.

    Returns:
        The distance; negative if the object reaches between the fingers.
    """
    declared = arm.world.objects[name]
    description = arm.gripper.description
    back = in_tool.rotation_matrix.T @ np.array((0.0, 0.0, -1.0))
    nearest = float(in_tool.position[2]) - arm.world.object_solid(name).reach(back)
    return nearest - (
        jaw_measures(description, declared.friction).tip if description.fingers else 0.0
    )


_SPARE_M: Final = 0.005  # by which a shorter retreat is longer than the object requires

_COMES_FREE: Final = 0.5  # share of a motion straight up that must be along the tool's axis
_VERTICAL: Final = 0.999  # the same for a tool that points straight down: it is all of it
_HORIZONTAL: Final = 0.1  # sine of the slope up to which fingers close horizontally


@dataclass(frozen=True, eq=False)
class RetreatTo:
    """Straight retreat of the open hand from a placed object.

    Attributes:
        end: Pose of the tool in the world at its end.
        length: Its length along the tool's axis, m.
        name: Name of the object.
        object_pose: Pose of the object in the world.
        by_object: Whether the hand could touch the object, so that it has to be checked against it.
    """

    end: Pose
    length: float
    name: str
    object_pose: Pose
    by_object: bool = False

    def refuse_links(self, arm: ArmMotions, rows: Matrix) -> None:
        """Check that no link of the arm touches the object that the hand leaves.

        Args:
            arm: The arm.
            rows: Configurations of the retreat, of shape (n, dof), rad.

        Raises:
            Failure: ``IN_COLLISION``.
        """
        if arm.world.objects[self.name].is_free:
            contact = contact_of_links(
                arm.world, arm.name, self.name, self.object_pose, rows, _BESIDE_LINKS_M
            )
            if contact is not None:
                raise contact.failure()


def possible_retreats(
    arm: Arm, tool: Pose, name: str, in_tool: Pose, asked: float
) -> list[RetreatTo]:
    """Retreats of an open hand from an object, in the order in which to try them.

    After the one requested they are straight up, where the fingers close horizontally and come
    free, and along the tool's axis only as far as frees the object.

    Args:
        arm: Arm with the gripper.
        tool: Pose of the tool in the world.
        name: Name of the object.
        in_tool: Pose of the object in the tool's frame.
        asked: Length of the retreat that is requested, m.
    """
    axes = tool.rotation_matrix
    there = name, tool @ in_tool
    found = [RetreatTo(tool @ Pose.from_rpy((0.0, 0.0, -asked)), asked, *there)]
    comes_free = -float(axes[2, 2])
    if (
        arm.gripper.description.fingers
        and _COMES_FREE < comes_free < _VERTICAL
        and abs(axes[2, 1]) < _HORIZONTAL
    ):
        found.append(RetreatTo(tool.raised(asked), comes_free * asked, *there, by_object=True))
    beyond = _distance_beyond(arm, name, in_tool)
    shortest = _SPARE_M + max(_BESIDE_M - beyond, 0.0)
    if shortest < asked:
        found.append(RetreatTo(tool @ Pose.from_rpy((0.0, 0.0, -shortest)), shortest, *there))
    return found


def plan_retreat(
    move: PastOthers, retreats: Sequence[RetreatTo], metrics: dict[str, Number]
) -> Generator[None, None, Trajectory]:
    """Plan the first possible retreat; yields once per tick.

    Args:
        move: Motion of the arm, which may touch the object.
        retreats: Retreats to try, see `possible_retreats`.
        metrics: Metrics of the leaf; get the length of the retreat if it is not the first one.

    Raises:
        Failure: That of the last retreat, or of one that another arm blocks: as planning.
    """
    arm = move.arm
    for retreat in retreats:
        try:
            rows = arm.line_on(retreat.end)
            yield from move.checked(rows, known_free=False)
            retreat.refuse_links(arm, rows)
            if retreat.by_object:
                arm.refuse_collision_along(rows)
            motion = arm.time_path(rows, move.speed)
        except Failure as failure:
            if retreat is retreats[-1] or move.may_clear(failure):
                raise
        else:
            if retreat is not retreats[0]:
                metrics["retreated_m"] = retreat.length
            break
    return motion
