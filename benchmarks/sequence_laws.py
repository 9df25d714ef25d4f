"""What must be true of every sequence of skills, whatever it is: judged by the simulator's truth.

A `Referee` looks on while a sequence runs and keeps what was false, of five kinds (`KINDS`): a
SUCCESS that is not so; bookkeeping (what is held, metrics) that differs from the world; a
traceback, a code that no skill may fail with, or a run that does not end; a contact that nobody
asked for; a set-point that jumps, is not finite or breaks a limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np

from benchmarks.sequence_generator import Ports, SkillSequence, Step
from bt_dualarm.behaviors.report import StatusChange
from bt_dualarm.core.errors import Number
from bt_dualarm.core.pose import Pose, Vector, camera_pose
from bt_dualarm.perception.shape_fit import KnownShape
from bt_dualarm.robots.gripper import FINGERS
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.outcome import RunResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.composition import name_of_geom
from bt_dualarm.skill.registry import Registry

ARM: Final = "arm1"
KINDS: Final = ("false success", "bookkeeping", "traceback", "contact", "set-point")

_LOOK_EVERY: Final = 3
"""Steps between two looks at contacts: nothing touches for less than 6 ms."""

_BROKEN_CODES: Final = ("EXCEPTION", "OVERRUN")
_MAY_TOUCH: Final[Mapping[str, str]] = {
    "grasp": "hand and thing",
    "regrasp": "hand and thing",
    "approach_and_attach": "hand and thing",
    "close_gripper": "hand and thing",
    "open_gripper": "hand and thing",
    "release": "hand and thing",
    "detach": "hand and thing",
    "place": "hand and thing",
    "insert": "hand and thing",
    "operate": "hand and thing",
    "move_until_contact": "hand and all",
}
"""Skills whose job it is to touch something, and what the hand and what it holds may touch."""

_AWAY_RAD: Final = 0.03
"""Largest joint error at which a leaf may begin: what leans on something lags behind."""

_ARRIVED_RAD: Final = 0.01
_FALLING_S: Final = 1.5
"""Seconds in which what was let go of may still touch the hand."""

_IN_HAND_M: Final = 0.003
_BELIEF_M: Final = 0.012
_WELD_M: Final = 0.003
_NEAR_M: Final = 0.002


@dataclass(frozen=True)
class Breach:
    """One law that was broken.

    Attributes:
        kind: One of `KINDS`.
        step: Name of the leaf that ran, empty where it was no leaf's.
        what: Sentence with numbers.
    """

    kind: str
    step: str
    what: str


@dataclass
class Begun:
    """What was true when a leaf began.

    Attributes:
        tool: Pose of the tool at the set-point, in the world.
        touching: Pairs that touched.
        held: What the arm was believed to hold.
        poses: True poses of the objects that are free to move.
    """

    tool: Pose
    touching: frozenset[tuple[str, str]]
    held: tuple[str, ...]
    poses: dict[str, Pose]


@dataclass(frozen=True)
class Ended:
    """A leaf that has said SUCCESS.

    Attributes:
        step: What it was asked to do.
        begun: What was true when it began.
        metrics: What it measured.
    """

    step: Step
    begun: Begun
    metrics: Mapping[str, Number]


class Referee(IdleObserver):
    """Looks on.

    Args:
        run: The run, not begun yet.
        sequence: What it runs.

    Attributes:
        breaches: What was false so far.
    """

    def __init__(self, run: Run, sequence: SkillSequence) -> None:
        self.run = run
        self.breaches: list[Breach] = []
        self._steps = {step.name: step for step in sequence.steps}
        self._now: Step | None = None
        self._begun: Begun | None = None
        self._sent: Vector | None = None
        self._generation = -1
        self._steps_made = 0
        self._closed_unnamed = False  # it may then hold what nobody has named
        self._touched: set[tuple[str, str]] = set()
        # What the guarded move before has touched: the hand is a hair above it, or rests on it.
        self._felt: set[tuple[str, str]] = set()
        self._let_go: dict[str, float] = {}
        self._held_before: tuple[str, ...] = ()
        self._said: set[tuple[str, str]] = set()

    # Looking on

    def after_step(self, time: float) -> None:
        """See to set-points each time, to contacts now and then."""
        world = self.run.world
        if ARM not in world.arms:
            return
        self._look_at_setpoint()
        held = world.attachments.attached_to(ARM)
        for obj in self._held_before:
            if obj not in held:
                self._let_go[obj] = time
        self._held_before = held
        self._steps_made += 1
        if self._steps_made % _LOOK_EVERY == 0:
            self._look_at_contacts(time)

    def on_event(self, change: StatusChange) -> None:
        """Note a leaf's beginning, judge its end."""
        if change.arm != ARM:
            return
        step = self._steps.get(change.path.rpartition("/")[2])
        if step is None:
            return
        if change.new == "RUNNING" or self._now is not step:
            self._begin(step)
        if change.new in ("SUCCESS", "FAILURE"):
            self._end(step, change)
            self._now = None

    def _begin(self, step: Step) -> None:
        world = self.run.world
        self._now = step
        self._closed_unnamed |= step.skill == "close_gripper"
        sent = self._controller.setpoint.q
        tool = world.nominal[ARM].tool_pose_at(sent)
        poses = {name: world.object_pose(name) for name in world.objects}
        held = self._held_before
        touching = frozenset((*self._pairs(), *self._near_what_is_held(held), *self._felt))
        self._begun = Begun(tool, touching, held, poses)
        self._touched = set()
        self._felt = set()
        away = float(np.abs(sent - world.arms[ARM].q).max())
        if away > _AWAY_RAD:
            self._say("set-point", f"it begins with the set-point {np.degrees(away):.2f}° away")

    def _end(self, step: Step, change: StatusChange) -> None:
        if step.skill == "move_until_contact":
            self._felt = self._touched
        if change.code in _BROKEN_CODES:
            self._say("traceback", f"{change.code}: {change.reason}")
        for name, value in change.metrics.items():
            if isinstance(value, float) and not math.isfinite(value):
                self._say("bookkeeping", f"metric {name} is {value}")
        world = self.run.world
        if change.new == "SUCCESS":
            judge = getattr(self, f"_judge_{step.skill}", None)
            if judge is not None and self._begun is not None:
                for lie in judge(Ended(step, self._begun, change.metrics)):
                    self._say("false success", lie)
        if ARM not in world.arms:
            return
        for lie in self._holds_truly(change):
            self._say("bookkeeping", lie)

    @property
    def _controller(self) -> Any:  # a part of the run that only a referee needs
        (arm,) = (one for one in self.run.assembly.arms.present if one.name == ARM)
        return arm._controller

    def _say(self, kind: str, what: str) -> None:
        step = self._now.name if self._now else ""
        key = (step, kind + what[:25])
        if key not in self._said:  # a contact lasts many steps
            self._said.add(key)
            self.breaches.append(Breach(kind, step, f"{self.run.time:.2f} s: {what}"))

    # Set-points

    def _look_at_setpoint(self) -> None:
        sent = self._controller.setpoint
        if not (np.isfinite(sent.q).all() and np.isfinite(self.run.world.arms[ARM].q).all()):
            self._say("set-point", "a position is not finite")
            return
        if self._sent is not None and sent.q is not self._sent:
            period = max(self._controller.period, self.run.world.timestep)
            limits = self.run.world.robots[ARM].limits
            jump = float((np.abs(sent.q - self._sent) / (limits.velocity * period)).max())
            if jump > 1.01:
                self._say("set-point", f"it jumps by {jump:.1f} times what the velocity allows")
        self._sent = sent.q

    # Contacts

    def _bind(self) -> None:
        """Name each shape: of the arm ``hand`` or ``link``, another arm, a thing, the scene."""
        world = self.run.world
        self._generation = world.generation
        model = world.model
        body = world.arms[ARM]
        self._names: list[str] = []
        for geom in range(model.ngeom):
            owner = name_of_geom(model, geom)
            if geom in body.tool_geom_ids:
                self._names.append("its hand")
            elif geom in body.geom_ids:
                self._names.append(f"its link {owner.partition('/')[2]}")
            elif owner.startswith(f"{ARM}/") or owner == ARM:
                self._names.append("its pedestal")
            else:
                self._names.append(owner.partition("/")[0])

    def _pairs(self) -> Iterator[tuple[str, str]]:
        """What touches now, of which one is the arm or what it holds; that one first."""
        world = self.run.world
        if ARM not in world.arms or not world.data.ncon:
            return
        if self._generation != world.generation:
            self._bind()
        held = world.attachments.attached_to(ARM)
        contact = world.data.contact
        for first, second in contact.geom[contact.dist <= 0.0].tolist():
            if first < 0 or second < 0:
                continue
            one = self._names[first]
            two = self._names[second]
            for mine, other in ((one, two), (two, one)):
                if (mine.startswith("its ") and mine != "its pedestal") or (
                    mine in held and not other.startswith("its hand")
                ):
                    yield mine, other

    def _near_what_is_held(self, held: tuple[str, ...]) -> Iterator[tuple[str, str]]:
        """What is held, and what is so near that it hardly leaves without a touch: a hole."""
        model = self.run.world.model
        data = self.run.world.data
        if self._generation != self.run.world.generation:
            self._bind()
        for obj in held:
            if obj not in self.run.world.objects:
                continue
            geom = self.run.world.object_geom(obj)
            for other, name in enumerate(self._names):
                if name == obj or name.startswith("its ") or not model.geom_contype[other]:
                    continue
                gap = mujoco.mj_geomDistance(model, data, geom, other, 2.0 * _NEAR_M, None)
                if gap < _NEAR_M:
                    yield obj, name

    def _look_at_contacts(self, time: float) -> None:
        held = self.run.world.attachments.attached_to(ARM)
        for pair in self._pairs():
            self._touched.add(pair)
            if self._now is None or self._begun is None or pair in self._begun.touching:
                continue
            if not self._may_touch(pair, held, time):
                self._say("contact", f"{pair[0]} touches {pair[1]}")

    def _may_touch(self, pair: tuple[str, str], held: tuple[str, ...], time: float) -> bool:
        mine, other = pair
        step = self._now
        if step is None:
            return True
        if mine == "its hand" and other == "its hand":
            return True
        if mine in held and other.startswith("its "):
            return other == "its hand"
        may = _MAY_TOUCH.get(step.skill, "")
        if mine == "its hand":
            if other in held or time - self._let_go.get(other, -math.inf) < _FALLING_S:
                return True
            if may == "hand and all":
                return True
            wanted = {step.ports.get("object"), *(self._begun.held if self._begun else ())}
            return bool(may) and (
                other.partition(".")[0] in wanted  # a part that moves is of its object
                or (step.skill == "close_gripper" and other in self.run.world.objects)
            )
        if mine in held:
            return bool(may)  # it is taken from what it lies on, set down, let go of
        return False

    # What is held

    def _gaps(self, obj: str) -> list[float]:
        """Distances in m of a thing from each finger, or from the hand where it has none."""
        world = self.run.world
        gripper = world.devices.mounted.get(ARM)
        if gripper is None or not gripper.fingers:
            return [world.tool_gap(ARM, obj)]
        geoms = world.object_geoms(obj)
        model = world.model
        gaps = []
        for finger in FINGERS:
            body = model.body(f"{ARM}/{finger}").id
            shapes = [g for g in world.arms[ARM].geom_ids if model.geom_bodyid[g] == body]
            gaps.append(
                min(
                    mujoco.mj_geomDistance(model, world.data, g, geom, 1.0, None)
                    for g in shapes
                    for geom in geoms
                )
            )
        return gaps

    def _is_in_hand(self, obj: str) -> bool:
        return obj in self.run.world.objects and max(self._gaps(obj)) < _IN_HAND_M

    def _holds_truly(self, change: StatusChange) -> Iterator[str]:
        """What the arm is believed to hold, it holds; and as it is believed to lie in the hand."""
        world = self.run.world
        said = f"{change.new} {change.code}".strip()
        for held in world.attachments:
            if held.arm != ARM:
                continue
            if held.object not in world.objects:
                yield f"after {said} it holds {held.object}, which is not in the world"
                continue
            link = world.arms[ARM].tool_link_pose
            pose = link @ held.relative
            away = pose.distance(world.object_pose(held.object))
            limit = _BELIEF_M if held.by_gripper else _WELD_M
            if held.by_gripper and not self._is_in_hand(held.object):
                gap = max(self._gaps(held.object))
                yield f"after {said} {held.object} is believed held and is {1e3 * gap:.1f} mm away"
            elif away > limit and change.new == "SUCCESS":
                yield f"after {said} {held.object} is {1e3 * away:.1f} mm from where it is believed"
        gripped = [one.object for one in world.attachments.gripped_by(ARM)]
        # What has just been let go of has not fallen yet.
        opened = self._now is not None and self._now.skill in ("open_gripper", "release")
        unnamed = self._closed_unnamed or opened
        if not gripped and ARM in world.devices.mounted and not unnamed:
            for obj, spec in world.objects.items():
                welded = world.attachments.find(ARM, obj) is not None
                if not spec.is_free or welded or self._is_held(obj) or not self._is_in_hand(obj):
                    continue
                if not self._rests_on(obj) and self._speed_of(obj) < 0.1:
                    yield f"after {said} {obj} hangs in the hand and is not believed held"
        if len(gripped) > 1:
            yield f"after {said} one gripper is believed to hold {gripped}"

    def _speed_of(self, obj: str) -> float:
        """Speed of a thing in m/s."""
        return float(np.linalg.norm(self.run.world.object_velocity(obj)[3:]))

    # The truth of each skill's SUCCESS

    def _tool(self) -> Pose:
        return self.run.world.arms[ARM].tool_pose

    def _off(self, goal: Pose, meters: float, degrees: float) -> Iterator[str]:
        tool = self._tool()
        away = tool.distance(goal)
        turn = math.degrees(tool.angle(goal))
        if away > meters or turn > degrees:
            yield f"the tool is {1e3 * away:.1f} mm and {turn:.1f}° from its goal"

    def _goal_of(self, ports: Ports, start: Pose) -> Pose:
        if "to" in ports:
            return _pose_of(ports["to"], start)
        return _stepped(ports["offset"], start)

    def _judge_reach_to_pose(self, leaf: Ended) -> Iterator[str]:
        world = self.run.world
        if "posture" in leaf.step.ports:
            goal = world.robots[ARM].postures[leaf.step.ports["posture"]]
            away = float(np.abs(world.arms[ARM].q - goal).max())
            if away > _ARRIVED_RAD:
                yield f"a joint is {np.degrees(away):.2f}° from the posture"
            return
        yield from self._off(self._goal_of(leaf.step.ports, leaf.begun.tool), 0.002, 0.8)

    def _judge_go_home(self, _: Ended) -> Iterator[str]:
        world = self.run.world
        away = float(np.abs(world.arms[ARM].q - world.robots[ARM].postures["home"]).max())
        if away > _ARRIVED_RAD:
            yield f"a joint is {np.degrees(away):.2f}° from home"

    def _judge_move_joints(self, leaf: Ended) -> Iterator[str]:
        error = float(leaf.metrics["joint_error_rad"])
        if error > _ARRIVED_RAD:
            yield f"a joint is {np.degrees(error):.2f}° from its goal"

    def _judge_move_linear(self, leaf: Ended) -> Iterator[str]:
        yield from self._off(self._goal_of(leaf.step.ports, leaf.begun.tool), 0.005, 2.0)

    def _judge_move_through(self, leaf: Ended) -> Iterator[str]:
        goal = leaf.begun.tool
        for pose in leaf.step.ports["poses"]:
            goal = _pose_of(pose, goal)
        yield from self._off(goal, 0.005, 2.0)

    def _judge_rotate_tool(self, leaf: Ended) -> Iterator[str]:
        axis = np.eye(3)["xyz".index(leaf.step.ports["axis"])]
        start = leaf.begun.tool
        turn = Pose.from_rpy((0, 0, 0), tuple(np.radians(leaf.step.ports["angle"]) * axis))
        if leaf.step.ports["frame"] == "tool":
            goal = start @ turn
        else:
            turned = turn @ Pose(np.zeros(3), start.quaternion)
            goal = Pose(start.position, turned.quaternion)
        yield from self._off(goal, 0.005, 2.0)

    def _judge_circle(self, leaf: Ended) -> Iterator[str]:
        wanted = (
            leaf.step.ports["radius"]
            if (leaf.step.ports["start"], leaf.step.ports["end"]) == ("around", "rim")
            else 0.0
        )
        away = self._tool().distance(leaf.begun.tool)
        if abs(away - wanted) > 0.005:
            yield f"it ended {1e3 * away:.1f} mm from where it began, not {1e3 * wanted:.1f} mm"

    def _judge_back(self, leaf: Ended) -> Iterator[str]:
        yield from self._off(leaf.begun.tool, 0.005, 2.0)

    _judge_lissajous = _judge_draw = _judge_follow_path = _judge_back

    def _judge_follow_tool(self, leaf: Ended) -> Iterator[str]:
        error = float(leaf.metrics["follow_max_m"])
        if error > 0.005:
            yield f"its tool was {1e3 * error:.1f} mm from the transform"

    def _judge_hold_still(self, leaf: Ended) -> Iterator[str]:
        yield from self._off(leaf.begun.tool, 0.005, 2.0)

    def _judge_stop(self, _: Ended) -> Iterator[str]:
        speed = float(np.abs(self.run.world.arms[ARM].v).max())
        if speed > 0.03:
            yield f"a joint still moves by {speed:.3f} rad/s"

    def _judge_move_until_contact(self, _: Ended) -> Iterator[str]:
        hand = [
            pair
            for pair in self._touched
            if pair[0] == "its hand" or not pair[0].startswith("its ")
        ]
        if not [pair for pair in hand if not pair[1].startswith("its ")]:
            yield f"nothing was touched: {sorted(self._touched)}"

    def _judge_grasp(self, leaf: Ended) -> Iterator[str]:
        obj = leaf.step.ports["object"]
        if "then_to" in leaf.step.ports:
            obj = f"{obj}.joint"
        if not self._is_in_hand(obj):
            yield f"{obj} is {1e3 * max(self._gaps(obj)):.1f} mm from a finger"
        if not self._is_held(obj):
            yield f"{obj} is not among what is held"
        if self._rests_on(obj) and "lifted_m" in leaf.metrics:
            yield f"{obj} still lies on {self._rests_on(obj)}"

    _judge_regrasp = _judge_grasp

    def _is_held(self, obj: str) -> bool:
        """Whether it is believed held; what comes next may have let go in the very same tick."""
        return obj in (*self._held_before, *self.run.world.attachments.attached_to(ARM))

    def _rests_on(self, obj: str) -> list[str]:
        """What a thing touches besides the hand."""
        world = self.run.world
        if self._generation != world.generation:
            self._bind()
        geom = world.object_geom(obj)
        found = []
        contact = world.data.contact
        for first, second in contact.geom[contact.dist <= 0.0].tolist():
            if geom in (first, second):
                other = self._names[second if first == geom else first]
                if not other.startswith("its "):
                    found.append(other)
        return found

    def _judge_approach_and_attach(self, leaf: Ended) -> Iterator[str]:
        obj = leaf.step.ports["object"]
        if not self._is_held(obj):
            yield f"{obj} is not attached"
        gap = self.run.world.tool_gap(ARM, obj)
        if gap > 0.007:
            yield f"{obj} is {1e3 * gap:.1f} mm from the tool"

    def _judge_detach(self, leaf: Ended) -> Iterator[str]:
        yield from self._was_left(leaf.step.ports["object"])

    def _was_left(self, obj: str) -> Iterator[str]:
        world = self.run.world
        if obj in world.attachments.attached_to(ARM):
            yield f"{obj} is still held"
        speed = self._speed_of(obj)
        if speed > 0.02:
            yield f"{obj} still moves by {speed:.3f} m/s"
        if not self._rests_on(obj):
            yield f"{obj} lies on nothing"

    def _judge_place(self, leaf: Ended) -> Iterator[str]:
        obj = leaf.step.ports.get("object") or next(iter(leaf.begun.held), None)
        if obj is None:
            yield "nothing was held when it began"
            return
        yield from self._was_left(obj)
        yield from self._lies_at(leaf, obj, leaf.step.ports["at"], 0.012, 6.0)

    def _lies_at(
        self, leaf: Ended, obj: str, at: Ports, meters: float, degrees: float
    ) -> Iterator[str]:
        world = self.run.world
        pose = world.object_pose(obj)
        goal = _pose_of(at, leaf.begun.poses[obj])
        away = pose.distance(goal)
        spec = world.objects[obj]
        if "rpy" in at:
            turn = pose.angle(goal)
            if spec.shape != "box":
                turn = KnownShape.of(spec).angle(pose, goal)
        else:  # turned as now: what counts is that it stands
            turn = math.acos(
                min(1.0, abs(float(pose.rotation_matrix[:, 2] @ goal.rotation_matrix[:, 2])))
            )
        if away > meters or math.degrees(turn) > degrees:
            yield f"{obj} is {1e3 * away:.1f} mm and {math.degrees(turn):.1f}° from its goal"
        for name in ("placed_error_m", "object_error_m", "inserted_error_m"):
            text = leaf.metrics.get(name)
            if isinstance(text, float) and abs(text - away) > 0.003:
                self._say(
                    "bookkeeping", f"{name} says {1e3 * text:.1f} mm; it is {1e3 * away:.1f} mm"
                )

    def _judge_insert(self, leaf: Ended) -> Iterator[str]:
        yield from self._lies_at(leaf, "cube", leaf.step.ports["at"], 0.006, 8.0)

    def _judge_operate(self, leaf: Ended) -> Iterator[str]:
        world = self.run.world
        hung = world.joint_of("thing.joint")
        if hung is None:
            yield "there is no joint"
            return
        wrong = world.joint_position("thing.joint") - hung.spec.si(leaf.step.ports["to"])
        if abs(wrong) > (math.radians(3.0) if hung.spec.type == "hinge" else 0.007):
            yield f"its joint is {hung.spec.in_words(wrong)} from its goal"

    def _judge_transport(self, leaf: Ended) -> Iterator[str]:
        obj = leaf.step.ports["object"]
        if not self._is_held(obj):
            yield f"{obj} is not held"
        yield from self._lies_at(leaf, obj, leaf.step.ports["to"], 0.008, 5.0)

    def _judge_close_gripper(self, leaf: Ended) -> Iterator[str]:
        obj = leaf.step.ports.get("object")
        if obj is not None and not self._is_in_hand(obj):
            yield f"{obj} is not between the fingers"

    def _judge_open_gripper(self, _: Ended) -> Iterator[str]:
        gripped = self.run.world.attachments.gripped_by(ARM)
        if gripped:
            yield f"it is still believed to hold {gripped[0].object}"

    _judge_release = _judge_open_gripper

    def _judge_holding(self, leaf: Ended) -> Iterator[str]:
        world = self.run.world
        wanted = leaf.step.ports.get("object")
        things = [wanted] if wanted else list(world.objects)
        if not any(self._is_in_hand(obj) for obj in things):
            yield f"none of {things} is in the hand"

    def _judge_spawn(self, leaf: Ended) -> Iterator[str]:
        world = self.run.world
        if (
            leaf.step.ports.get("object") not in world.objects
            and leaf.step.ports.get("arm") not in world.arms
        ):
            yield "it is not in the world"

    def _judge_remove(self, leaf: Ended) -> Iterator[str]:
        world = self.run.world
        if (
            leaf.step.ports.get("object") in world.objects
            or leaf.step.ports.get("arm") in world.arms
        ):
            yield "it is still in the world"

    # What a camera has seen

    def _seen(self, obj: str) -> Vector:
        """Where a thing is in the true camera: x right, y down, z forward, m."""
        world = self.run.world
        camera = camera_pose(world.data, world.arms[ARM].camera_id)
        return camera.inverse.apply(world.object_pose(obj).position)

    def _is_in_view(self, obj: str) -> Iterator[str]:
        if obj not in self.run.world.objects:
            yield f"{obj} is not in the world"
            return
        x, y, z = self._seen(obj).tolist()
        half = math.tan(math.radians(30.0)) * 1.15
        if not (z > 0 and abs(y) < half * z and abs(x) < half * z * 4 / 3):
            yield f"{obj} is not in the image: at ({x:.2f}, {y:.2f}, {z:.2f}) m from the camera"

    def _judge_look_at(self, leaf: Ended) -> Iterator[str]:
        world = self.run.world
        camera = camera_pose(world.data, world.arms[ARM].camera_id)
        x, y, z = camera.inverse.apply(np.array(leaf.step.ports["at"]["xyz"])).tolist()
        if math.hypot(x, y) > 0.02 or abs(z - leaf.step.ports["distance"]) > 0.02:
            yield f"the point is at ({x:.3f}, {y:.3f}, {z:.3f}) m from the camera"

    def _judge_wait_for(self, _: Ended) -> Iterator[str]:
        yield from self._is_in_view("other")

    def _judge_track(self, _: Ended) -> Iterator[str]:
        yield from self._is_in_view("other")

    def _judge_count(self, leaf: Ended) -> Iterator[str]:
        there = sum(name == "other" for name in self.run.world.objects)
        found = int(leaf.metrics["found"])
        if found > there:
            yield f"it counts {found} of {there}"

    def _judge_locate(self, leaf: Ended) -> Iterator[str]:
        error = leaf.metrics.get("located_error_m")
        if "other" not in self.run.world.objects:
            yield "what it located is not in the world"
        elif isinstance(error, float) and error > 0.012:
            yield f"it is {1e3 * error:.1f} mm from where it was located"

    def _judge_scan(self, _: Ended) -> Iterator[str]:
        yield from self._is_in_view("other")

    def _judge_calibrate(self, _: Ended) -> Iterator[str]:
        world = self.run.world
        body = world.arms[ARM]
        text = world.nominal[ARM].camera_pose_at(body.q)
        true = camera_pose(world.data, body.camera_id)
        away = text.distance(true)
        turn = math.degrees(text.angle(true))
        if away > 0.01 or turn > 2.0:
            yield f"the camera is {1e3 * away:.1f} mm and {turn:.2f}° from where it is believed"


