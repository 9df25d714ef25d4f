"""What a tree file says of a world, held against its robots and its scene."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from bt_dualarm.errors import WorldError
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.world.names import must_be_among
from bt_dualarm.world.robots.robot import Robot


def check_declarations(
    file: TreeFile, robots: Mapping[str, Robot], names_in_scene: Collection[str]
) -> None:
    """Refuse at the start what would fail when a leaf spawns it an hour later.

    Args:
        file: Declares the arms and objects.
        robots: Robot of each arm, by the arm's name.
        names_in_scene: Names that the scene has taken.

    Raises:
        WorldError: A robot has no such posture or camera mount, or a name is taken.
    """
    for name, arm in file.arms.items():
        robot = robots[name]
        owner = f"of robot {robot.name!r} for arm {name!r}"
        must_be_among(arm.posture, robot.postures, "posture", owner)
        if arm.camera is not None and isinstance(arm.camera.mount, str):
            must_be_among(arm.camera.mount, robot.cameras, "camera mount", owner)
    for name in (*file.objects, *file.arms):
        if name in names_in_scene:
            scene = file.world.scene
            raise WorldError(f"{name!r} is the name of a part of the scene {scene!r} already")
