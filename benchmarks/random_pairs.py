"""Random actions of several arms: python -m benchmarks.random_pairs [--programs N] [--seed N].

Each program is one action of several arms: a handover whose taker places the object, a carry with
two or three arms, or a peg that goes into a block that another arm holds still. Robots, grippers,
bases, sizes, masses and realities are random, but everything is placed where it is within reach of
the arms that need it. A leaf may be within a timeout that halts it in the middle, and is tried
again with the object where it then is. Another arm may run random skills nearby.

Most programs can be done, so each failure has to be explained: it is printed with its reason, and
what must not happen whatever the arms do (`benchmarks.random_programs`). After a SUCCESS the object
must be where it was asked for, by the true state of the simulation.
"""

from __future__ import annotations

import argparse
import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache, partial
from typing import Any, Final

import numpy as np
import yaml

import bt_dualarm as bt
from benchmarks.campaign import Campaign, add_options
from benchmarks.random_programs import GRIPPERS, Author, Dice, Tree, findings_of
from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.robot_description import load_robot

ROBOTS: Final[Mapping[str, Sequence[str]]] = {
    **GRIPPERS,
    "z1": ("panda_hand", "robotiq_2f85"),
    "jaco2": ("robotiq_2f85", "panda_hand"),
}
"""Robots and the grippers that they can bear."""

_BY_OTHERS: Final = ("", "HALTED", "PARTNER_GONE")
"""Codes of leaves that have no reason of their own to fail."""

_PLACED_M: Final = 0.01
"""Distance from its goal up to which an object is where it was asked for, m."""


@cache
def reach_of(robot: str) -> float:
    """Radius of the ball around the workspace of a robot, m."""
    return float(Kinematics(load_robot(robot), Pose.from_rpy((0, 0, 0))).bounding_ball[1])


