"""Scenarios in which an object does not stay where a skill leaves it: is one a false SUCCESS?

    python -m benchmarks.false_success_cases [--only place detach ...]

In each scenario the world, or an intervention in it, prevents the object from being or staying
where `place`, `detach`, `transport`, `insert` or `regrasp` should leave it. A SUCCESS is false if
the true error of the object exceeds the skill's own tolerance when the leaf ends or a second later,
or if the tool still bears it. Exits with code 1 if there is one, or if a leaf ends with an
exception.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

import bt_dualarm as bt
from benchmarks.campaign import Campaign, add_options
from bt_dualarm.behaviors.report import LeafReport, StatusChange
from bt_dualarm.core.pose import Pose
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.sim.world import World

Change = Callable[[World], None]
"""An instantaneous change of the world."""

THING: Final = "thing"
TABLE: Final = 0.40
CUBE: Final = {"shape": "box", "size": [0.05, 0.05, 0.05], "mass": 0.2}
TALL: Final = {"shape": "box", "size": [0.04, 0.04, 0.12], "mass": 0.2}
BALL: Final = {"shape": "sphere", "size": [0.025], "mass": 0.1}
CAN: Final = {"shape": "cylinder", "size": [0.025, 0.10], "mass": 0.2}
START: Final = (0.40, -0.45)
GOAL: Final = (0.28, -0.42)


@dataclass(frozen=True)
class Case:
    """One scenario.

    Attributes:
        name: What happens.
        skill: Skill whose leaf is judged.
        obj: The object, without its pose; `standing` gives half its height.
        leaves: Leaves of the arm; the last one is judged.
        goal: Goal pose of the object.
        around: Other objects.
        intervention: Intervention, called at each step from its start until it returns True.
        begins: Start of the intervention: ``("released" or "held", seconds after that)``.
        gripper: Name of the gripper, None for a tool that welds.
        tolerance: Largest distance of the object from the goal, m.
        start: Initial position of the object, m; None for the default one on the table.
    """

    name: str
    skill: str
    obj: Mapping[str, Any]
    leaves: Sequence[Mapping[str, Any]]
    goal: Pose
    around: Mapping[str, Any] = field(default_factory=dict)
    intervention: Callable[[World], bool] | None = None
    begins: tuple[str, float] = ("released", 0.0)
    gripper: str | None = "robotiq_2f85"
    tolerance: float = 0.008
    start: tuple[float, float, float] | None = None


def standing(obj: Mapping[str, Any]) -> float:
    """Half of the height of an object that stands upright, m."""
    size = obj["size"]
    halves = {"box": 0.5 * size[-1], "cylinder": 0.5 * size[-1], "sphere": size[0]}
    return float(halves[obj["shape"]])


def fixed(shape: str, size: Sequence[float], xyz: Sequence[float], **pose: Any) -> dict[str, Any]:
    """A fixed object."""
    full_pose = {"xyz": list(xyz)} | pose
    return {"shape": shape, "size": list(size), "mass": 5, "fixed": True, "pose": full_pose}


# Interventions


def once(intervention: Change) -> Callable[[World], bool]:
    """Make a change as an intervention that is done after one call."""

    def do(world: World) -> bool:
        intervention(world)
        return True

    return do


def displace(dx: float = 0.0, dy: float = 0.0, dz: float = 0.0) -> Callable[[World], bool]:
    """Displace the object in the world."""

    def move(world: World) -> None:
        start = world.pose_address(THING)
        world.data.qpos[start : start + 3] += (dx, dy, dz)

    return once(move)


def slide_object(across: float, along: float = 0.0) -> Callable[[World], bool]:
    """Slide the object between the pads, across and along the tool."""

    def slide(world: World) -> None:
        axes = world.arms["arm1"].tool_pose.rotation_matrix
        start = world.pose_address(THING)
        world.data.qpos[start : start + 3] += across * axes[:, 0] + along * axes[:, 2]

    return once(slide)


def turn_object(degrees: float, axis: int = 1) -> Callable[[World], bool]:
    """Turn the object in the hand about an axis of the tool; axis 1 leads from pad to pad."""

    def turn(world: World) -> None:
        about = world.arms["arm1"].tool_pose.rotation_matrix[:, axis] * np.radians(degrees)
        angle = float(np.linalg.norm(about))
        half = np.array((np.cos(angle / 2), *(np.sin(angle / 2) * about / angle)))
        pose = world.object_pose(THING)
        start = world.pose_address(THING)
        new = Pose(np.zeros(3), half) @ Pose(np.zeros(3), pose.quaternion)
        world.data.qpos[start + 3 : start + 7] = new.quaternion

    return once(turn)


def kick_object(
    vx: float, vy: float = 0.0, vz: float = 0.0, spin: float = 0.0
) -> Callable[[World], bool]:
    """Give the object a velocity."""

    def kick(world: World) -> None:
        joint = world.model.body_jntadr[world.object_body(THING)]
        start = world.model.jnt_dofadr[joint]
        world.data.qvel[start : start + 3] += (vx, vy, vz)
        world.data.qvel[start + 4] += spin

    return once(kick)


def stick_to_tool(seconds: float, pressed: float = 0.0) -> Callable[[World], bool]:
    """Make the object stick to the tool for some time, pressed into it by some meters."""
    began: list[tuple[float, Pose]] = []

    def stick(world: World) -> bool:
        tool = world.arms["arm1"].tool_pose
        if not began:
            in_tool = tool.inverse @ world.object_pose(THING)
            into = Pose.from_rpy((0.0, 0.0, -pressed), (0.0, 0.0, 0.0))
            began.append((world.time, into @ in_tool))
        since, in_tool = began[0]
        pose = tool @ in_tool
        start = world.pose_address(THING)
        world.data.qpos[start : start + 7] = (*pose.position, *pose.quaternion)
        joint = world.model.body_jntadr[world.object_body(THING)]
        first = world.model.jnt_dofadr[joint]
        world.data.qvel[first : first + 6] = 0.0
        return world.time - since >= seconds

    return stick


def sink_ground(name: str, lower: float) -> Callable[[World], bool]:
    """Lower the object's support."""

    def sink(world: World) -> None:
        world.model.body_pos[world.object_body(name), 2] -= lower

    return once(sink)


