"""Columns of the interaction matrix: the tree files to which all operations are applied."""

from __future__ import annotations

import itertools
import json
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
import yaml

from bt_dualarm.core.pose import Pose
from bt_dualarm.core.share import share_dir
from bt_dualarm.robots.gripper import gripper_names
from bt_dualarm.runtime.outcome import Ending
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ArmSpec, TreeFile
from bt_dualarm.spec.node_types import NodeSpec
from bt_dualarm.spec.values import PoseSpec
from tests.sim.worlds import WIDE

Tree: TypeAlias = dict[str, Any]
"""Content of a tree file."""

SHIPPED: Final = sorted(path.stem for path in share_dir("trees").glob("*.yaml"))
SKILLS: Final = Path(__file__).with_name("skills")
FAULTY_SKILLS: Final = Path(__file__).parents[1] / "faults" / "skills"

_HEIGHT: Final = 0.3
"""Height of the bases of generated arms, m: the cubes that they grasp stand on posts."""

_EDGE: Final = 0.04
"""Edge of the cubes that generated arms grasp, m."""

_SPACING: Final = 3.0
"""Distance of generated arms from one another, m: out of each other's reach."""


@dataclass(frozen=True)
class Column:
    """A tree file and how its run ends.

    Attributes:
        name: Name of the column.
        content: Function that returns the content of the tree file; None for the shipped tree of
            this name.
        outcome: Outcome of the run.
        ending: Reason of the run's end.
        failed: Arm, leaf and code of the failure that decides the run, if any.
        duration: Simulated time in s after which the run ends, as by ``--duration``.
        stop_at: Simulated time in s after which the run is stopped, as by a signal.
        watchdog: Wall-clock budget of a tick, s.
        skills: Folder of skills besides the shipped ones.
    """

    name: str
    content: Callable[[], Tree] | None = None
    outcome: str = "SUCCESS"
    ending: Ending = Ending.FINISHED
    failed: tuple[str, str, str] | None = None
    duration: float | None = None
    stop_at: float | None = None
    watchdog: float | None = None
    skills: Path | None = None

    @property
    def exit_code(self) -> int:
        """Exit code of ``bt-run``."""
        if self.ending is Ending.OVERRUN:
            return 154
        return 0 if self.outcome == "SUCCESS" else 1

    @property
    def repeats(self) -> bool:
        """Whether a run of the file without intervention ends in the same way."""
        return self.ending in (Ending.FINISHED, Ending.DURATION, Ending.TIME_LIMIT)

    @property
    def arguments(self) -> list[str]:
        """Arguments of ``bt-run`` besides the file."""
        given = {"--skills": self.skills, "--duration": self.duration, "--watchdog": self.watchdog}
        return [
            part
            for name, value in given.items()
            if value is not None
            for part in (name, str(value))
        ]

    @property
    def options(self) -> dict[str, Any]:
        """The same as arguments of `bt_dualarm.open`."""
        skills = [] if self.skills is None else [self.skills]
        return {"skills": skills, "duration": self.duration, "watchdog": self.watchdog}

    def write(self, folder: Path) -> Path:
        """Writes the tree file unless it is a shipped one; returns its path."""
        if self.content is None:
            return share_dir("trees") / f"{self.name}.yaml"
        path = folder / f"{self.name}.yaml"
        plain = json.loads(json.dumps(self.content()))  # without YAML's aliases of equal parts
        path.write_text(yaml.safe_dump(plain, sort_keys=False), encoding="utf-8")
        return path

    def __str__(self) -> str:
        return self.name


@cache
def _tool_at_home(robot: str, gripper: str | None) -> Pose:
    """Pose of the tool in the base frame in the initial posture."""
    arm = ArmSpec(
        robot=robot,
        gripper=gripper,
        base=PoseSpec(xyz=(0.0, 0.0, 0.0)),
        tree=NodeSpec(kind="succeed", name="succeed", ports={}),
    )
    probe = TreeFile(name="probe", objects={}, arms={"arm1": arm})
    return World(probe).arms["arm1"].tool_pose