def verdicts_at_the_end(result: RunResult, registry: Registry) -> list[Breach]:
    """What is to be said of a run that is over: it ended, and each leaf with a code that it may."""
    breaches = []
    if result.outcome != "SUCCESS":
        faults = "; ".join(arm.fault for arm in result.arms.values() if arm.fault)
        what = f"the run ended as {result.outcome}: {result.ending} {result.error} {faults}"
        breaches.append(Breach("traceback", "", what.strip()))
    for arm in result.arms.values():
        if arm.clipped_setpoints:
            what = f"{arm.name}: {arm.clipped_setpoints} set-points were clipped"
            breaches.append(Breach("set-point", "", what))
        for leaf in arm.runs:
            skill = registry.skills.get(leaf.skill)
            if skill is None or leaf.status != "FAILURE" or leaf.code in _BROKEN_CODES:
                continue
            if not skill.declares(leaf.code):
                breaches.append(Breach("traceback", leaf.path, f"undeclared {leaf.code}"))
    return breaches


def _pose_of(written: dict[str, list[float]], current: Pose) -> Pose:
    if "rpy" in written:
        return Pose.from_rpy(written["xyz"], np.radians(written["rpy"]).tolist())
    return Pose(np.array(written["xyz"]), current.quaternion)


def _stepped(offset: dict[str, object], tool: Pose) -> Pose:
    xyz = np.array(offset["xyz"], dtype=float)
    if offset["frame"] == "tool":
        return Pose(tool.apply(xyz), tool.quaternion)
    return Pose(tool.position + xyz, tool.quaternion)