def remove(world: World) -> bool:
    """Remove the object from the world."""
    world.remove_object(THING)
    return True


# Leaves

GRASP: Final = {"grasp": {"object": THING}}
PICK: Final = {"approach_and_attach": {"object": THING}}
CARRY: Final = {"transport": {"object": THING, "to": {"xyz": [0.30, -0.40, 0.60]}}}


def place(goal: Pose, **ports: Any) -> dict[str, Any]:
    """A leaf that places the object at a goal."""
    at = {"xyz": goal.position.tolist(), "quat": goal.quaternion.tolist()}
    return {"place": {"object": THING, "at": at} | ports}


def pose(x: float, y: float, z: float, *rpy: float) -> Pose:
    """A pose, with angles in degrees."""
    return Pose.from_rpy((x, y, z), tuple(np.radians(rpy or (0.0, 0.0, 0.0)).tolist()))


def placing(name: str, obj: Mapping[str, Any], goal: Pose, **more: Any) -> Case:
    """Scenario in which an object is grasped and placed."""
    before = more.pop("before", (GRASP,))
    return Case(name, "place", obj, (*before, place(goal)), goal, **more)


def on_table(obj: Mapping[str, Any], x: float = GOAL[0], y: float = GOAL[1]) -> Pose:
    """Pose of an upright object on the table."""
    return pose(x, y, TABLE + standing(obj))


