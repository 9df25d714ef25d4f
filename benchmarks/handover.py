"""Handovers between all pairs of robots and finger grippers, with random base poses.

    python -m benchmarks.handover [--cases 100] [--seed 0] [--reality lab]
    python -m benchmarks.handover --faults [--cases 20] [--reality lab]
    python -m benchmarks.handover --only 17

In each case one arm takes a bar from a pedestal and hands it to another arm. The relative pose of
the arms, the bar and its pose are random; robots and grippers go through all combinations. The arms
choose the place of the handover themselves. A case in which the giver cannot even take the bar is
replaced by another one.

Two things are judged by the true state of the simulation: whether the bar was in a hand at all
times, and the force between the arms, which is the part of the force of the taker's hand on the bar
that no share of the weight explains, averaged over 20 ms. With ``--faults`` one arm is halted,
crashes, is removed or loses its grip at a random tick of the handover: the other one has to end
with a reason, and the bar must not fall, unless the only hand that holds it is gone. Exits with
code 1 after a drop.
"""

from __future__ import annotations

import argparse
import copy
import itertools
import math
import statistics
import sys
from collections import Counter, deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np

from benchmarks.campaign import Campaign, add_options, registry
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.behaviors.report import LeafReport
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.outcome import RunResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.grippers import GripperCommand
from bt_dualarm.skill.registry import Registry
from bt_dualarm.skill.skill import Skill

ROBOTS: Final = ("ur3", "ur5", "ur10", "panda", "xarm7")
GRIPPERS: Final = ("robotiq_2f85", "panda_hand")
FAULTS: Final = ("halt", "crash", "removal", "lost_grip")
LIMIT_S: Final = 90.0
PEDESTAL_M: Final = 0.25
FELL_M: Final = 0.02
"""Height of a fall that counts after a fault, m."""

UNHELD_S: Final = 0.03
"""Time without contact with a hand after which the bar counts as dropped, s."""

FORCE_S: Final = 0.02
"""Time over which the force between the arms is averaged, s."""

Tree = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """A handover.

    Attributes:
        seed: Seed of the case.
        file: Tree file; ``arm1`` hands over to ``arm2``.
    """

    seed: int
    file: Tree

    @property
    def label(self) -> str:
        """Robots and grippers, giver first."""
        arms = self.file["arms"].values()
        return " to ".join(f"{arm['robot']} ({arm['gripper']})" for arm in arms)


