"""Random programs of skills: python -m benchmarks.random_programs [--programs N] [--seed N].

One to three arms of random robots and grippers stand around random objects, and each runs four to
eight random skills, within timeouts, retries and parallels. A leaf may fail, and the next one goes
on; no program makes sense as a task. Whatever the skills do, some things must not happen:

- an exception, a run that ends other than by its trees or its time limit, an arm not at rest;
- a contact between two arms that began apart, or an object below the floor;
- a tick of more than 3 s;
- a failure that goes away when the same leaf is tried again in the next tick. This may be right:
  the tool has moved meanwhile, and with it a relative path, or another arm has left. Each has to be
  looked at, and so has a failure of control or of a grip: an arm that presses against something may
  be the reason.

Prints these findings, with the number of the program, and how often each skill ended how.
``--write FOLDER`` writes the trees as YAML, to run one by itself.
"""

from __future__ import annotations

import argparse
import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
import yaml

import bt_dualarm as bt
from benchmarks.campaign import Campaign, add_options
from bt_dualarm.behaviors.report import LeafReport
from bt_dualarm.core.errors import OverlapError
from bt_dualarm.sim.world import World
from bt_dualarm.spec.problems import SpecError

Tree: TypeAlias = dict[str, Any]  # Any: data of a tree file

GRIPPERS: Final[Mapping[str, Sequence[str]]] = {
    "ur3": ("robotiq_2f85",),
    "ur3e": ("robotiq_2f85",),
    "ur5": ("robotiq_2f85", "suction_cup"),
    "ur5e": ("robotiq_2f85",),
    "ur10": ("robotiq_2f85", "suction_cup"),
    "ur10e": ("robotiq_2f85",),
    "panda": ("panda_hand", "robotiq_2f85"),
    "fr3": ("panda_hand", "robotiq_2f85"),
    "xarm7": ("robotiq_2f85", "suction_cup"),
}
BASES: Final[Sequence[Tree]] = (
    {"xyz": [0, 0, 0]},
    {"xyz": [1.05, 0, 0], "rpy": [0, 0, 180]},
    {"xyz": [0.5, 0.95, 0], "rpy": [0, 0, -90]},
    {"xyz": [0.5, -0.95, 0], "rpy": [0, 0, 90]},
)
_SLOW_S: Final = 3.0
_STEP_S: Final = 0.02
_AGAIN_S: Final = 0.05
_SUSPECT: Final = frozenset(
    {"COLLISION", "DROPPED", "EXCEPTION", "FORCE_LIMIT", "SLIPPED", "TRACKING_ERROR"}
)
"""Codes of failures of control or of a grip."""


class Dice:
    """Random choices for one program.

    Args:
        seed: Seed of all of them.
    """

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def number(self, low: float, high: float, digits: int = 3) -> float:
        """A rounded number."""
        return round(float(self._rng.uniform(low, high)), digits)

    def count(self, low: int, high: int) -> int:
        """A whole number from ``low`` to ``high``, both included."""
        return int(self._rng.integers(low, high + 1))

    def one(self, items: Sequence[Any]) -> Any:
        """One of several items."""
        return items[int(self._rng.integers(len(items)))]

    def happens(self, chance: float) -> bool:
        """Whether something of this probability happens."""
        return bool(self._rng.random() < chance)

    def order(self, items: Sequence[Any]) -> list[Any]:
        """The items in random order."""
        return [items[int(i)] for i in self._rng.permutation(len(items))]

    def spot(self) -> list[float]:
        """A place on the floor between the arms, x and y in m."""
        return [self.number(0.25, 0.65), self.number(-0.35, 0.35)]