def place_cases() -> Iterator[Case]:
    """Scenarios in which an object does not stay where `place` leaves it."""
    for beyond in (-0.001, 0.004, 0.015, 0.035):
        goal = on_table(CUBE, y=-0.25 + beyond)
        yield placing(f"{1e3 * beyond:.0f} mm beyond the edge", CUBE, goal)
    yield placing("tall, at the corner", TALL, on_table(TALL, x=0.052, y=-0.252))
    for radius in (0.02, 0.03, 0.05):
        ball = fixed("sphere", [radius], (*GOAL, TABLE + radius))
        top = TABLE + 2 * radius
        name = f"on a ball of {1e3 * radius:.0f} mm"
        goal = pose(*GOAL, top + 0.025)
        yield placing(name, CUBE, goal, around={"ball": ball})
        yield placing(f"a ball {name}", BALL, goal, around={"ball": ball})
    roll = fixed("cylinder", [0.03, 0.1], (*GOAL, TABLE + 0.03), rpy=[90, 0, 0])
    yield placing("across a pipe", TALL, pose(*GOAL, TABLE + 0.12), around={"pipe": roll})
    for slope in (8.0, 20.0):
        ramp = fixed("box", [0.15, 0.15, 0.02], (*GOAL, TABLE + 0.05), rpy=[0, slope, 0])
        goal = pose(*GOAL, TABLE + 0.06 / np.cos(np.radians(slope)) + 0.025)
        yield placing(f"level above a slope of {slope:.0f}°", CUBE, goal, around={"ramp": ramp})
    for slope, obj in ((3.0, BALL), (45.0, CUBE)):
        ramp = fixed("box", [0.15, 0.15, 0.02], (*GOAL, TABLE + 0.08), rpy=[0, slope, 0])
        face = pose(*GOAL, TABLE + 0.08, 0, slope, 0) @ pose(0, 0, 0.01 + standing(obj))
        name = f"{obj['shape']} along a slope of {slope:.0f}°"
        yield placing(name, obj, face, around={"ramp": ramp})
    for thick, off in ((0.004, 0.0), (0.01, 0.003), (0.02, 0.012)):
        wall = fixed("box", [thick, 0.1, 0.08], (*GOAL, TABLE + 0.04))
        goal = pose(GOAL[0] + off, GOAL[1], TABLE + 0.08 + 0.025)
        name = f"on a wall of {1e3 * thick:.0f} mm, {1e3 * off:.0f} mm off"
        yield placing(name, CUBE, goal, around={"wall": wall})
    shelf = fixed("box", [0.10, 0.10, 0.02], (*GOAL, TABLE + 0.05))
    goal = pose(GOAL[0] + 0.052, GOAL[1], TABLE + 0.06 + 0.06)
    yield placing("half over a board", TALL, goal, around={"shelf": shelf})
    loose = BALL | {"size": [0.03], "pose": {"xyz": [*GOAL, TABLE + 0.03]}}
    goal = pose(*GOAL, TABLE + 0.06 + 0.025)
    yield placing("on a loose ball", CUBE, goal, around={"loose": loose})
    goal = on_table(CUBE)
    yield placing(
        "pushed when released", CUBE, goal, intervention=kick_object(0.5), begins=("released", 0.2)
    )
    yield placing(
        "pushed lightly", CUBE, goal, intervention=displace(0.012), begins=("released", 0.4)
    )
    tall = on_table(TALL)
    yield placing(
        "knocked over", TALL, tall, intervention=kick_object(0.8), begins=("released", 0.4)
    )
    round_goal = on_table(BALL)
    yield placing(
        "a ball that rolls",
        BALL,
        round_goal,
        intervention=kick_object(0.4),
        begins=("released", 0.4),
    )
    yield placing(
        "a ball that creeps",
        BALL,
        round_goal,
        intervention=kick_object(0.04),
        begins=("released", 0.8),
    )
    under = {"shelf": shelf}
    high = pose(*GOAL, TABLE + 0.06 + 0.025)
    sunk = sink_ground("shelf", 0.04)
    yield placing(
        "its ground sinks", CUBE, high, around=under, intervention=sunk, begins=("released", 0.6)
    )
    lost = sink_ground("shelf", 0.05)
    yield placing(
        "no ground any more", CUBE, high, around=under, intervention=lost, begins=("held", 0.5)
    )
    for seconds in (0.4, 2.2, 60.0):
        name = f"sticks to a finger for {seconds:g} s"
        yield placing(name, CUBE, goal, intervention=stick_to_tool(seconds))
    for seconds in (1.3, 2.5, 60.0):
        intervention = stick_to_tool(seconds, 5e-4)
        name = f"sticks to the cup for {seconds:g} s"
        yield placing(
            name,
            CUBE,
            goal,
            intervention=intervention,
            gripper="suction_cup",
            begins=("released", 0.2),
        )
    yield placing("taken away", CUBE, goal, intervention=remove, begins=("released", 0.6))
    for off in (0.012, 0.02):
        at = {"xyz": [START[0] + off, START[1], TABLE + 0.06], "rpy": [0, 0, 0]}
        grasp = {"grasp": {"at": at, "width": 0.04, "height": 0.12, "depth": 0.04}}
        there = {"place": {"at": {"xyz": tall.position.tolist(), "rpy": [0, 0, 0]}}}
        name = f"held {1e3 * off:.0f} mm off its center"
        yield Case(name, "place", TALL, (grasp, there), tall)
    for across in (0.01, 0.014):
        name = f"slid by {1e3 * across:.0f} mm in the hand"
        yield placing(name, CUBE, goal, intervention=slide_object(across), begins=("held", 1.0))
    for angle in (12.0, 20.0):
        name = f"tilted by {angle:.0f}° in the hand"
        yield placing(name, TALL, tall, intervention=turn_object(angle), begins=("held", 1.0))
    yield placing(
        "turned about the tool", TALL, tall, intervention=turn_object(12, 2), begins=("held", 1.0)
    )