@dataclass(frozen=True)
class Station:
    """One arm, and a cube on a post below the tool.

    Attributes:
        arm: Name of the arm, the prefix of the names of the post and the cube.
        robot: Name of the robot.
        gripper: Name of the gripper, or None.
        seed: Seed of the cube's pose.
        at: Position of the base on the floor, m.
    """

    arm: str
    robot: str
    gripper: str | None
    seed: int
    at: tuple[float, float] = (0.0, 0.0)

    @property
    def cube(self) -> str:
        """Name of the cube."""
        return f"{self.arm}_cube"

    @property
    def objects(self) -> Tree:
        """The post and the cube."""
        rng = np.random.default_rng([self.seed, zlib.crc32(self.robot.encode())])
        x, y, z = _tool_at_home(self.robot, self.gripper).position.tolist()
        x += self.at[0] + float(rng.uniform(-0.02, 0.02))
        y += self.at[1] + float(rng.uniform(-0.02, 0.02))
        top = z + _HEIGHT - float(rng.uniform(0.07, 0.08))
        yaw = float(rng.uniform(-20.0, 20.0))
        return {
            f"{self.arm}_post": {
                "shape": "cylinder",
                "size": [0.03, top],
                "mass": 1.0,
                "fixed": True,
                "pose": {"xyz": [x, y, top / 2]},
            },
            self.cube: {
                "shape": "box",
                "size": [_EDGE] * 3,
                "mass": 0.1,
                "color": "red",
                "pose": {"xyz": [x, y, top + _EDGE / 2 + 0.0005], "rpy": [0.0, 0.0, yaw]},
            },
        }

    @property
    def take(self) -> list[Tree]:
        """Leaves that detect the cube and take it with the gripper or, without one, by a weld."""
        look = {"wait_for": {"object": self.cube, "confirm": 2, "wait": 0.3}}
        seen_or_not = {"selector": [look, {"succeed": {}}]}  # the wrist cameras of some look ahead
        if self.gripper is None:
            attach = {"object": self.cube, "standoff": 0.02, "speed": 1.0, "approach_speed": 0.5}
            return [seen_or_not, {"approach_and_attach": attach}]
        grasp = {"object": self.cube, "standoff": 0.02, "lift": 0.02, "speed": 1.0}
        return [seen_or_not, {"grasp": grasp}]

    def while_holding(self, child: Tree) -> Tree:
        """The child, guarded by the condition that the gripper holds the cube."""
        if self.gripper is None:
            return child
        return {"guard": {"condition": "holding", "child": child}}

    def declared(self, *leaves: Tree, **more: object) -> Tree:
        """The arm with a sequence of leaves as its tree."""
        arm: Tree = {"robot": self.robot, "base": {"xyz": [*self.at, _HEIGHT]}}
        if self.gripper is not None:
            arm["gripper"] = self.gripper
        camera = {"mount": "wrist", "resolution": [80, 60], "fov": 50, "fps": 10}
        return {**arm, "camera": camera, **more, "tree": {"sequence": [*leaves]}}


def moved(x: float, y: float, z: float) -> Tree:
    """A leaf that moves the tool along a line, in m."""
    return {"move_linear": {"offset": {"xyz": [x, y, z]}, "speed": 1.0}}


def _file(
    name: str, stations: Sequence[Station], arms: Tree, objects: Tree | None = None, **world: Any
) -> Tree:
    """A tree file of some stations."""
    station_objects = {name: obj for station in stations for name, obj in station.objects.items()}
    seed = stations[0].seed
    return {
        "bt_dualarm": 1,
        "name": name,
        "world": {"scene": "empty", "reality": "lab", "seed": seed, "time_limit": 30, **world},
        "objects": {**station_objects, **(objects or {})},
        "arms": arms,
    }


def taking(robot: str, gripper: str | None, seed: int) -> Tree:
    """An arm takes a cube and moves it aside."""
    station = Station("arm1", robot, gripper, seed)
    aside = station.while_holding(moved(0.0, 0.02, 0.03))
    return _file(
        name_of(robot, gripper), [station], {"arm1": station.declared(*station.take, aside)}
    )


def name_of(robot: str, gripper: str | None) -> str:
    """Name of the column of a robot with a gripper."""
    return f"{robot}_{gripper or 'weld'}"


def four_arms() -> Tree:
    """Four arms take a cube each, with different grippers."""
    pairs = zip(("ur5", "panda", "xarm7", "ur3"), (*gripper_names(), None), strict=True)
    places = itertools.product((0.0, _SPACING), (0.0, _SPACING))
    stations = [
        Station(f"arm{number}", robot, gripper, 4, place)
        for number, ((robot, gripper), place) in enumerate(zip(pairs, places, strict=True), 1)
    ]
    arms = {station.arm: station.declared(*station.take) for station in stations}
    return _file("four_arms", stations, arms)


def spawn_and_remove() -> Tree:
    """An arm spawns another one and a ball, takes a cube, and removes both again.

    The object in the other arm's gripper falls when that arm is removed.
    """
    first = Station("arm1", "ur5", "robotiq_2f85", 5)
    other = Station("arm2", "panda", "panda_hand", 5, (_SPACING, 0.0))
    swing = {
        "repeat": {"times": 50, "child": {"sequence": [moved(0, 0.03, 0), moved(0, -0.03, 0)]}}
    }
    arms = {
        "arm1": first.declared(
            {"spawn": {"arm": "arm2"}},
            {"spawn": {"object": "ball"}},
            *first.take,
            {"wait": 0.5},
            {"remove": {"arm": "arm2"}},
            {"remove": {"object": "ball"}},
            moved(0.0, 0.02, 0.03),
        ),
        "arm2": other.declared(*other.take, swing, spawned=False, removable=True),
    }
    ball = {"shape": "sphere", "size": [0.04], "mass": 0.2, "color": "green", "spawned": False}
    return _file(
        "spawn_and_remove",
        [first, other],
        arms,
        {"ball": {**ball, "pose": {"xyz": [-0.6, -0.6, 0.04]}}},
    )