def objects(dice: Dice) -> dict[str, Tree]:
    """Two to four objects that stand apart from each other."""
    found: dict[str, Tree] = {}
    spots = dice.order([(x, y) for x in (0.3, 0.45, 0.6) for y in (-0.3, -0.12, 0.08, 0.28)])
    for index, color in enumerate(("yellow", "orange", "green", "blue")[: dice.count(2, 4)]):
        shape = dice.one(("box", "box", "cylinder", "sphere", "bar"))
        if shape == "box":
            size = [dice.number(0.025, 0.06) for _ in range(3)]
        elif shape == "bar":
            size = [dice.number(0.1, 0.15), dice.number(0.025, 0.04), dice.number(0.025, 0.04)]
        elif shape == "cylinder":
            size = [dice.number(0.013, 0.025), dice.number(0.05, 0.12)]
        else:
            size = [dice.number(0.015, 0.028)]
        height = size[0] if shape == "sphere" else 0.5 * size[-1]
        x, y = (spot + dice.number(-0.02, 0.02) for spot in spots[index])
        found[f"o{index}"] = {
            "shape": "box" if shape == "bar" else shape,
            "size": size,
            "mass": dice.number(0.05, 0.6),
            "color": color,
            "pose": {
                "xyz": [round(x, 3), round(y, 3), round(height + 5e-4, 4)],
                "rpy": [0, 0, dice.number(-180, 180, 0)],
            },
        }
    return found


def height_of(obj: Tree) -> float:
    """Height of an object's center where it stands on the floor, m."""
    return float(obj["pose"]["xyz"][2]) - 5e-4


class Author:
    """Writes the tree of one arm.

    Args:
        dice: Random choices.
        others: Names of the other arms.
        things: Objects of the file.
    """

    def __init__(self, dice: Dice, others: Sequence[str], things: Mapping[str, Tree]) -> None:
        self._dice = dice
        self._others = others
        self._things = things
        self._thing = dice.one(list(things))
        self._has_taken = False

    def tree(self) -> Tree:
        """Four to eight skills, of which each may fail."""
        nodes = [self._wrapped(self._skill()) for _ in range(self._dice.count(4, 8))]
        return {"sequence": [{"force_success": {"child": node}} for node in nodes]}

    def _wrapped(self, node: Tree) -> Tree:
        dice = self._dice
        kind = dice.one(("timeout", "retry", "retry", "repeat", "parallel", "", "", ""))
        if kind == "timeout":
            return {"timeout": {"seconds": dice.number(0.3, 6, 1), "child": node}}
        if kind in ("retry", "repeat"):
            return {kind: {"times": 2, "child": node}}
        return {"parallel": [node, {"wait": 0.4}]} if kind else node

    def _skill(self) -> Tree:
        dice = self._dice
        if dice.happens(0.15):
            self._thing = dice.one(list(self._things))
        kinds: list[Callable[[], Tree]] = [
            *[self._grasp] * 4, *[self._reach] * 2, *[self._curve] * 4, *[self._step] * 3,
            self._touch, self._look, self._gripper, self._glue, self._wait,
        ]  # fmt: skip
        if self._has_taken or dice.happens(0.2):
            kinds += [*[self._place] * 8, *[self._transport] * 4, self._regrasp]
        return dict(dice.one(kinds)())

    @property
    def _speed(self) -> float:
        return float(self._dice.one((0.3, 0.5, 1.0)))

    def _grasp(self) -> Tree:
        ports: Tree = {"object": self._thing, "speed": self._speed}
        if self._dice.happens(0.2):
            ports["approach"] = self._dice.one(([0, 0, -1], [0, 1, 0], [1, 0, 0]))
        self._has_taken = True
        return {"grasp": ports}

    def _regrasp(self) -> Tree:
        return {"regrasp": {}}

    def _place(self) -> Tree:
        dice = self._dice
        other = dice.one([name for name in self._things if name != self._thing])
        at = dice.one(
            (
                {"xyz": [*dice.spot(), round(height_of(self._things[self._thing]), 4)]},
                {"xyz": [*dice.spot(), round(height_of(self._things[self._thing]), 4)]},
                {"on": other},
                {"beside": other, "side": dice.one(("+x", "-x", "+y")), "by": 0.05},
            )
        )
        self._has_taken = False
        return {"place": {"at": at, "speed": self._speed}}

    def _transport(self) -> Tree:
        to = {"xyz": [*self._dice.spot(), self._dice.number(0.15, 0.45)]}
        return {"transport": {"to": to, "speed": self._speed}}

    def _reach(self) -> Tree:
        place = {"xyz": [*self._dice.spot(), self._dice.number(0.1, 0.5)]}
        if self._dice.happens(0.3):
            return {"go_home": {}}
        if self._dice.happens(0.3):
            return {"move_through": {"poses": [place], "speed": self._speed}}
        return {"reach_to_pose": {"to": place, "speed": self._speed}}

    def _curve(self) -> Tree:
        dice = self._dice
        shape = {"plane": dice.one(("xy", "yz", "xz")), "speed": self._speed}
        kind = dice.one(("circle", "lissajous", "draw", "follow_path"))
        if kind == "circle":
            shape["radius"] = dice.number(0.03, 0.1)
        elif kind == "draw":
            shape["points"] = [[0, 0], [0.05, 0.03], [0.1, 0], [0.05, -0.05]]
        elif kind == "follow_path":
            shape |= {"points": [[0, 0], [60, 0], [60, 50]], "start": "around"}
        return {kind: shape}

    def _step(self) -> Tree:
        dice = self._dice
        offset = [dice.number(-0.12, 0.12), dice.number(-0.12, 0.12), dice.number(-0.05, 0.12)]
        turn = {"angle": dice.number(-90, 90, 0), "axis": dice.one("xyz"), "speed": self._speed}
        line = {"offset": {"xyz": offset}, "speed": self._speed}
        return {"rotate_tool": turn} if dice.happens(0.4) else {"move_linear": line}

    def _touch(self) -> Tree:
        direction = self._dice.one(([0, 0, -1], [1, 0, 0], [0, 1, 0]))
        return {"move_until_contact": {"direction": direction, "distance": 0.2, "speed": 0.05}}

    def _look(self) -> Tree:
        name = self._thing
        return dict(
            self._dice.one(
                (
                    {"look_at": {"at": {"xyz": [*self._dice.spot(), 0.02]}}},
                    {"locate": {"object": name}},
                    {"scan": {"object": name}},
                    {"track": {"color": self._things[name]["color"], "duration": 2}},
                )
            )
        )

    def _gripper(self) -> Tree:
        return {self._dice.one(("open_gripper", "close_gripper", "release")): {}}

    def _glue(self) -> Tree:
        return {self._dice.one(("approach_and_attach", "detach")): {"object": self._thing}}

    def _wait(self) -> Tree:
        if self._others and self._dice.happens(0.4):
            return {"follow_tool": {"arm": self._dice.one(self._others), "duration": 2}}
        return {"hold_still": {"duration": 1}} if self._dice.happens(0.5) else {"stop": {}}