def transport_cases() -> Iterator[Case]:
    """Scenarios in which a carried object is not at its goal."""
    goal = pose(0.30, -0.40, 0.60)
    to = {"xyz": goal.position.tolist(), "rpy": [0, 0, 0]}
    leaves = (GRASP, {"transport": {"object": THING, "to": to, "speed": 0.3}})
    for name, obj, intervention in (
        ("slid by 6 mm", CUBE, slide_object(0.006)),
        ("slid by 15 mm", TALL, slide_object(0.015)),
        ("slid down by 15 mm", TALL, slide_object(0.0, 0.015)),
        ("tilted by 5°", TALL, turn_object(5.0)),
        ("tilted by 20°", TALL, turn_object(20.0)),
        ("turned about the tool", TALL, turn_object(6.0, 2)),
        ("fell out", CUBE, displace(0.3, 0.0, 0.2)),
        ("taken away", CUBE, remove),
    ):
        yield Case(
            name, "transport", obj, leaves, goal, {}, intervention, ("held", 0.7), tolerance=0.005
        )


def detach_cases() -> Iterator[Case]:
    """Scenarios in which a detached object does not stay."""

    def let_go(name: str, goal: Pose, obj: Mapping[str, Any] = CUBE, **more: Any) -> Case:
        to = {"xyz": goal.position.tolist(), "quat": goal.quaternion.tolist()}
        leaves = (PICK, {"transport": {"object": THING, "to": to}}, {"detach": {"object": THING}})
        ends = {"gripper": None, "tolerance": 0.01} | more
        return Case(name, "detach", obj, leaves, goal, **ends)

    yield let_go("in the air", pose(0.30, -0.40, 0.55))
    yield let_go("20 mm above the table", pose(0.30, -0.40, TABLE + 0.045))
    yield let_go("beyond the edge", pose(0.30, -0.24, TABLE + 0.026))
    ball = fixed("sphere", [0.03], (*GOAL, TABLE + 0.03))
    yield let_go("on a ball", pose(GOAL[0] + 0.004, GOAL[1], TABLE + 0.087), around={"b": ball})
    wall = fixed("box", [0.02, 0.1, 0.08], (*GOAL, TABLE + 0.04))
    yield let_go("on a wall", pose(GOAL[0] + 0.015, GOAL[1], TABLE + 0.106), around={"w": wall})
    yield let_go(
        "pushed",
        pose(*GOAL, TABLE + 0.026),
        intervention=kick_object(1.0),
        begins=("released", 0.02),
    )
    rolls = pose(*GOAL, TABLE + 0.026)
    yield let_go("a ball", rolls, BALL, intervention=kick_object(0.05), begins=("released", 0.05))
    yield let_go("stuck in the air", pose(0.30, -0.40, 0.55), intervention=stick_to_tool(60.0))
    held = (GRASP, CARRY, {"detach": {"object": THING}})
    yield Case("the fingers are shut", "detach", CUBE, held, pose(0.30, -0.40, 0.60))


