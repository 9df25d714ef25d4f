"""Going somewhere with something in the gripper, and seeing all the way that it stays there."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import Final

from bt_dualarm.arm.arm import Arm
from bt_dualarm.errors import Failure, Number
from bt_dualarm.pose import Pose
from bt_dualarm.skill.grip import Grip

_HELD_S: Final = 1.0  # that fingers may take to come to rest


def held_through(
    arm: Arm, going: Iterator[float | None]
) -> Generator[float | None, None, dict[str, Number]]:
    """Go, and look once a tick at what fingers or a cup of this arm hold; yields the progress.

    Args:
        arm: Arm that moves.
        going: Its motion; where the gripper holds nothing that is all there is.

    Returns:
        ``slid_m``: how far what is held moved in the tool, by the truth; ``slips_felt`` and
        ``grip_force_n`` where pulls were answered; nothing if nothing is held.

    Raises:
        Failure: ``SLIPPED`` or ``DROPPED`` by what the gripper senses; what the motion raises.
    """
    held = arm.world.attachments.gripped_by(arm.name)
    if not held:
        yield from going
        return {}
    name = held[0].object  # a gripper holds one thing
    grip, began_at, felt = Grip(arm, name), _true_place(arm, name), arm.slips_felt
    yield from _watched(going, grip)
    yield from _at_rest(arm, grip, name)
    found: dict[str, Number] = {"slid_m": _true_place(arm, name).distance(began_at)}
    if arm.slips_felt > felt:
        found |= {"slips_felt": arm.slips_felt - felt}
        found |= {"grip_force_n": arm.gripper.commanded.force}
    return found


def _watched(going: Iterator[float | None], grip: Grip) -> Iterator[float | None]:
    grip.look()
    try:
        for progress in going:
            yield progress
            grip.look()
    except Failure as failure:
        if failure.code == "SLIPPED":
            yield from grip.judge(failure)
        raise


def _at_rest(arm: Arm, grip: Grip, name: str) -> Iterator[float]:
    """Wait until the fingers stand and press again."""
    began = arm.time
    while not arm.gripper.holding:
        yield 1.0
        grip.look()
        if arm.time - began > _HELD_S:
            raise Failure("DROPPED", f"{name!r} is no longer held")


def _true_place(arm: Arm, name: str) -> Pose:
    """Where the object truly is in the tool, as far as encoders tell where that is."""
    return arm.tool_pose.inverse @ arm.world.object_pose(name)