def program(seed: int) -> Tree:
    """A tree file, as Python data."""
    dice = Dice(seed)
    things = objects(dice)
    names = ("a", "b", "c")[: dice.one((1, 2, 2, 3))]
    arms = {}
    for name, base in zip(names, dice.order(BASES), strict=False):
        robot = dice.one(list(GRIPPERS))
        others = [other for other in names if other != name]
        arms[name] = {
            "robot": robot,
            "gripper": dice.one(GRIPPERS[robot]),
            "base": base,
            "camera": {},
            "tree": Author(dice, others, things).tree(),
        }
    world = {"scene": "empty", "reality": dice.one(("ideal", "lab", "rough")), "seed": seed}
    return {
        "bt_dualarm": 1,
        "name": f"program_{seed}",
        "world": world | {"time_limit": 90},
        "objects": things,
        "arms": arms,
    }


class _Exceptions(logging.Handler):
    """Collects the exceptions that the library logs."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.seen: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep an exception."""
        if record.exc_info:
            self.seen.append(f"{record.getMessage()}: {record.exc_info[1]!r}")


def try_program(seed: int) -> Tree:
    """Run a program; returns its findings, and each leaf's kind and end."""
    return findings_of(program(seed))


def findings_of(file: Tree, judge: Callable[[Any], list[str]] = lambda _: []) -> Tree:
    """Run a tree file; returns its outcome, its findings, and each leaf's kind and end.

    Args:
        file: The file, as Python data.
        judge: Returns further findings of a run that has ended.
    """
    handler = _Exceptions()
    log = logging.getLogger("bt_dualarm")
    log.addHandler(handler)
    try:
        with bt.open(file) as run:
            findings = [*_watched(run), *judge(run)]
            result = run.result
    except (OverlapError, SpecError) as error:  # arms or objects that are drawn within each other
        return {"outcome": "SKIPPED", "findings": [], "leaves": [], "why": str(error)[:200]}
    except Exception as error:  # noqa: BLE001 - every one is a finding
        return {"outcome": "RAISED", "findings": [repr(error)], "leaves": []}
    finally:
        log.removeHandler(handler)
    findings += handler.seen
    if str(result.outcome) not in ("SUCCESS", "FAILURE", "UNFINISHED"):
        findings.append(f"{result.outcome}: {result.ending} {result.error}")
    findings += ["not at rest"] * (not result.at_rest)
    for name, arm in result.arms.items():
        findings += [f"{name}: {arm.fault}"] * bool(arm.fault)
        findings += _suspect(name, arm)
    runs = [leaf for arm in result.arms.values() for leaf in arm.runs]
    leaves = [(leaf.skill, leaf.code or leaf.status) for leaf in runs]
    return {"outcome": str(result.outcome), "findings": findings, "leaves": leaves}