def insert_cases() -> Iterator[Case]:
    """Scenarios in which an object is not in its hole after `insert`."""
    goal = pose(0.25, -0.45, TABLE + 0.025)
    at = {"xyz": goal.position.tolist(), "rpy": [0, 0, 0]}
    leaves = (GRASP, {"insert": {"object": THING, "at": at, "depth": 0.012}})
    for name, intervention in (
        ("slid across by 7 mm", slide_object(0.007)),
        ("slid across by 14 mm", slide_object(0.014)),
        ("slid out by 6 mm", slide_object(0.0, 0.006)),
        ("slid in by 6 mm", slide_object(0.0, -0.006)),
        ("tilted by 8°", turn_object(8.0)),
        ("turned about the tool", turn_object(8.0, 2)),
        ("taken away", remove),
    ):
        yield Case(
            name, "insert", CUBE, leaves, goal, {}, intervention, ("held", 0.8), tolerance=0.0048
        )


def regrasp_cases() -> Iterator[Case]:
    """Scenarios in which an object does not stay where `regrasp` sets it down, or is not taken."""
    goal = pose(*START, TABLE + 0.06)
    leaves = (GRASP, {"regrasp": {"object": THING}})
    for name, intervention, begins in (
        ("slid by 14 mm", slide_object(0.014), ("held", 0.5)),
        ("tilted by 20°", turn_object(20.0), ("held", 0.5)),
        ("pushed by 15 mm", displace(0.015), ("released", 0.4)),
        ("knocked over", kick_object(0.8), ("released", 0.9)),
        ("moved before it is taken", displace(0.0, 0.02), ("released", 3.0)),
        ("taken away", remove, ("released", 1.0)),
        ("put far away", displace(0.3, 0.0, 0.05), ("released", 3.0)),
    ):
        yield Case(name, "regrasp", TALL, leaves, goal, {}, intervention, begins, tolerance=0.01)
    edge = {"regrasp": {"object": THING, "at": {"xyz": [0.30, -0.249, TABLE + 0.06]}}}
    yield Case("at the edge", "regrasp", TALL, (GRASP, edge), goal)


def cases() -> list[Case]:
    """All scenarios."""
    makers = (place_cases, transport_cases, detach_cases, insert_cases, regrasp_cases)
    return [case for maker in makers for case in maker()]


class Hand(IdleObserver):
    """Intervenes as a case demands, and checks the true state when the judged leaf ends.

    Attributes:
        deviations: Errors of the true state after a SUCCESS, as sentences.
        errors: Exceptions of the interventions and checks.
    """

    def __init__(self, world: World, case: Case) -> None:
        self._world = world
        self._case = case
        self._since: float | None = None
        self._held = self._done = False
        self._began_s = 0.0
        self._succeeded_s: float | None = None
        self.deviations: list[str] = []
        self.errors: list[Exception] = []

    def on_event(self, change: StatusChange) -> None:
        """Check the true state when the judged leaf succeeds."""
        if change.kind == self._case.skill and change.new == "SUCCESS":
            self._succeeded_s = change.time
            self._judge("when it ended")

    def after_step(self, time: float) -> None:
        """Intervene when it is time; an observer that raises would be dropped."""
        try:
            self._intervene(time)
            if self._succeeded_s is not None and time >= self._succeeded_s + 1.0:
                self._succeeded_s = None
                self._judge("a second later")
        except Exception as error:  # noqa: BLE001 - raised again when the run is over
            self.errors.append(error)
            self._done = True

    def _intervene(self, time: float) -> None:
        case = self._case
        world = self._world
        if case.intervention is None or self._done:
            return
        holds = any(one.arm == "arm1" for one in world.attachments)
        if holds and not self._held:
            self._held = True
            self._began_s = time
        event, delay = case.begins
        if self._since is None and self._held:
            if event == "held" and time - self._began_s >= delay + 0.5:
                self._since = time
            if event == "released" and not holds:
                self._since = time + delay
        if self._since is not None and time >= self._since:
            self._done = case.intervention(world)

    def _judge(self, when: str) -> None:
        case = self._case
        world = self._world
        if THING not in world.objects:
            self.deviations.append(f"{when}: it is not there")
            return
        true = world.object_pose(THING)
        goal = case.goal
        if case.skill == "regrasp":
            held = world.attachments.find("arm1", THING)
            if held is None:
                self.deviations.append(f"{when}: it is not held")
                return
            goal = world.arms["arm1"].tool_link_pose @ held.relative
        away = true.distance(goal)
        turn = bt.KnownShape(case.obj["shape"], tuple(case.obj["size"])).angle(true, goal)
        if away > case.tolerance + 1e-3:
            self.deviations.append(f"{when}: it is {1e3 * away:.1f} mm away")
        if case.skill != "detach" and turn > np.radians(6.0):
            self.deviations.append(f"{when}: it is turned by {np.degrees(turn):.1f}°")
        if case.skill == "place" and world.touches("arm1", THING):
            self.deviations.append(f"{when}: the tool touches it")


