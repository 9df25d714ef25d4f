"""Skills that each robot of the catalog can perform, with every gripper, each in a small world.

    python -m benchmarks.robot_skills [--robots ur5 so101] [--reality lab] [--write]

Each run has a world around the home posture of a robot, with a stand below its tool and an object
on it, and a few leaves that end with the skill. ``--write`` writes ``docs/robot_skills.md`` from
all runs.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np

import bt_dualarm
from benchmarks.campaign import Campaign, add_options
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.free_axes import AXES
from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.solver import Chain
from bt_dualarm.robots.gripper import gripper_names, load_gripper
from bt_dualarm.robots.robot import Robot
from bt_dualarm.robots.robot_description import load_robot, robot_names, with_gripper

PAGE: Final = Path(__file__).parents[1] / "docs" / "robot_skills.md"

Tree: TypeAlias = dict[str, Any]

_STANDS_AT: Final = {"baxter_left": 0.93, "baxter_right": 0.93}
"""Height of the bases that belong to a body with a pedestal, m."""

_TOOL_HEIGHT: Final = 0.40
"""Smallest height of the tool above the floor at home, m: room for a stand below."""

_SMALL: Final = 0.5
"""Reach below which a robot makes small motions, m."""

TOGETHER: Final = ("carry_together", "follow_tool", "hand_over", "take_over")
"""Skills that need another arm."""

LEFT_OUT: Final = ("calibrate", "insert", "operate")
"""Skills whose worlds depend on more than the reach."""

BARE: Final = "bare"
"""Name in the table for an arm without a gripper: the robot's own tool."""


@dataclass(frozen=True)
class Place:
    """Surroundings of one robot with one gripper.

    Attributes:
        robot: Name of the robot.
        gripper: Name of the gripper; None for the robot's own tool.
        body: Robot with its gripper.
        base_z: Height of its base, m.
        tool: Pose of its tool at home.
        looks: Whether a camera at its wrist looks at the object, from farther away.
    """

    robot: str
    gripper: str | None
    body: Robot
    base_z: float
    tool: Pose
    looks: bool = False

    @classmethod
    def of(cls, robot: str, gripper: str | None, *, looks: bool = False) -> Place:
        """Surroundings of a robot, with its base high enough for a stand below its tool."""
        bare = load_robot(robot)
        body = bare if gripper is None else with_gripper(bare, load_gripper(gripper))
        base_z = _STANDS_AT.get(robot)
        home = body.postures["home"]
        tool = Chain(body, Pose.identity()).forward(home)
        if base_z is None:
            base_z = round(max(0.0, _TOOL_HEIGHT - float(tool.position[2])), 3)
        return cls(robot, gripper, body, base_z, Pose.from_rpy((0, 0, base_z)) @ tool, looks)

    @property
    def step(self) -> float:
        """Length of a lateral motion, m."""
        return 0.02 if self.is_small else 0.05

    @property
    def is_small(self) -> bool:
        """Whether the arm has a short reach."""
        return Chain(self.body, Pose.identity()).bounding_ball[1] < _SMALL

    @property
    def size(self) -> tuple[float, float, float]:
        """Edges of the object, m; a suction cup needs a face wider than its lip."""
        height = 0.03 if self.is_small else 0.04
        width = 0.045 if self.gripper == "suction_cup" else height
        return width, width, height

    @property
    def top(self) -> float:
        """Height of the stand, m: the object is within the downward reach of the tool."""
        clearance = 0.03 if self.is_small else 0.07
        if self.looks:  # the camera has to see all of it
            clearance = 0.25
        return round(float(self.tool.position[2]) - self.size[2] - clearance, 4)

    def at(self, along: float = 0.0, up: float = 0.0) -> list[float]:
        """Point at an offset from the tool at home, along a circle about the base and upward, m."""
        x, y, z = self.tool.position.tolist()
        distance = float(np.hypot(x, y))
        angle = float(np.arctan2(y, x)) + along / distance
        point = (distance * np.cos(angle), distance * np.sin(angle), z + up)
        return [round(float(one), 4) for one in point]

    def on_stand(self, along: float = 0.0) -> list[float]:
        """Center of the object on the stand, m."""
        x, y, _ = self.at(along)
        return [x, y, round(self.top + self.size[2] / 2, 4)]

    def file(self, leaves: Sequence[Tree | str], reality: str) -> Tree:
        """Tree file with these leaves."""
        x, y, _ = self.at()
        wide = 0.16 if self.is_small else 0.30
        stand = {"shape": "box", "size": [wide, wide, self.top], "mass": 50.0, "fixed": True}
        cube = {"shape": "box", "size": list(self.size), "mass": 0.05, "color": "yellow"}
        spare = {"shape": "box", "size": [0.03, 0.03, 0.03], "mass": 0.05, "spawned": False}
        arm: Tree = {"robot": self.robot, "base": {"xyz": [0, 0, self.base_z]}}
        if self.gripper is not None:
            arm["gripper"] = self.gripper
        if self.looks:
            arm["camera"] = {"mount": "wrist", "resolution": [320, 240], "fov": 70, "fps": 30}
        return {
            "bt_dualarm": 1,
            "name": f"{self.robot}_{self.gripper or BARE}",
            "world": {"scene": "empty", "time_limit": 120, "reality": reality},
            "objects": {
                "stand": stand | {"pose": {"xyz": [x, y, self.top / 2]}},
                "cube": cube | {"pose": {"xyz": self.on_stand()}},
                "spare": spare | {"pose": {"xyz": [1.5, 1.5, 0.015]}},
            },
            "arms": {"arm1": arm | {"tree": {"sequence": list(leaves)}}},
        }