def generate(seed: int, reality: str) -> Case:
    """The case of a seed."""
    rng = np.random.default_rng(seed)
    giver, taker = ROBOTS[seed % 5], ROBOTS[seed // 5 % 5]
    hands = GRIPPERS[seed // 25 % 2], GRIPPERS[seed // 50 % 2]
    reaches = [
        Kinematics(load_robot(robot), Pose.from_rpy((0, 0, 0))).bounding_ball[1]
        for robot in (giver, taker)
    ]
    distance = float(rng.uniform(0.5, 0.72)) * sum(reaches)
    bearing = float(rng.uniform(-math.pi, math.pi))
    headings = np.degrees(bearing) + rng.uniform(-50.0, 50.0, 2) + (0.0, 180.0)
    heights = rng.uniform(0.0, 0.25, 2).round(3)
    offset = distance * np.array((math.cos(bearing), math.sin(bearing)))
    # The bar lies in front of the giver, to one side of the line between the arms.
    side = bearing + float(rng.choice((-1.0, 1.0)) * rng.uniform(1.0, 1.8))
    spot = 0.5 * reaches[0] * np.array((math.cos(side), math.sin(side)))
    length = round(float(rng.uniform(0.13, 0.20)), 3)
    if rng.random() < 0.7:
        edges = rng.uniform(0.022, 0.045, 2).round(3).tolist()
        bar: Tree = {"shape": "box", "size": [length, *edges]}
        up = edges[1] / 2
    else:
        radius = round(float(rng.uniform(0.012, 0.022)), 4)
        bar = {"shape": "cylinder", "size": [radius, length]}
        up = length / 2
    base = float(heights[0]) + PEDESTAL_M
    yaw = float(rng.uniform(-180.0, 180.0))
    objects: Tree = {
        "pedestal": {
            "shape": "box",
            "size": [0.12, 0.12, round(base, 3)],
            "mass": 1.0,
            "color": "gray",
            "fixed": True,
            "pose": {"xyz": [*spot.round(4).tolist(), round(base / 2, 4)]},
        },
        "bar": bar
        | {
            "mass": round(float(rng.uniform(0.1, 0.5)), 3),
            "color": "orange",
            "pose": {
                "xyz": [*spot.round(4).tolist(), round(round(base, 3) + up, 4)],
                "rpy": [0, 0, round(yaw, 2)],
            },
        },
    }
    speed = round(float(rng.uniform(0.4, 0.7)), 2)
    arms: Tree = {
        "arm1": {
            "robot": giver,
            "gripper": hands[0],
            "base": {"xyz": [0, 0, float(heights[0])], "rpy": [0, 0, round(float(headings[0]), 2)]},
            "tree": {
                "sequence": [
                    {"grasp": {"object": "bar"}},
                    {"hand_over": {"object": "bar", "to": "arm2", "speed": speed}},
                ]
            },
        },
        "arm2": {
            "robot": taker,
            "gripper": hands[1],
            "base": {
                "xyz": [*offset.round(4).tolist(), float(heights[1])],
                "rpy": [0, 0, round(float(headings[1]), 2)],
            },
            "tree": {
                "sequence": [{"take_over": {"object": "bar", "from": "arm1", "speed": speed}}]
            },
        },
    }
    world = {"scene": "empty", "reality": reality, "seed": seed, "time_limit": LIMIT_S}
    return Case(
        seed,
        {"bt_dualarm": 1, "name": "handover", "world": world, "objects": objects, "arms": arms},
    )


class Referee(IdleObserver):
    """True contacts of an object with the hands of ``arm1`` and ``arm2``.

    Args:
        run: Run to judge.
        obj: Name of the object.

    Attributes:
        judges: Whether contacts are judged, see `begin`.
        force_n: Largest force between the arms, N.
        unheld_s: Longest time in which no hand touched the object after it was first lifted, s.
        fell_m: How far the object has fallen while unheld, m.
        touching: Whether the two arms, hands included, have touched each other.
    """

    def __init__(self, run: Run, obj: str = "bar") -> None:
        self._run = run
        self._object = obj
        self._recent = deque[tuple[float, float]]()
        self._generation = -1
        self._since: float | None = None
        self._height = 0.0
        self.judges = False
        self.force_n = 0.0
        self.unheld_s = 0.0
        self.fell_m = 0.0
        self.touching = False

    def begin(self) -> None:
        """Start judging: the giver has the bar."""
        self.judges = True

    def _bind(self) -> None:
        world = self._run.world
        self._generation = world.generation
        count = world.model.ngeom
        self._owner = np.full(count, -1)
        for index, name in enumerate(("arm1", "arm2")):
            if name in world.arms:
                self._owner[list(world.arms[name].geom_ids)] = index
        self._geom = world.object_geom(self._object)

    def after_step(self, time: float) -> None:
        """Evaluate the contacts."""
        if not self.judges:
            return
        world = self._run.world
        if self._generation != world.generation:
            self._bind()
        data = world.data
        geoms = data.contact.geom
        owners = self._owner[geoms]
        is_close = data.contact.dist <= 0.0
        between = (owners.min(axis=1) >= 0) & (owners[:, 0] != owners[:, 1]) & is_close
        self.touching = self.touching or bool(between.any())
        held = (geoms == self._geom).any(axis=1) & (owners.max(axis=1) >= 0) & is_close
        height = float(world.object_pose(self._object).position[2])
        if held.any() or any(not one.by_gripper for one in world.attachments):
            self._since = None
        else:
            if self._since is None:
                self._since = time
                self._height = height
            self.unheld_s = max(self.unheld_s, time - self._since)
            self.fell_m = max(self.fell_m, self._height - height)

    def holds(self, arm: str) -> bool:
        """Whether a hand touches the object now."""
        world = self._run.world
        if arm not in world.arms or not world.attachments.find(arm, self._object):
            return False
        return world.touches(arm, self._object)

    def on_forces(self) -> None:
        """Measure the force of the hand of ``arm2`` on the object while both hands touch it."""
        world = self._run.world
        if not self.judges or self._generation != world.generation:
            return
        data = world.data
        forces = np.zeros((2, 3))
        touched = [False, False]
        buffer = np.empty(6)
        for number, pair in enumerate(data.contact.geom.tolist()):
            if self._geom not in pair:
                continue
            other = pair[0] if pair[1] == self._geom else pair[1]
            owner = int(self._owner[other])
            if owner < 0:
                continue
            mujoco.mj_contactForce(world.model, data, number, buffer)
            force = buffer[:3] @ data.contact.frame[number].reshape(3, 3)
            forces[owner] += force if pair[1] == self._geom else -force
            touched[owner] = True
        if not all(touched):
            self._recent.clear()
            return
        body = world.object_body(self._object)
        weight = -world.model.body_mass[body] * world.model.opt.gravity
        share = float(np.clip(forces[1] @ weight / (weight @ weight), 0.0, 1.0))
        self._recent.append((world.time, float(np.linalg.norm(forces[1] - share * weight))))
        while world.time - self._recent[0][0] > FORCE_S:
            self._recent.popleft()
        if self._recent[-1][0] - self._recent[0][0] > 0.8 * FORCE_S:
            mean = float(np.mean([force for _, force in self._recent]))
            self.force_n = max(self.force_n, mean)


@dataclass(frozen=True)
class PlayedCase:
    """A played case.

    Attributes:
        result: Result of the run.
        referee: True contacts.
        began_s: Simulated time at which the giver had the bar, s; None if it never had.
        excused: Whether the fault took away the only hand that held the bar.
    """

    result: RunResult
    referee: Referee
    began_s: float | None
    excused: bool = False

    def leaf(self, arm: str, skill: str) -> LeafReport | None:
        """The last run of a skill."""
        runs = [leaf for leaf in self.result.arms[arm].runs if leaf.skill == skill]
        return runs[-1] if runs else None

    @property
    def succeeded(self) -> bool:
        """Whether both leaves have succeeded."""
        both = (self.leaf("arm1", "hand_over"), self.leaf("arm2", "take_over"))
        return all(leaf is not None and leaf.status == "SUCCESS" for leaf in both)

    @property
    def dropped(self) -> bool:
        """Whether the bar fell."""
        return self.referee.unheld_s > UNHELD_S


@dataclass(frozen=True)
class Fault:
    """A fault of one arm during a handover.

    Attributes:
        kind: One of `FAULTS`.
        arm: Name of the arm.
        time_s: Simulated time, s.
    """

    kind: str
    arm: str
    time_s: float

    def __str__(self) -> str:
        return f"{self.kind} of {self.arm} at {self.time_s:.2f} s"


def play(case: Case, skills: Registry, fault: Fault | None = None) -> PlayedCase:
    """Play a case.

    Args:
        case: Case to play.
        skills: Skills.
        fault: Fault to inject, if any.
    """
    tree = copy.deepcopy(case.file)
    if fault is not None and fault.kind == "halt":
        arm = tree["arms"][fault.arm]
        arm["tree"] = {"timeout": {"seconds": fault.time_s, "child": arm["tree"]}}
    file = load_tree_file(tree, skills.kinds)
    with ExitStack() as stack:
        run = stack.enter_context(Run(file, skills, RunOptions(renderer="ray")))
        referee = Referee(run)
        run.watch(referee)
        run.world.on_forces.append(referee.on_forces)
        if fault is not None and fault.kind == "crash":
            stack.enter_context(crashing(skills, fault))
        began: float | None = None
        excused = False
        pending = fault
        while not run.done:
            run.step(0.02)
            if run.done:
                break
            if began is None and any(one.object == "bar" for one in run.world.attachments):
                root = run.trees["arm1"].snapshot()
                nodes = [
                    root,
                    *root.children,
                    *(two for one in root.children for two in one.children),
                ]
                if any(node.name == "grasp" and node.status == "SUCCESS" for node in nodes):
                    began = run.time
                    referee.begin()
            if pending is not None and run.time >= pending.time_s:
                other = "arm2" if pending.arm == "arm1" else "arm1"
                excused = pending.kind in ("removal", "lost_grip") and not referee.holds(other)
                if pending.kind == "removal" and pending.arm in run.world.arms:
                    run.world.remove_arm(pending.arm)
                elif pending.kind == "lost_grip":
                    hand = run.world.grippers[pending.arm]
                    spec = hand.gripper
                    hand.command(GripperCommand(spec.stroke, spec.speed.most, spec.force.most))
                pending = None
        return PlayedCase(run.result, referee, began, excused)


@contextmanager
def crashing(skills: Registry, fault: Fault) -> Iterator[None]:
    """Make the skill of an arm raise an error at the time of the fault."""
    skill = skills.skills["hand_over" if fault.arm == "arm1" else "take_over"]
    original = skill.run

    def crash(self: Skill) -> Iterator[object]:
        steps = original(self)
        try:
            for progress in steps:
                if self.time >= fault.time_s:
                    raise RuntimeError("a bug")
                yield progress
        finally:
            steps.close()  # type: ignore[attr-defined]  # it is a generator

    skill.run = crash  # type: ignore[method-assign]
    try:
        yield
    finally:
        skill.run = original  # type: ignore[method-assign]


def undisturbed(seed: int, reality: str) -> dict[str, Any]:
    """Times at which the giver has the bar and both arms have ended without a fault, s."""
    played = play(generate(seed, reality), registry())
    if played.began_s is None or not played.succeeded:
        return {"outcome": "SKIPPED"}
    ends = [played.leaf(*one) for one in (("arm1", "hand_over"), ("arm2", "take_over"))]
    return {
        "began_s": played.began_s,
        "ended_s": max(leaf.ended_s or 0.0 for leaf in ends if leaf is not None),
    }


def disturbed(seed: int, reality: str, kind: str, arm: str, time_s: float) -> dict[str, Any]:
    """Outcome of a case with a fault."""
    case = generate(seed, reality)
    fault = Fault(kind, arm, time_s)
    again = play(case, registry(), fault)
    other = ("arm2", "take_over") if arm == "arm1" else ("arm1", "hand_over")
    leaf = again.leaf(*other)
    found: dict[str, Any] = {
        "line": f"case {case.seed}: {case.label}: {fault}: {other[1]} ",
        "force_n": again.referee.force_n,
        "fell_m": again.referee.fell_m,
        "excused": again.excused,
    }
    if leaf is None or leaf.status not in ("SUCCESS", "FAILURE"):
        return {"outcome": "UNFINISHED", **found}
    return {"code": leaf.code or "SUCCESS", "reason": leaf.reason, **found}


def play_faults(options: argparse.Namespace, campaign: Campaign) -> int:
    """Play each case once with each kind of fault; returns the exit code."""
    rng = np.random.default_rng(options.seed)
    silent = dropped = excused = 0
    forces = list[float]()
    codes = Counter[str]()
    wanted = -(-options.cases // len(FAULTS))
    faults = list[dict[str, Any]]()
    for case, intact in campaign.run(undisturbed, _cases(options), wanted):
        if "began_s" not in intact:
            continue
        for kind in FAULTS:
            arm = str(rng.choice(("arm1", "arm2")))
            time_s = round(float(rng.uniform(intact["began_s"], intact["ended_s"])), 2)
            faults.append({**case, "kind": kind, "arm": arm, "time_s": time_s})
    for fault, found in campaign.run(disturbed, faults):
        line = found["line"]
        forces.append(found["force_n"])
        if "code" not in found:
            silent += 1
            line += "HAS NOT ENDED"
        else:
            codes[f"{fault['kind']}: {found['code']}"] += 1
            line += f"{found['code']}: {found['reason']}"
        if found["fell_m"] > FELL_M:
            excused += found["excused"]
            dropped += not found["excused"]
            line += f"\n    fell {found['fell_m']:.2f} m"
            line += ", as its only hand was gone" if found["excused"] else " AVOIDABLY"
        line += f" ({found['force_n']:.1f} N)"
        print(line, flush=True)
    print(f"{len(faults)} faults in {options.reality}")
    print(f"  the other arm did not end: {silent}")
    print(f"  fell more than {100 * FELL_M:.0f} cm: {dropped} (and {excused} without another hand)")
    print(f"  largest force between the arms: {max(forces, default=0.0):.1f} N")
    for code, count in sorted(codes.items()):
        print(f"  {count:4d}  {code}")
    return 1 if silent or dropped else 0


def _cases(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Arguments of the cases; infinite unless only one case is to be played."""
    if options.only is not None:
        yield {"seed": options.only, "reality": options.reality}
        return
    for seed in itertools.count(options.seed, options.stride):
        yield {"seed": seed, "reality": options.reality}


def handed_over(seed: int, reality: str) -> dict[str, Any]:
    """Outcome of a case and the line to print."""
    case = generate(seed, reality)
    try:
        played = play(case, registry())
    except DualArmError as error:
        return {"outcome": "SKIPPED", "line": f"case {seed}: left out: {error}"}
    if played.began_s is None:
        grasp = played.leaf("arm1", "grasp")
        code = "" if grasp is None else grasp.code
        return {
            "outcome": "SKIPPED",
            "line": f"case {seed}: left out: {case.label}: grasp {code}",
        }
    referee = played.referee
    line = f"case {case.seed}: {case.label}: {'SUCCESS' if played.succeeded else 'FAILURE'}"
    line += f", {referee.force_n:.1f} N"
    found: dict[str, Any] = {"outcome": "FAILURE", "codes": []}
    leaf = played.leaf("arm2", "take_over")
    if played.succeeded and leaf is not None:
        found |= {"outcome": "SUCCESS", "seconds": float(leaf.metrics["handover_s"])}
        line += f", {found['seconds']:.2f} s"
    else:
        for arm, skill in (("arm1", "hand_over"), ("arm2", "take_over")):
            leaf = played.leaf(arm, skill)
            if leaf is not None and leaf.code != "PARTNER_GONE" and leaf.status != "SUCCESS":
                found["codes"].append(f"{skill} {leaf.code}")
                line += f"\n    {skill}: {leaf.code}: {leaf.reason}"
    if played.dropped:
        line += f"\n    DROPPED: unheld for {referee.unheld_s:.2f} s"
    if referee.touching:
        line += "\n    arms touch"
    code = ", ".join(found["codes"])
    forces = {"force_n": referee.force_n, "dropped": played.dropped}
    return {**found, **forces, "code": code, "line": line}


def main() -> int:
    """Play the cases; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--cases", type=int, default=100, help="number of cases that count")
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--reality", default="lab", choices=("ideal", "lab", "rough"))
    parser.add_argument("--faults", action="store_true", help="one arm halts, crashes or is gone")
    parser.add_argument("--only", type=int, help="play only this seed")
    parser.add_argument("--stride", type=int, default=1, help="step from seed to seed")
    add_options(parser)
    options = parser.parse_args()
    with Campaign(options) as campaign:
        return (play_faults if options.faults else play_cases)(options, campaign)


def play_cases(options: argparse.Namespace, campaign: Campaign) -> int:
    """Play cases without faults; returns the exit code."""
    succeeded = dropped = left_out = 0
    forces = list[float]()
    times = list[float]()
    codes = Counter[str]()
    wanted = 1 if options.only is not None else options.cases
    for _, found in campaign.run(handed_over, _cases(options), wanted):
        print(found["line"], flush=True)
        if found["outcome"] == "SKIPPED":
            left_out += 1
            continue
        forces.append(found["force_n"])
        dropped += found["dropped"]
        codes.update(found["codes"])
        if "seconds" in found:
            succeeded += 1
            times.append(found["seconds"])
    counted = len(forces)
    print(f"{counted} handovers in {options.reality} ({left_out} left out)")
    print(f"  succeeded: {succeeded} ({succeeded / max(counted, 1):.1%})")
    print(f"  dropped: {dropped}")
    if forces:
        high = sum(force > 20.0 for force in forces)
        print(
            f"  force between the arms: median {statistics.median(forces):.1f} N, "
            f"largest {max(forces):.1f} N, above 20 N in {high}"
        )
    if times:
        print(
            f"  from the giver's arrival to the lift: median {statistics.median(times):.2f} s, "
            f"largest {max(times):.2f} s"
        )
    for code, count in codes.most_common():
        print(f"  {count:4d}  {code}")
    return 1 if dropped else 0


if __name__ == "__main__":
    sys.exit(main())