class PairAuthor:
    """Writes a program of an action of several arms.

    Args:
        seed: Seed of all choices.
        kind: ``handover``, ``carry`` or ``insert``; by default a random one.

    Attributes:
        goal: Name of the object and the position at which it is at the end, m.
    """

    def __init__(self, seed: int, kind: str | None = None) -> None:
        self._seed = seed
        self._dice = dice = Dice(seed)
        drawn = dice.one(("handover", "handover", "carry", "carry", "insert"))
        self._kind = kind or drawn
        self._robots = {name: dice.one(list(ROBOTS)) for name in ("a", "b")}
        reaches = [reach_of(robot) for robot in self._robots.values()]
        self._distance = round(dice.number(0.5, 0.62) * sum(reaches), 3)
        share = reaches[0] / sum(reaches)
        self._middle = round(share * self._distance, 3)
        self._table = dice.one((0.0, 0.0, dice.number(0.1, 0.3, 2)))
        self._objects: dict[str, Tree] = {}
        self._signals: dict[str, Tree] = {}
        self.goal: tuple[str, list[float]] | None = None

    def program(self) -> Tree:
        """A tree file, as Python data."""
        dice = self._dice
        write = {"handover": self._handover, "carry": self._carry, "insert": self._insert}
        trees = write[self._kind]()
        bases = {
            "a": {"xyz": [0, 0, self._table], "rpy": [0, 0, dice.number(-30, 30, 0)]},
            "b": {
                "xyz": [self._distance, 0, self._table],
                "rpy": [0, 0, 180 + dice.number(-30, 30, 0)],
            },
        }
        arms: dict[str, Tree] = {}
        for name, tree in trees.items():
            robot = self._robots[name]
            gripper = dice.one([one for one in ROBOTS[robot] if one != "suction_cup"])
            base = bases.get(name) or self._third_base(name)
            arms[name] = {"robot": robot, "gripper": gripper, "base": base, "tree": tree}
        if len(arms) == 2 and dice.happens(0.35):
            arms["c"] = self._neighbor()
        world = {"scene": "empty", "reality": dice.one(("ideal", "lab", "rough"))}
        file = {
            "bt_dualarm": 1,
            "name": f"pair_{self._seed}",
            "world": world | {"seed": self._seed, "time_limit": 180},
            "objects": self._objects,
            "arms": arms,
        }
        file |= {"cell": {"signals": self._signals}} if self._signals else {}
        copied: Tree = json.loads(json.dumps(file))  # else YAML would name what is used twice
        return copied

    def _third_base(self, name: str) -> Tree:
        away = 0.6 * reach_of(self._robots[name])
        return {"xyz": [self._middle, round(-0.2 - away, 3), self._table], "rpy": [0, 0, 90]}

    def _neighbor(self) -> Tree:
        """An arm that runs random skills beside the others, with an object of its own."""
        dice = self._dice
        robot = dice.one(list(GRIPPERS))
        y = round(0.3 + 0.6 * reach_of(robot), 3)
        for number, color in enumerate(("green", "blue")):
            size = [dice.number(0.025, 0.05) for _ in range(3)]
            place = [self._middle + (-0.2, 0.2)[number], 0.45, size[2] / 2 + 5e-4]
            self._objects[f"c{number}"] = {
                "shape": "box",
                "size": size,
                "mass": dice.number(0.05, 0.4),
                "color": color,
                "pose": {"xyz": [round(x, 4) for x in place]},
            }
        things = {name: self._objects[name] for name in ("c0", "c1")}
        return {
            "robot": robot,
            "gripper": dice.one(GRIPPERS[robot]),
            "base": {"xyz": [self._middle, y, 0], "rpy": [0, 0, -90]},
            "camera": {},
            "tree": Author(dice, ["a", "b"], things).tree(),
        }

    def _stand(self, name: str, x: float, y: float, size: Sequence[float]) -> float:
        """Put a fixed stand at a place unless it is on the floor; returns the height there."""
        if self._table > 0.0:
            self._objects[name] = {
                "shape": "box",
                "size": [*size, self._table],
                "fixed": True,
                "mass": 10,
                "color": "gray",
                "pose": {"xyz": [round(x, 3), round(y, 3), round(self._table / 2, 4)]},
            }
        return float(self._table)

    def _beside(self, arm: str) -> tuple[float, float]:
        """A place within comfortable reach of an arm, x and y in m."""
        share, side = self._dice.number(0.4, 0.55), self._dice.number(-60, 60, 0)
        radius = share * reach_of(self._robots[arm])
        x, y = radius * math.cos(math.radians(side)), radius * math.sin(math.radians(side))
        return (x if arm == "a" else self._distance - x), y

    def _tried(self, leaf: Tree) -> Tree:
        """A leaf, perhaps within a node that tries it again."""
        dice = self._dice
        kind = dice.one(("", "", "retry", "parallel", "selector"))
        if kind == "retry":
            return {"retry": {"times": 3, "child": leaf}}
        if kind == "parallel":
            return {"parallel": [leaf, {"wait": 0.5}]}
        return {"selector": [leaf, leaf]} if kind else leaf

    def _halted(self, leaf: Tree, seconds: float | None) -> Tree:
        """A leaf that is halted after some time and begins anew, or tries again after the other."""
        if seconds is None:
            return {"retry": {"times": 4, "child": leaf}}
        halted = {"timeout": {"seconds": seconds, "child": leaf}}
        return {"selector": [halted, {"retry": {"times": 3, "child": leaf}}]}

    def _both(self, a: Tree, b: Tree, *, at_most: float) -> tuple[Tree, Tree]:
        """The leaves of both arms, either as they are, tried again, or one of them halted once."""
        if not self._dice.happens(0.4):
            return self._tried(a), self._tried(b)
        times = [self._dice.number(1, at_most, 1), None]
        first, second = self._dice.order(times)
        return self._halted(a, first), self._halted(b, second)

    # Actions

    def _handover(self) -> dict[str, Tree]:
        dice = self._dice
        shape = dice.one(("bar", "bar", "cylinder", "box"))
        if shape == "cylinder":
            size = [dice.number(0.012, 0.022, 4), dice.number(0.13, 0.2)]
        elif shape == "bar":
            size = [dice.number(0.13, 0.2), *(dice.number(0.022, 0.045) for _ in range(2))]
        else:
            size = [*(dice.number(0.03, 0.05) for _ in range(2)), dice.number(0.1, 0.16)]
        x, y = self._beside("a")
        height = self._stand("from", x, y, (0.12, 0.12)) + size[-1] / 2 + 5e-4
        yaw = dice.number(-180, 180, 0)
        self._objects["it"] = {
            "shape": "cylinder" if shape == "cylinder" else "box",
            "size": size,
            "mass": dice.number(0.05, 0.6),
            "color": "orange",
            "pose": {"xyz": [round(x, 3), round(y, 3), round(height, 4)], "rpy": [0, 0, yaw]},
        }
        x, y = self._beside("b")
        height = self._stand("onto", x, y, (0.2, 0.2)) + size[-1] / 2
        goal = [round(x, 3), round(y, 3), round(height, 4)]
        at = {"xyz": goal, "rpy": [0, 0, dice.number(-180, 180, 0)]}
        self.goal = ("it", goal)
        give: Tree = {"object": "it", "to": "b", "speed": dice.number(0.3, 1.0, 1)}
        take: Tree = {"object": "it", "from": "a", "speed": dice.number(0.3, 1.0, 1)}
        if dice.happens(0.6):
            take["then_at"] = at
        giving, taking = self._both({"hand_over": give}, {"take_over": take}, at_most=14)
        return {
            "a": {"sequence": [{"grasp": {"object": "it"}}, giving, {"go_home": {}}]},
            "b": {"sequence": [taking, {"place": {"at": at}}, {"go_home": {}}]},
        }

    def _carry(self) -> dict[str, Tree]:
        dice = self._dice
        names = ["a", "b"]
        if dice.happens(0.25):
            names.append("c")
            self._robots["c"] = dice.one(list(ROBOTS))
        is_disk = self._table > 0.0 and dice.happens(0.4)  # no hand gets below a rim on the floor
        long = dice.number(0.35, 0.6)
        thick = dice.number(0.025, 0.045)
        size = [round(long / 2, 3), thick] if is_disk else [long, thick, dice.number(0.025, 0.045)]
        mass = dice.one((dice.number(0.05, 0.3), dice.number(0.3, 1.5), dice.number(1.5, 4)))
        x, y = self._middle, dice.number(-0.15, 0.0)
        if len(names) == 3:
            y = -0.15
        height = self._stand("stand", x, y, (0.2, 0.2)) + size[-1] / 2
        self._objects["it"] = {
            "shape": "cylinder" if is_disk else "box",
            "size": size,
            "mass": mass,
            "color": "orange",
            "pose": {
                "xyz": [x, y, round(height + 5e-4, 4)],
                "rpy": [0, 0, dice.number(-20, 20, 0)],
            },
        }
        goal = [round(x + dice.number(-0.04, 0.04), 3), y, round(height, 4)]
        on_way = [round(x + dice.number(-0.08, 0.08), 3), y, round(height + 0.2, 3)]
        path = [{"xyz": on_way}, {"xyz": goal}] if dice.happens(0.5) else [{"xyz": goal}]
        self.goal = ("it", goal)
        leaves = {
            name: {"object": "it", "with": [other for other in names if other != name]}
            for name in names
        }
        speed = dice.number(0.3, 1.0, 1)
        sequences: dict[str, list[Tree]] = {name: [] for name in names}
        if dice.happens(0.3):  # keep it in the air, and go on from there
            for name in names:
                ports = leaves[name] | ({"to": {"xyz": on_way}} if name == "a" else {})
                leaf = {"carry_together": ports | {"set_down": False, "speed": speed}}
                sequences[name].append(leaf)
        last: dict[str, Tree] = {
            name: {
                "carry_together": leaves[name]
                | ({"path": path} if name == "a" else {})
                | {"speed": speed}
            }
            for name in names
        }
        last["a"], last["b"] = self._both(last["a"], last["b"], at_most=14)
        if len(names) == 3:
            last["c"] = {"retry": {"times": 4, "child": last["c"]}}
        for name in names:
            sequences[name] += [last[name], {"go_home": {}}]
        return {name: {"sequence": sequences[name]} for name in names}

    def _insert(self) -> dict[str, Tree]:
        dice = self._dice
        pin_size = [0.01, dice.number(0.08, 0.12, 2)]
        x, y = self._beside("a")
        floor = self._stand("holder", x, y, (0.2, 0.2))
        boxes: dict[str, tuple[list[float], list[float]]] = {
            "right": ([0.025, 0, 0.01], [0.0295, 0.0705, 0.02]),
            "left": ([-0.025, 0, 0.01], [0.0295, 0.0705, 0.02]),
            "front": ([0, 0.02275, 0.01], [0.0205, 0.025, 0.02]),
            "rear": ([0, -0.02275, 0.01], [0.0205, 0.025, 0.02]),
            "back": ([0, 0, -0.01], [0.0795, 0.0705, 0.02]),
            "handle": ([0, 0, -0.055], [0.04, 0.04, 0.07]),
        }
        parts: Tree = {
            name: {"shape": "box", "size": size, "pose": {"xyz": xyz}}
            for name, (xyz, size) in boxes.items()
        }
        self._objects["it"] = {
            "shape": "compound",
            "mass": dice.number(0.15, 0.5),
            "friction": 0.9,
            "color": "blue",
            "pose": {"xyz": [round(x, 3), round(y, 3), round(floor + 0.0905, 4)]},
            "parts": parts,
        }
        x, y = self._beside("b")
        floor = self._stand("pins", x, y, (0.12, 0.12))
        self._objects["pin"] = {
            "shape": "cylinder",
            "size": pin_size,
            "mass": dice.number(0.04, 0.15),
            "friction": 0.8,
            "color": "orange",
            "pose": {"xyz": [round(x, 3), round(y, 3), round(floor + pin_size[1] / 2 + 5e-4, 4)]},
        }
        held = [self._middle, dice.number(-0.1, 0.1), round(self._table + 0.25, 3)]
        there = {"xyz": held, "rpy": [0, 0, 0]}
        pin = {"xyz": [*held[:2], round(held[2] + pin_size[1] / 2, 4)], "rpy": [0, 0, 0]}
        self._signals = {
            "ready": {"type": "boolean", "written_by": ["a"]},
            "done": {"type": "boolean", "written_by": ["b"]},
        }
        wait = {"sequence": [{"signal": "ready"}, {"await": "done"}]}
        hold = {"hold_still": {"partner": "b"}}
        insert = {"insert": {"object": "pin", "at": pin, "depth": 0.02, "into": "it"}}
        again = self._halted(insert, dice.number(1, 14, 1) if dice.happens(0.4) else None)
        return {
            "a": {
                "sequence": [
                    {"grasp": {"object": "it", "part": "handle", "then_at": there}},
                    {"transport": {"to": there, "speed": 0.4}},
                    {"parallel": {"policy": "any", "children": [hold, wait]}},
                ]
            },
            "b": {
                "sequence": [
                    {"grasp": {"object": "pin", "then_at": pin}},
                    {"await": "ready"},
                    again,
                    {"release": {}},
                    {"move_linear": {"offset": {"xyz": [0, 0, 0.06]}, "speed": 0.3, "into": "it"}},
                    {"signal": "done"},
                    {"go_home": {}},
                ]
            },
        }