def motions(place: Place) -> Mapping[str, list[Tree | str]]:
    """Leaves for each skill that needs no gripper, camera or other arm."""
    step = place.step
    five: Tree = {"free": list(AXES)} if place.body.dof < 6 else {}
    last = [0.0] * (place.body.dof - 1) + [20]
    attach: Tree = {"approach_and_attach": {"object": "cube", "standoff": 0.02}}
    lift: Tree = {"transport": {"object": "cube", "to": {"xyz": place.on_stand(step)}}}
    points = [[step, 0], [0, step], [-step, 0], [0, -step / 2]]
    corners = [[0, 0], [1000 * step, 0], [1000 * step, 1000 * step]]
    return {
        "approach_and_attach": [attach],
        "circle": [{"circle": {"plane": "xy", "radius": step}}],
        "detach": [attach, {"detach": {"object": "cube"}}],
        "draw": [{"draw": {"plane": "xy", "points": points}}],
        "follow_path": [{"follow_path": {"points": corners, "plane": "xy", "tool_speed": 0.02}}],
        "go_home": [{"move_joints": {"by": last}}, "go_home"],
        "hold_still": [{"hold_still": {"duration": 1.0}}],
        "lissajous": [{"lissajous": {"plane": "xy", "amplitudes": [step, step / 2]}}],
        "move_joints": [{"move_joints": {"by": last}}],
        "move_linear": [{"move_linear": {"offset": {"xyz": [step, step, step]}} | five}],
        "move_through": [
            {
                "move_through": {"poses": [{"xyz": place.at(step)}, {"xyz": place.at(0, step)}]}
                | five
            }
        ],
        "move_until_contact": [
            {"move_until_contact": {"direction": [0, 0, -1], "distance": 0.1, "speed": 0.1}}
        ],
        "reach_to_pose": [{"reach_to_pose": {"to": {"xyz": place.at(2 * step, step)}} | five}],
        "remove": [{"remove": {"object": "cube"}}],
        "rotate_tool": [{"rotate_tool": {"axis": "z", "angle": 30}}],
        "spawn": [{"spawn": {"object": "spare"}}],
        "stop": ["stop"],
        "transport": [attach, lift],
    }


