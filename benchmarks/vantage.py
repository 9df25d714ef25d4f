"""Postures in which an arm's wrist camera faces a plane, and robot descriptions with them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np
import yaml

from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.core.share import share_dir
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ArmSpec, TreeFile, WorldSpec
from bt_dualarm.spec.node_types import NodeSpec
from bt_dualarm.spec.values import PoseSpec

BASE = ((0.0, 0.0, 1.5), (0.0, 10.0, 0.0))
"""Base of the arm, xyz in m and rpy in degrees: above the floor; tilted, so without a pedestal."""

POSTURE = "vantage"
"""Name of the posture in the robot description."""

_TRIES = 40
_ROOM = 0.3  # distance of the joints from their limits, rad
_REACH = (0.35, 0.75)  # shares of the largest distance from the first joint
_AROUND_M = 0.12  # offset to each side at which the camera pose has to be free, too
_CLEAR_M = 0.5  # free distance in front of the camera
_VIEW = tuple((x, y) for x in (-0.08, 0.0, 0.08) for y in (-0.08, 0.0, 0.08))  # m, at that depth
_ARM = "arm1"
_MOUNT = "wrist"


@dataclass(frozen=True, eq=False)
class Vantage:
    """A posture in which an arm's wrist camera looks along a direction.

    Attributes:
        robot: Name of the robot in the catalog.
        q: Joint angles, of shape (dof,), rad.
        camera: Pose of the camera in the world.
        condition: Largest condition number of the Jacobian there and to every side of it.
    """

    robot: str
    q: Vector
    camera: Pose
    condition: float

    def ahead(self, distance: float) -> Vector:
        """Point in the middle of the image at a distance, of shape (3,), m."""
        return self.camera.position + distance * self.camera.turn(np.array((0.0, 0.0, 1.0)))

    def write_description(self, folder: Path) -> str:
        """Write a robot description with this posture to a folder; returns its file name."""
        shipped = share_dir("assets") / "robots" / f"{self.robot}.yaml"
        description = yaml.safe_load(shipped.read_text(encoding="utf-8"))
        description["postures"][POSTURE] = np.degrees(self.q).tolist()
        name = f"{self.robot}_{POSTURE}.yaml"
        (folder / name).write_text(yaml.safe_dump(description), encoding="utf-8")
        return name


@lru_cache(maxsize=64)
def vantage(robot: str, normal: tuple[float, float, float], seed: int = 0) -> Vantage:
    """The best conditioned of some random postures in which an arm looks along a unit vector.

    Raises:
        Failure: ``OUT_OF_REACH`` if none of them is free and within reach.
    """
    rng = np.random.default_rng(seed)
    arm_alone = _ArmAlone(robot)
    found = (arm_alone.try_one(np.array(normal), rng) for _ in range(_TRIES))
    fit = [one for one in found if one is not None]
    if not fit:
        reason = f"{robot} looks along {normal} from none of {_TRIES} random places"
        raise Failure("OUT_OF_REACH", reason)
    return min(fit, key=lambda one: one.condition)


class _ArmAlone:
    """One arm alone in a world."""

    def __init__(self, robot: str) -> None:
        xyz, rpy = BASE
        tree = NodeSpec(kind="succeed", name="succeed", ports={})
        arm = ArmSpec(robot=robot, base=PoseSpec(xyz=xyz, rpy=rpy), tree=tree)
        self.robot = load_robot(robot)
        file = TreeFile(
            name=robot,
            world=WorldSpec(scene="empty"),
            objects={},
            arms={_ARM: arm},
            path=Path(f"{robot}.yaml"),
        )
        world = World(file)
        self.kinematics = Kinematics(self.robot, world.arms[_ARM].base)
        self.checker = CollisionChecker(world, _ARM)
        self.home = self.robot.postures["home"]
        mount = self.robot.cameras[_MOUNT]
        tool = self.kinematics.matrix(self.home)
        camera = self.kinematics.frame(mount.link) @ mount.pose.matrix
        self.camera_in_tool = np.linalg.inv(tool) @ camera

    def try_one(self, normal: Vector, rng: np.random.Generator) -> Vantage | None:
        """A random pose of the camera; None if it or a pose beside it is not feasible."""
        center, reach = self.kinematics.bounding_ball
        offset = rng.normal(size=3)
        offset *= rng.uniform(*_REACH) * reach / np.linalg.norm(offset)
        camera = _looking(center + offset, normal, rng.uniform(-np.pi, np.pi))
        q = self._configuration(camera, self.home)
        if q is None:
            return None
        worst = self.kinematics.condition(q)
        for side in (camera[:3, 0], -camera[:3, 0], camera[:3, 1], -camera[:3, 1]):
            moved = camera.copy()
            moved[:3, 3] += _AROUND_M * side
            beside = self._configuration(moved, q)
            if beside is None or np.abs(beside - q).max() > 1.0:
                return None
            worst = max(worst, self.kinematics.condition(beside))
        return Vantage(self.robot.name, q, Pose.from_matrix(camera), worst)

    def _configuration(self, camera: Matrix, near: Vector) -> Vector | None:
        target = Pose.from_matrix(camera @ np.linalg.inv(self.camera_in_tool))
        try:
            q = self.kinematics.solve(target, near)
        except Failure:
            return None
        fits = self.kinematics.room(q) > _ROOM and self.checker.free(q) and self._sees(camera)
        return q if fits else None

    def _sees(self, camera: Matrix) -> bool:
        """Whether the arm in the checker's configuration is out of the camera's view."""
        hit = np.full(1, -1, np.int32)
        for x, y in _VIEW:
            ray = camera[:3, :3] @ np.array((x, y, _CLEAR_M))
            share = mujoco.mj_ray(
                *(self.checker.model, self.checker.data, camera[:3, 3], ray, None, 1, -1, hit)
            )
            if 0.0 <= share <= 1.0:
                return False
        return True


def _looking(position: Vector, along: Vector, roll: float) -> Matrix:
    """Pose of a camera that looks along a unit vector, of shape (4, 4)."""
    aside = np.eye(3)[int(np.argmin(np.abs(along)))]
    right = np.cross(along, aside)
    right /= np.linalg.norm(right)
    down = np.cross(along, right)
    pose = np.eye(4)
    pose[:3, 0] = np.cos(roll) * right + np.sin(roll) * down
    pose[:3, 1] = np.cross(along, pose[:3, 0])
    pose[:3, 2] = along
    pose[:3, 3] = position
    return pose