def try_program(seed: int, kind: str | None = None) -> Tree:
    """Run a program; returns its findings and how the leaves of its action ended."""
    author = PairAuthor(seed, kind)
    file = author.program()
    found = findings_of(file, partial(_judged, author.goal, file))
    robots = "+".join(arm["robot"] for arm in file["arms"].values())
    found["label"] = f"{robots} {file['world']['reality']}"
    return found


def _judged(goal: tuple[str, list[float]] | None, file: Tree, run: Any) -> list[str]:
    """What is to be looked at: arms of the action that failed, and a false SUCCESS."""
    result: bt.RunResult = run.result
    findings = []
    acting = [name for name in file["arms"] if "camera" not in file["arms"][name]]
    for name in acting:
        arm = result.arms[name]
        findings += [f"{name}: {arm.clipped_setpoints} clipped"] * bool(arm.clipped_setpoints)
        if str(arm.outcome) != "SUCCESS":
            last = [leaf for leaf in arm.runs if leaf.code not in _BY_OTHERS][-1:]
            findings += [f"{name} {leaf.skill}: {leaf.code} {leaf.reason}" for leaf in last]
    if goal is not None and all(str(result.arms[name].outcome) == "SUCCESS" for name in acting):
        away = float(np.linalg.norm(run.world.object_pose(goal[0]).position - goal[1]))
        findings += [f"false success: {1e3 * away:.1f} mm"] * (away > _PLACED_M)
    return findings


def main() -> None:
    """Print the findings."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--programs", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0, help="number of the first program")
    parser.add_argument("--kind", choices=("handover", "carry", "insert"))
    parser.add_argument("--write", action="store_true", help="print the first program; run nothing")
    add_options(parser)
    arguments = parser.parse_args()
    if arguments.write:
        file = PairAuthor(arguments.seed, arguments.kind).program()
        print(yaml.safe_dump(file, sort_keys=False, default_flow_style=None))
        return
    seeds = range(arguments.seed, arguments.seed + arguments.programs)
    outcomes: Counter[str] = Counter()
    findings = 0
    with Campaign(arguments) as campaign:
        cases = [{"seed": seed, "kind": arguments.kind} for seed in seeds]
        for case, found in campaign.run(try_program, cases):
            outcomes[found["outcome"]] += 1
            for finding in found["findings"]:
                findings += 1
                print(f"pair {case['seed']} ({found['label']}): {finding}", flush=True)
    print(", ".join(f"{count} {outcome}" for outcome, count in outcomes.most_common()))
    print(f"{findings} findings")


if __name__ == "__main__":
    main()