def gripping(place: Place) -> Mapping[str, list[Tree | str]]:
    """Leaves for each skill that needs a gripper."""
    grasp: Tree = {"grasp": {"object": "cube"}}
    beside = place.on_stand(-place.step)
    cell: dict[str, list[Tree | str]] = {
        "grasp": [grasp],
        "holding": [grasp, "holding"],
        "place": [grasp, {"place": {"object": "cube", "at": {"xyz": beside}}}],
        "regrasp": [grasp, {"regrasp": {"object": "cube"}}],
        "release": [grasp, "release"],
    }
    if place.body.flange is not None and place.gripper != "suction_cup":
        cell["open_gripper"] = [{"open_gripper": {"width": 0.05}}]
        cell["close_gripper"] = [grasp, {"close_gripper": {"force": 30}}]
    return cell


def seeing(place: Place) -> Mapping[str, list[Tree | str]]:
    """Leaves for each skill that needs a camera, which is at the wrist and looks down."""
    center = [*place.on_stand()[:2], place.top]
    return {
        "count": [{"count": {"object": "cube"}}],
        "locate": [{"locate": {"object": "cube"}}],
        "look_at": [{"look_at": {"at": {"xyz": place.on_stand()}, "direction": [0, 0, -1]}}],
        "scan": [{"scan": {"object": "cube", "center": center, "width": 0.1, "depth": 0.1}}],
        "track": [{"track": {"color": "yellow", "plane": "xy", "duration": 2.0}}],
        "wait_for": [{"wait_for": {"object": "cube", "wait": 2.0}}],
    }


@dataclass(frozen=True)
class Cell:
    """Result of one skill of one robot.

    Attributes:
        robot: Name of the robot.
        skill: Name of the skill.
        gripper: Name of the gripper, or `BARE`.
        failure: Failure code; empty for a success.
        reason: Message of the failure.
    """

    robot: str
    skill: str
    gripper: str
    failure: str = ""
    reason: str = ""


def tried(place: Place, skill: str, leaves: Sequence[Tree | str], reality: str) -> Cell:
    """Run the leaves of one cell."""
    name = place.gripper or BARE
    try:
        result = bt_dualarm.run(place.file(leaves, reality))
    except DualArmError as error:
        return Cell(place.robot, skill, name, "REFUSED", str(error).splitlines()[0])
    if result.outcome == "SUCCESS":
        return Cell(place.robot, skill, name)
    failed = [leaf for leaf in result.arms["arm1"].runs if leaf.status != "SUCCESS"]
    if not failed:
        return Cell(place.robot, skill, name, str(result.outcome), "")
    return Cell(place.robot, skill, name, failed[0].code or failed[0].status, failed[0].reason)


def cells(robots: Iterable[str], reality: str) -> Iterator[dict[str, Any]]:
    """Arguments of `run_case` for all cells of some robots."""
    for robot in robots:
        same = {"robot": robot, "gripper": None, "looks": False, "reality": reality}
        for skill in motions(Place.of(robot, None)):
            yield {**same, "skill": skill}
        for skill in seeing(Place.of(robot, None, looks=True)):
            yield {**same, "skill": skill, "looks": True}
        for gripper in gripper_names():
            for skill in gripping(Place.of(robot, gripper)):
                yield {**same, "skill": skill, "gripper": gripper}


def run_case(
    robot: str, gripper: str | None, skill: str, reality: str, *, looks: bool
) -> dict[str, Any]:
    """Run the leaves of one cell."""
    place = Place.of(robot, gripper, looks=looks)
    family = seeing if looks else motions if gripper is None else gripping
    cell = tried(place, skill, family(place)[skill], reality)
    outcome = "FAILURE" if cell.failure else "SUCCESS"
    return {"outcome": outcome, "code": cell.failure, "cell": asdict(cell)}


_HEAD: Final = """\
# What each robot can do

Measured by `python -m benchmarks.robot_skills --reality lab --write`: every skill ran in a small
world around the home posture of each [robot](robots.md), with a stand below the tool and an object
on it. ✔: it succeeded. Otherwise the failure code; the last section has the reasons. A code says
what happened in that world; in another one the skill may succeed.
"""