def failing() -> Tree:
    """An arm that holds a cube has an unreachable target; another arm is beside it."""
    first = Station("arm1", "panda", "panda_hand", 6)
    other = Station("arm2", "ur3", "suction_cup", 6, (_SPACING, 0.0))
    far = {"reach_to_pose": {"name": "too far", "offset": {"xyz": [5, 0, 0]}}}
    arms = {
        "arm1": first.declared(*first.take, first.while_holding(far)),
        "arm2": other.declared(*other.take),
    }
    return _file("failing", [first, other], arms)


def halted() -> Tree:
    """A motion with a held cube is halted, first by a parallel and then by a guard."""
    station = Station("arm1", "xarm7", "robotiq_2f85", 7)
    swing = {
        "repeat": {"times": 50, "child": {"sequence": [moved(0, 0.03, 0), moved(0, -0.03, 0)]}}
    }
    raced = {"parallel": {"policy": "any", "children": [swing, {"wait": 0.3}]}}
    guarded = {"guard": {"condition": {"holding": {"object": station.cube}}, "child": swing}}
    loses_it = {"parallel": [guarded, {"sequence": [{"wait": 0.2}, {"open_gripper": {}}]}]}
    arms = {"arm1": station.declared(*station.take, raced, loses_it)}
    return _file("halted", [station], arms)


def endless(name: str, *pairs: tuple[str, str | None], **world: Any) -> Tree:
    """Arms take a cube each and swing it for longer than any run lasts."""
    stations = [
        Station(f"arm{number + 1}", robot, gripper, 8, (number * _SPACING, 0.0))
        for number, (robot, gripper) in enumerate(pairs)
    ]
    swing = {
        "repeat": {"times": 900, "child": {"sequence": [moved(0, 0.03, 0), moved(0, -0.03, 0)]}}
    }
    arms = {
        station.arm: station.declared(*station.take, station.while_holding(swing))
        for station in stations
    }
    return _file(name, stations, arms, **world)


def breaking(name: str, leaf: Tree) -> Tree:
    """An arm takes a cube, and then a leaf of a faulty skill ends the run; another arm waits."""
    first = Station("arm1", "panda", "robotiq_2f85", 9)
    other = Station("arm2", "ur5", "suction_cup", 9, (_SPACING, 0.0))
    arms = {
        "arm1": first.declared(*first.take, leaf),
        "arm2": other.declared(*other.take, {"wait": 20}),
    }
    return _file(name, [first, other], arms)


def _generated() -> Iterator[Column]:
    grippers = (None, *gripper_names())
    for seed, (robot, gripper) in enumerate(itertools.product(WIDE, grippers)):
        yield Column(name_of(robot, gripper), lambda r=robot, g=gripper, s=seed: taking(r, g, s))  # type: ignore[misc]  # bound now


def columns() -> list[Column]:
    """All columns: shipped trees, every robot with every gripper, several arms, all endings."""
    return [
        *map(Column, SHIPPED),
        *_generated(),
        Column("four_arms", four_arms),
        Column("spawn_and_remove", spawn_and_remove),
        Column(
            "failing",
            failing,
            outcome="FAILURE",
            failed=("arm1", "sequence/guard/too far", "INVALID_TARGET"),
        ),
        Column(
            "halted",
            halted,
            outcome="FAILURE",
            failed=("arm1", "sequence/parallel#2/guard/holding", "NOT_HOLDING"),
        ),
        Column(
            "signaled",
            lambda: endless("signaled", ("ur5", "robotiq_2f85"), ("xarm7", "panda_hand")),
            ending=Ending.STOPPED,
            stop_at=3.5,
            outcome="UNFINISHED",
        ),
        Column(
            "time_limited",
            lambda: endless("time_limited", ("ur3", "panda_hand"), time_limit=4.2),
            ending=Ending.TIME_LIMIT,
            outcome="UNFINISHED",
        ),
        Column(
            "duration",
            lambda: endless("duration", ("xarm7", "suction_cup")),
            ending=Ending.DURATION,
            duration=3.3,
            outcome="UNFINISHED",
        ),
        Column(
            "overrun",
            lambda: breaking("overrun", {"hang": {"after": 0.2}}),
            outcome="FAILURE",
            ending=Ending.OVERRUN,
            failed=("arm1", "sequence/hang", "OVERRUN"),
            watchdog=1.5,
            skills=SKILLS,
        ),
        Column(
            "diverged",
            lambda: breaking("diverged", {"poison": {"after": 0.2, "into": "qvel"}}),
            ending=Ending.DIVERGED,
            skills=FAULTY_SKILLS,
            outcome="UNFINISHED",
        ),
    ]