def _watched(run: Any) -> Iterator[str]:
    """Step a run to its end; yields what must not happen."""
    seen: set[tuple[str, str]] = set()
    while not run.done:
        began = time.perf_counter()
        run.step(_STEP_S)
        took = time.perf_counter() - began
        if took > _SLOW_S:
            yield f"a tick of {took:.1f} s at {run.time:.2f} s"
        for pair in _touching_arms(run.world):
            if pair not in seen and run.time > 2 * _STEP_S:
                yield f"{pair[0]} touches {pair[1]} at {run.time:.2f} s"
            seen.add(pair)
    for name in run.world.objects:
        if run.world.object_pose(name).position[2] < -5e-3:
            yield f"{name} is below the floor"


def _touching_arms(world: World) -> Iterator[tuple[str, str]]:
    """Pairs of links of different arms that touch."""
    for geoms, distance in zip(
        world.data.contact.geom.tolist(), world.data.contact.dist, strict=True
    ):
        if distance < -1e-4:
            first, second = (world.model.body(world.model.geom_bodyid[one]).name for one in geoms)
            arms = {name.partition("/")[0] for name in (first, second)}
            if len(arms) == 2 and arms <= world.arms.keys():
                yield first, second


def _suspect(name: str, arm: bt.ArmResult) -> Iterator[str]:
    """Failures of control, and those that went away when the leaf was tried again at once."""
    last: dict[str, LeafReport] = {}
    for leaf in arm.runs:
        if leaf.code in _SUSPECT:
            yield f"{name}: {leaf.path} failed at {leaf.ended_s:.2f} s: {leaf.code} {leaf.reason}"
        before = last.get(leaf.path)
        if (
            before is not None
            and (before.status, leaf.status) == ("FAILURE", "SUCCESS")
            and before.code != "PARTNER_GONE"
            and leaf.started_s - (before.ended_s or 0.0) < _AGAIN_S
        ):
            yield f"{name}: {leaf.path} failed once: {before.code} {before.reason}"
        last[leaf.path] = leaf


def main() -> None:
    """Print the findings."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--programs", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0, help="number of the first program")
    parser.add_argument("--write", type=Path, help="folder for the trees; nothing is run")
    add_options(parser)
    arguments = parser.parse_args()
    seeds = range(arguments.seed, arguments.seed + arguments.programs)
    if arguments.write is not None:
        arguments.write.mkdir(parents=True, exist_ok=True)
        for seed in seeds:
            text = yaml.safe_dump(program(seed), sort_keys=False, default_flow_style=None)
            (arguments.write / f"program_{seed}.yaml").write_text(text, encoding="utf-8")
        return
    outcomes: Counter[str] = Counter()
    ends: dict[str, Counter[str]] = {}
    findings = 0
    with Campaign(arguments) as campaign:
        for case, found in campaign.run(try_program, [{"seed": seed} for seed in seeds]):
            outcomes[found["outcome"]] += 1
            for kind, end in found["leaves"]:
                ends.setdefault(kind, Counter())[end] += 1
            for finding in found["findings"]:
                findings += 1
                print(f"program {case['seed']}: {finding}", flush=True)
    print(", ".join(f"{count} {outcome}" for outcome, count in outcomes.most_common()))
    for kind, counts in sorted(ends.items()):
        print(f"  {kind}: {', '.join(f'{n} {end}' for end, n in counts.most_common(8))}")
    print(f"{findings} findings")


if __name__ == "__main__":
    main()