def file_of(case: Case) -> dict[str, Any]:
    """The tree file of a case."""
    full_pose = case.start or (*START, TABLE + standing(case.obj) + 5e-4)
    arm: dict[str, Any] = {"robot": "ur5", "base": {"xyz": [0, 0, TABLE]}}
    if case.gripper:
        arm["gripper"] = case.gripper
    *before, last = case.leaves
    tree = {"sequence": [*before, {"force_success": {"child": last}}, {"wait": {"seconds": 1.2}}]}
    return {
        "bt_dualarm": 1,
        "name": "ways",
        "world": {"scene": "table", "reality": "lab", "seed": 0, "time_limit": 90},
        "objects": {THING: dict(case.obj) | {"pose": {"xyz": list(full_pose)}}, **case.around},
        "arms": {"arm1": arm | {"tree": tree}},
    }


def play(case: Case) -> tuple[LeafReport, list[str]]:
    """The judged leaf, or the one that failed before it, and the errors after a SUCCESS."""
    with bt.open(file_of(case)) as opened:
        hand = Hand(opened.world, case)
        opened.watch(hand)
        result = opened.finish()
    if hand.errors:
        raise hand.errors[0]
    runs = [leaf for leaf in result.arms["arm1"].runs if leaf.skill != "wait"]
    return runs[-1], hand.deviations


def evaluate(skill: str, name: str) -> dict[str, Any]:
    """Result of a case, and the errors of a false SUCCESS."""
    case = next(case for case in cases() if (case.skill, case.name) == (skill, name))
    leaf, deviations = play(case)
    status = f"{leaf.status} {leaf.code or ''}".strip()
    return {
        "outcome": "FALSE_SUCCESS" if deviations else "SUCCESS",
        "code": leaf.code,
        "skill": leaf.skill,
        "stayed": leaf.skill == skill and leaf.status == "SUCCESS" and not deviations,
        "message": f"{leaf.skill}: {status} {leaf.reason}",
        "deviations": deviations,
    }


def main() -> int:
    """Print all cases and the totals; returns 1 after a false SUCCESS or an exception."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--only", nargs="+", default=[], help="skills, or words of the names")
    add_options(parser)
    options = parser.parse_args()
    chosen = [
        {"skill": case.skill, "name": case.name}
        for case in cases()
        if not options.only or any(word in (case.skill, case.name) for word in options.only)
    ]
    false = stayed = elsewhere = exceptions = 0
    with Campaign(options) as campaign:
        for case, found in campaign.run(evaluate, chosen):
            exceptions += found["code"] == "EXCEPTION"
            elsewhere += found["skill"] != case["skill"]
            stayed += found["stayed"]
            false += bool(found["deviations"])
            print(f"{case['skill']:10} {case['name']:36} {found['message']}", flush=True)
            for deviation in found["deviations"]:
                print(f"    FALSE: {deviation}", flush=True)
        print(
            f"{len(chosen)} cases: {false} false SUCCESS; {stayed} stayed nevertheless, "
            f"{elsewhere} failed before, {exceptions} exceptions"
        )
        return 1 if false or exceptions else 0


if __name__ == "__main__":
    sys.exit(main())
