"""Faults of one arm at every tick of a handover and of a joint carry.

    python -m benchmarks.partner_faults [--stride 1] [--tasks handover carry] [--reality lab]
    python -m benchmarks.partner_faults --tasks carry --only 412 --kind crash --arm arm2

The shipped trees `handover` (its first handover) and `carry_together` are played once without a
fault, and then again with one fault at each tick, or at each ``--stride``-th one: the arm is
halted, its skill crashes, it is removed, it loses its grip, or the goal of the other arm moves: the
bar slides by 15 mm in the giver's hand, or the supports of the beam sink by 50 mm. Fault kinds and
arms alternate; with ``--all`` each tick has all of them.

Three laws are checked with the true state of the simulation: the other arm's leaf has to end with
success or a reason, the object must not fall by more than 2 cm, and the force between the arms must
stay within its limit: 20 N in a handover, in a carry the 60 N at which its leaves fail. A fall is
unavoidable if the arm that is removed or loses its grip holds the object alone; for the beam, which
no arm can hold alone, whenever it is in the air. Exits with code 1 if a law is violated.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from benchmarks.campaign import Campaign, add_options, registry
from benchmarks.handover import FELL_M, Referee, Tree
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.behaviors.report import LeafReport
from bt_dualarm.core.share import share_dir
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.outcome import RunResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.grippers import GripperCommand
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry
from bt_dualarm.skill.skill import Skill

KINDS: Final = ("halt", "crash", "removal", "lost_grip", "moved_goal")
ARMS: Final = ("arm1", "arm2")
TICK_S: Final = 0.02
LONGEST_S: Final = 25.0
"""Time after the end of the faultless run by which the other arm has to end, s."""

SLID_M: Final = 0.015
SUNK_M: Final = 0.05
RAISED_M: Final = 0.005
"""Height above the initial one at which the beam counts as in the air, m."""


@dataclass(frozen=True)
class Task:
    """A task of two arms.

    Attributes:
        name: Name of the task.
        skills: Skill of each arm.
        obj: Name of the object.
        supports: Names of the objects on which it is set down.
        held_alone: Whether one arm can hold it.
        limit_n: Largest force between the arms, N.
    """

    name: str
    skills: dict[str, str]
    obj: str
    supports: tuple[str, ...]
    held_alone: bool
    limit_n: float

    def tree(self, reality: str, seed: int) -> Tree:
        """Tree file of the shipped example, cut off after the last leaf of the skill."""
        shipped = "handover" if self.name == "handover" else "carry_together"
        text = Path(share_dir("trees") / f"{shipped}.yaml").read_text(encoding="utf-8")
        file: Tree = yaml.safe_load(text)
        file["world"] |= {"reality": reality, "seed": seed}
        for arm in ARMS:
            leaves = file["arms"][arm]["tree"]["sequence"]
            last = next(i for i, leaf in enumerate(leaves) if self.skills[arm] in leaf)
            file["arms"][arm]["tree"] = {"sequence": leaves[: last + 1]}
        return file


TASKS: Final = {
    "handover": Task("handover", {"arm1": "hand_over", "arm2": "take_over"}, "bar", (), True, 20.0),
    "carry": Task(
        "carry",
        {"arm1": "carry_together", "arm2": "carry_together"},
        "beam",
        ("left", "right"),
        False,
        60.0,
    ),
}


@dataclass(frozen=True)
class Fault:
    """A fault of one arm.

    Attributes:
        kind: One of `KINDS`.
        arm: Name of the arm.
        tick: Number of the tick.
    """

    kind: str
    arm: str
    tick: int

    @property
    def time_s(self) -> float:
        """Simulated time, s."""
        return self.tick * TICK_S

    def __str__(self) -> str:
        return f"{self.kind} of {self.arm} at tick {self.tick}"


@dataclass(frozen=True)
class PlayedTask:
    """A played task.

    Attributes:
        result: Result of the run.
        referee: True contacts.
        began_s: Simulated time at which both leaves have begun, s.
        excused: Whether a fall is unavoidable.
    """

    result: RunResult
    referee: Referee
    began_s: float
    excused: bool

    def leaf(self, arm: str, skill: str) -> LeafReport | None:
        """The run of the skill of an arm."""
        runs = [leaf for leaf in self.result.arms[arm].runs if leaf.skill == skill]
        return runs[-1] if runs else None


def play(
    task: Task, tree: Tree, skills: Registry, longest_s: float, fault: Fault | None
) -> PlayedTask:
    """Play a task.

    Args:
        task: Task to play.
        tree: Its tree file, which is changed.
        skills: Skills.
        longest_s: Simulated time after which the run ends, s.
        fault: Fault to inject, if any.
    """
    if fault is not None and fault.kind == "halt":
        arm = tree["arms"][fault.arm]
        arm["tree"] = {"timeout": {"seconds": fault.time_s, "child": arm["tree"]}}
    file = load_tree_file(tree, skills.kinds)
    excused = False
    with ExitStack() as stack:
        options = RunOptions(renderer="ray", duration=longest_s)
        run = stack.enter_context(Run(file, skills, options))
        referee = Referee(run, task.obj)
        run.watch(referee)
        run.world.on_forces.append(referee.on_forces)
        if fault is not None and fault.kind == "crash":
            stack.enter_context(crashing(skills, task.skills[fault.arm], fault))
        initial_height = float(run.world.object_pose(task.obj).position[2])
        pending = fault
        while not run.done:
            run.step(TICK_S)
            holders = run.world.attachments.holders(task.obj)
            if holders and not referee.judges:
                referee.begin()
            if pending is None or run.done or run.time < pending.time_s - 1e-9:
                continue
            other = ARMS[pending.arm == ARMS[0]]
            in_air = run.world.object_pose(task.obj).position[2] > initial_height + RAISED_M
            if pending.kind in ("removal", "lost_grip"):
                excused = not referee.holds(other) or (in_air and not task.held_alone)
            apply_fault(run.world, task, pending, in_air=bool(in_air))
            pending = None
        result = run.result
    starts = [
        leaf.started_s
        for arm, skill in task.skills.items()
        for leaf in result.arms[arm].runs
        if leaf.skill == skill
    ]
    return PlayedTask(result, referee, max(starts, default=0.0), excused)


def apply_fault(world: World, task: Task, fault: Fault, *, in_air: bool) -> None:
    """Apply a fault to the world; a halt or a crash changes nothing there."""
    if fault.kind == "removal" and fault.arm in world.arms:
        world.remove_arm(fault.arm)
    elif fault.kind == "lost_grip":
        hand = world.grippers[fault.arm]
        spec = hand.gripper
        hand.command(GripperCommand(spec.stroke, spec.speed.most, spec.force.most))
    elif fault.kind == "moved_goal" and task.supports:
        for name in task.supports if in_air else ():
            world.model.body_pos[world.object_body(name), 2] -= SUNK_M
    elif fault.kind == "moved_goal":
        along = world.object_pose(task.obj).rotation_matrix[:, 0]
        start = world.pose_address(task.obj)
        world.data.qpos[start : start + 3] += SLID_M * along


@contextmanager
def crashing(skills: Registry, name: str, fault: Fault) -> Iterator[None]:
    """Make the skill of an arm raise an error at the tick of the fault."""
    skill = skills.skills[name]
    original = skill.run

    def crash(self: Skill) -> Iterator[object]:
        steps: Any = original(self)  # Any: a generator, although declared as an iterator
        try:
            for progress in steps:
                if self.arm.name == fault.arm and self.time >= fault.time_s - 1e-9:
                    steps.throw(RuntimeError("a bug"))
                yield progress
        finally:
            steps.close()

    skill.run = crash  # type: ignore[method-assign]
    try:
        yield
    finally:
        skill.run = original  # type: ignore[method-assign]


class Tally:
    """Results of one task.

    Attributes:
        violations: Number of violated laws, by law.
    """

    def __init__(self, task: Task) -> None:
        self._task = task
        self._count = 0
        self._forces: list[float] = []
        self._codes = Counter[str]()
        self._excused = 0
        self.violations = Counter[str]()

    def judge(self, fault: Fault, found: dict[str, Any]) -> None:
        """Add a result of `faulty`, and print a line about it."""
        self._count += 1
        self._forces.append(found["force_n"])
        self._codes[f"{fault.kind}: {found['ended']}"] += 1
        self._excused += found["excused"] and found["fell_m"] > FELL_M
        self.violations.update(found["laws"])
        other = ARMS[fault.arm == ARMS[0]]
        print(
            f"  {fault}: {other}: {found['ended']} {found['reason']} ({found['force_n']:.1f} N, "
            f"fell {100 * found['fell_m']:.1f} cm"
            f"{', unavoidably' if found['excused'] else ''})"
            + "".join(f" VIOLATION: {law}" for law in found["laws"]),
            flush=True,
        )

    def report(self) -> None:
        """Print the figures."""
        laws = self.violations
        print(f"{self._task.name}: {self._count} faults")
        print(f"  the other arm did not end with a reason: {laws['not ended']}")
        print(
            f"  fell more than {100 * FELL_M:.0f} cm avoidably: {laws['fell']} "
            f"(and {self._excused} unavoidably)"
        )
        print(
            f"  force between the arms: largest {max(self._forces, default=0.0):.1f} N, above "
            f"{self._task.limit_n:.0f} N in {laws['force']}; arms touch each other in "
            f"{laws['touch']}"
        )
        for code, count in sorted(self._codes.items()):
            print(f"  {count:4d}  {code}")


def faults_of(options: argparse.Namespace, began_s: float, ended_s: float) -> Iterator[Fault]:
    """Faults to play, in order."""
    if options.only is not None:
        yield Fault(options.kind, options.arm, options.only)
        return
    # Successive ticks differ in the kind; after all kinds, the arm changes.
    turns = itertools.cycle([(kind, arm) for arm in ARMS for kind in KINDS])
    first = int(np.ceil(began_s / TICK_S)) + 1 + options.offset
    for tick in range(first, int(ended_s / TICK_S), options.stride):
        for kind, arm in itertools.product(KINDS, ARMS) if options.all else (next(turns),):
            yield Fault(kind, arm, tick)


def faultless(task: str, reality: str, seed: int) -> dict[str, float] | None:
    """Times at which both leaves begin and end without a fault, s; None if one of them fails."""
    one = TASKS[task]
    intact = play(one, one.tree(reality, seed), registry(), 120.0, None)
    leaves = [intact.leaf(arm, one.skills[arm]) for arm in ARMS]
    if any(leaf is None or leaf.status != "SUCCESS" for leaf in leaves):
        return None
    ended_s = max(leaf.ended_s or 0.0 for leaf in leaves if leaf is not None)
    return {"began_s": intact.began_s, "ended_s": ended_s}


def faulty(
    task: str, reality: str, seed: int, longest_s: float, kind: str, arm: str, tick: int
) -> dict[str, Any]:
    """Outcome of a run with a fault, and the laws that it violates."""
    one = TASKS[task]
    fault = Fault(kind, arm, tick)
    played = play(one, one.tree(reality, seed), registry(), longest_s, fault)
    referee = played.referee
    other = ARMS[arm == ARMS[0]]
    leaf = played.leaf(other, one.skills[other])
    laws: list[str] = []
    ended = "ended before"  # its tree failed earlier, for example in the grasp
    if leaf is not None:
        ended = leaf.code or leaf.status
        has_ended = leaf.status == "SUCCESS" or bool(leaf.code and leaf.reason)
        if not has_ended or leaf.code in ("HALTED", "EXCEPTION"):
            laws.append("not ended")
    if referee.fell_m > FELL_M and not played.excused:
        laws.append("fell")
    if referee.force_n > one.limit_n:
        laws.append("force")
    if referee.touching:
        laws.append("touch")
    return {
        "outcome": "FAILURE" if laws else "SUCCESS",
        "code": ", ".join(laws),
        "laws": laws,
        "ended": ended,
        "reason": "" if leaf is None else leaf.reason,
        "force_n": referee.force_n,
        "fell_m": referee.fell_m,
        "excused": played.excused,
    }


def main() -> int:
    """Play the faults; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--tasks", nargs="+", choices=tuple(TASKS), default=list(TASKS))
    parser.add_argument("--stride", type=int, default=1, help="ticks from fault to fault")
    parser.add_argument("--offset", type=int, default=0, help="ticks before the first fault")
    parser.add_argument("--all", action="store_true", help="each kind and arm at each tick")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reality", default="lab", choices=("ideal", "lab", "rough"))
    parser.add_argument("--only", type=int, help="play only this tick, with --kind and --arm")
    parser.add_argument("--kind", choices=KINDS, default="halt")
    parser.add_argument("--arm", choices=ARMS, default="arm1")
    add_options(parser)
    options = parser.parse_args()
    with Campaign(options) as campaign:
        return run_tasks(options, campaign)


def run_tasks(options: argparse.Namespace, campaign: Campaign) -> int:
    """Play the faults of each task and print the figures; returns the exit code."""
    is_bad = False
    settings = {"reality": options.reality, "seed": options.seed}
    cases = [{"task": name, **settings} for name in options.tasks]
    for case, intact in list(campaign.run(faultless, cases)):
        if intact is None:
            print(f"{case['task']} fails without a fault")
            is_bad = True
            continue
        tally = Tally(TASKS[case["task"]])
        faults = faults_of(options, intact["began_s"], intact["ended_s"])
        common = {**case, "longest_s": intact["ended_s"] + LONGEST_S}
        for one, found in campaign.run(faulty, [{**common, **asdict(fault)} for fault in faults]):
            tally.judge(Fault(one["kind"], one["arm"], one["tick"]), found)
        tally.report()
        is_bad = is_bad or bool(tally.violations)
    return int(is_bad)


if __name__ == "__main__":
    sys.exit(main())
