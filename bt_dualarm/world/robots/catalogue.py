"""The robot catalogue: one YAML file an arm, on top of its URDF.

The URDF is the only source of kinematics, inertia, position limits and efforts. The catalogue adds
what a URDF lacks: acceleration and jerk limits, postures, the tool frame, camera mounts.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from bt_dualarm.pose import Pose
from bt_dualarm.world.robots.arm_description import description_of
from bt_dualarm.world.robots.page import RobotEntry, RobotFile
from bt_dualarm.world.robots.page_path import is_page, page_path, shipped_names
from bt_dualarm.world.robots.robot import CameraMount, Flange, Robot


def robot_names() -> tuple[str, ...]:
    """Names of the arms in the shipped catalogue, sorted."""
    return shipped_names("robot")


def load_robot(name: str, root: Path | None = None) -> Robot:
    """An arm by its name in the catalogue, or by the path of a YAML file below ``root``.

    Raises:
        CatalogueError: No such arm, or its file is wrong; the message names file and entry.
    """
    path = page_path("robot", name, root)
    if is_page(name):
        return _read(path)
    state = path.stat()
    return _catalogued(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=64)
def _catalogued(path: Path, _changed: int, _size: int) -> Robot:
    """A shipped arm, read again only when its page has changed: its URDF is of a package."""
    robot = _read(path)
    for given in (robot.rotor_inertia, *robot.postures.values(), *vars(robot.limits).values()):
        if isinstance(given, np.ndarray):
            given.setflags(write=False)  # everybody has the same
    return robot


def _read(path: Path) -> Robot:
    file = RobotFile(path)
    entry, found = file.entry, description_of(file)
    return Robot(
        name=file.path.stem,
        title=entry.title,
        model=found.urdf,
        base_link=entry.base_link,
        tool_link=entry.tool.link,
        tool=entry.tool.pose,
        tool_shape=entry.tool.shape,
        flange=flange_of(entry),
        joints=entry.joints,
        limits=found.limits,
        payload=None if entry.payload is None else entry.payload.value,
        friction=found.friction,
        rotor_inertia=np.full(len(entry.joints), entry.rotor_inertia),
        postures={name: np.deg2rad(angles) for name, angles in entry.postures.items()},
        cameras={name: CameraMount(c.link, c.pose) for name, c in entry.cameras.items()},
        exclusions=found.exclusions,
        colors=entry.colors,
    )


def flange_of(entry: RobotEntry) -> Flange:
    """Where grippers are mounted: where the page says, else where the tool's shape begins."""
    if entry.flange is not None:
        return Flange(entry.flange.link, entry.flange.pose, entry.flange.stock)
    shape, tool = entry.tool.shape, entry.tool.pose
    length = 0.0 if shape is None else shape.length
    return Flange(entry.tool.link, tool @ Pose.from_rpy((0, 0, -length), (0, 0, 0)))
