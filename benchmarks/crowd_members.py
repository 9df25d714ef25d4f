"""Members of a generated cell: robots on their bases, their tasks, and the tree file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.robot_description import load_robot

_HEAD = """bt_dualarm: 1
name: crowd
world: {scene: empty, time_limit: 150}
"""
_OBJECT = """  cube_NAME:
    {shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, color: yellow, fixed: true, pose: POSE}
"""
_ARM = """  NAME:
    robot: ROBOT
    base: {xyz: XYZ, rpy: [0, 0, YAW]}
    limits: {velocity: SHARE, acceleration: SHARE, jerk: SHARE}
    EYEtree:
      sequence:
"""
_EYE = "camera: {mount: wrist, resolution: [160, 120], fov: 50, fps: 30}\n    "
_WAITING = ", give_way: true, patience: 30}"


@dataclass(frozen=True)
class Member:
    """One arm of a cell.

    Attributes:
        name: Name of the arm.
        robot: Name of the robot in the catalog.
        xyz: Position of the base, m.
        yaw: Yaw of the base, degrees.
        share: Share of the robot's limits that the arm may use.
        tasks: Leaves of its tree, as text.
        waits: Whether all tasks wait while another arm obstructs them.
        cube: Pose of the cube that its camera tracks, as text; empty for none.
    """

    name: str
    robot: str
    xyz: tuple[float, float, float]
    yaw: float
    share: float
    tasks: tuple[str, ...] = ()
    waits: bool = True
    cube: str = ""

    @property
    def kinematics(self) -> Kinematics:
        """Kinematics of the arm on its base."""
        base = Pose.from_rpy(self.xyz, (0.0, 0.0, float(np.radians(self.yaw))))
        return Kinematics(load_robot(self.robot), base)

    @property
    def text(self) -> str:
        """Declaration of the arm in a tree file."""
        values: dict[str, object] = {"NAME": self.name, "ROBOT": self.robot, "XYZ": list(self.xyz)}
        values |= {"YAW": self.yaw, "SHARE": self.share, "EYE": _EYE if self.cube else ""}
        text = _ARM
        for word, value in values.items():
            text = text.replace(word, str(value))
        return text + "".join(f"        - {task}\n" for task in self.tasks)


def file_text(members: Sequence[Member], cubes: Sequence[Member]) -> str:
    """A tree file with some arms, and the cubes that some arms track."""
    declarations = [
        _OBJECT.replace("NAME", one.name).replace("POSE", one.cube) for one in cubes if one.cube
    ]
    objects = "".join(("objects:\n", *declarations)) if declarations else ""
    return "".join((_HEAD, objects, "arms:\n", *(one.text for one in members)))


def tasks_of(member: Member, rng: np.random.Generator) -> tuple[tuple[str, ...], str]:
    """Two to four tasks; an arm that does not wait also draws curves and moves joints."""
    kinematics = member.kinematics
    robot = load_robot(member.robot)
    home = robot.postures["home"]
    limits = robot.limits
    tasks = []
    for _ in range(int(rng.integers(2, 5))):
        turn = rng.uniform(-1.0, 1.0, len(home)) * np.linspace(1.5, 0.5, len(home))
        q = np.clip(home + turn, limits.lower + 0.05, limits.upper - 0.05)
        speed = round(float(rng.uniform(0.2, 1.0)), 2)
        kind = (
            "reach" if member.waits else str(rng.choice(("reach", "turn", "circle", "lissajous")))
        )
        if kind == "turn":
            tasks.append(f"move_joints: {{to: {np.degrees(q).round(2).tolist()}, speed: {speed}}}")
            continue
        if kind == "reach" or not tasks:
            pose = kinematics.forward(q)
            to = {"xyz": pose.position.round(4).tolist(), "quat": pose.quaternion.tolist()}
            tasks.append(f"reach_to_pose: {{to: {to}, speed: {speed}{_WAITING}".replace("'", ""))
            continue
        plane = rng.choice(("xy", "yz", "xz"))
        size = "radius: 0.05" if kind == "circle" else "amplitudes: [0.05, 0.04]"
        tasks.append(f"{kind}: {{plane: {plane}, {size}, speed: {speed}}}")
    return tuple(tasks), ""


def tracking_tasks(member: Member) -> tuple[tuple[str, ...], str]:
    """Tasks of a Panda that tracks a cube in front of its camera, and the pose of the cube."""
    robot = load_robot(member.robot)
    tool = member.kinematics.forward(robot.postures["look_out"])
    turn = np.radians(member.yaw)
    ahead = np.array((np.cos(turn), np.sin(turn), 0.0))
    at = (tool.position + 0.45 * ahead).round(3).tolist()
    plane = "yz" if member.yaw in (0.0, 180.0) else "xz"
    look = f"reach_to_pose: {{posture: look_out{_WAITING}"
    track = f"track: {{color: yellow, plane: {plane}, duration: 4, wait: 3}}"
    return (look, track), f"{{xyz: {at}, rpy: [0, 0, {member.yaw}]}}"