_OWN_TOOL: Final = """\
## With the robot's own tool

Poses and lines of the arms with five joints leave all [axes free](poses.md#free-axes); their
curves, with the tool pointing down, do not. `approach_and_attach`, `detach` and `transport` attach
an object to the tool where it touches it; the fingers of a `jaco2` are fixed apart, and the camera
of a `panda` and of an `fr3` looks ahead at home, not down.
"""

_GRIPPERS: Final = """\
## With a gripper

The [grippers](grippers.md) with which the skill succeeded: `panda_hand` (P), `robotiq_2f85` (R) and
`suction_cup` (S). A cup has no width to open or shut.
"""

_LETTERS: Final = {"panda_hand": "P", "robotiq_2f85": "R", "suction_cup": "S"}


def page(found: Sequence[Cell]) -> str:
    """Content of the documentation page."""
    robots = sorted({cell.robot for cell in found})
    own = [cell for cell in found if cell.gripper == BARE]
    gripped = [cell for cell in found if cell.gripper != BARE]
    parts = [_HEAD, _OWN_TOOL, _table(robots, own, _mark), _GRIPPERS]
    parts += [_table(robots, gripped, _letters), "## Failures\n"]
    rows: dict[tuple[str, str], list[str]] = {}
    for cell in found:
        if cell.failure:
            tool = "" if cell.gripper == BARE else f" with `{cell.gripper}`"
            key = (cell.failure, cell.reason.replace("|", "/"))
            rows.setdefault(key, []).append(f"`{cell.robot}` {cell.skill}{tool}")
    parts.append(
        "| code | where | reason |\n| --- | --- | --- |\n"
        + "".join(
            f"| `{code}` | {', '.join(where)} | {reason} |\n"
            for (code, reason), where in sorted(rows.items())
        )
    )
    others = ", ".join(f"`{name}`" for name in (*TOGETHER, *LEFT_OUT))
    parts.append(f"Not in these tables: {others}. [Benchmarks](benchmarks.md) measures them.\n")
    return "\n".join(parts)


def _mark(cells_of: Sequence[Cell]) -> str:
    (cell,) = cells_of
    return "✔" if not cell.failure else f"`{cell.failure}`"


def _letters(cells_of: Sequence[Cell]) -> str:
    works = {cell.gripper for cell in cells_of if not cell.failure}
    return " ".join(_LETTERS[name] for name in sorted(works)) or "none"


def _table(robots: Sequence[str], found: Sequence[Cell], mark: Any) -> str:
    skills = sorted({cell.skill for cell in found})
    lines = [f"| skill | {' | '.join(f'`{robot}`' for robot in robots)} |"]
    lines.append(f"| --- |{' --- |' * len(robots)}")
    for skill in skills:
        row = [
            mark([cell for cell in found if cell.skill == skill and cell.robot == robot])
            for robot in robots
        ]
        lines.append(f"| `{skill}` | {' | '.join(row)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run all cells, print the failures, and write the page if requested."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--robots", nargs="+", default=robot_names(), choices=robot_names())
    parser.add_argument("--reality", default="lab", choices=("ideal", "lab", "rough"))
    parser.add_argument("--write", action="store_true", help="write the documentation page")
    add_options(parser)
    arguments = parser.parse_args()
    found = []
    with Campaign(arguments) as campaign:
        for _, one in campaign.run(run_case, cells(arguments.robots, arguments.reality)):
            cell = Cell(**one["cell"])
            found.append(cell)
            if cell.failure:
                sys.stdout.write(
                    f"{cell.robot} {cell.gripper} {cell.skill}: {cell.failure}: {cell.reason}\n"
                )
                sys.stdout.flush()
        works = sum(not cell.failure for cell in found)
        sys.stdout.write(f"{works} of {len(found)} succeeded\n")
    if arguments.write:
        PAGE.write_text(page(found), encoding="utf-8")


if __name__ == "__main__":
    main()
