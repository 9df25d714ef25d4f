"""Laws for every sequence of skills, checked against the true state of the simulator.

A `Referee` observes a running sequence and records breaches of five kinds (`KINDS`): a false
SUCCESS; bookkeeping (held objects, metrics) that differs from the world; a traceback, an undeclared
failure code, or a run that does not end; an unexpected contact; a set-point that jumps, is not
finite or exceeds a limit.
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
from bt_dualarm.perception.known_shape import KnownShape
from bt_dualarm.robots.gripper import FINGERS
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.outcome import RunResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.composition import name_of_geom
from bt_dualarm.skill.registry import Registry

ARM: Final = "arm1"
KINDS: Final = ("false success", "bookkeeping", "traceback", "contact", "set-point")

_CONTACT_STEPS: Final = 3
"""Steps between two checks of contacts: no contact is shorter than 6 ms."""

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
"""Skills that are meant to touch something, and what the hand and a held object may touch."""

_START_ERROR_RAD: Final = 0.03
"""Largest joint error at which a leaf may begin: an arm that presses on something lags behind."""

_ARRIVED_RAD: Final = 0.01
_FALLING_S: Final = 1.5
"""Seconds during which a released object may still touch the hand."""

_IN_HAND_M: Final = 0.003
_BELIEF_M: Final = 0.012
_WELD_M: Final = 0.003
_NEAR_M: Final = 0.002


@dataclass(frozen=True)
class Breach:
    """One law that was broken.

    Attributes:
        kind: One of `KINDS`.
        step: Name of the running leaf, or empty.
        what: Description with numbers.
    """

    kind: str
    step: str
    what: str


@dataclass
class LeafStart:
    """True state when a leaf begins.

    Attributes:
        tool: Pose of the tool at the set-point, in the world.
        touching: Pairs in contact.
        held: Objects that the arm holds according to the bookkeeping.
        poses: True poses of the objects.
    """

    tool: Pose
    touching: frozenset[tuple[str, str]]
    held: tuple[str, ...]
    poses: dict[str, Pose]


@dataclass(frozen=True)
class SuccessfulLeaf:
    """A leaf that has ended with SUCCESS.

    Attributes:
        step: Skill and ports of the leaf.
        begun: True state when it began.
        metrics: Metrics of the leaf.
    """

    step: Step
    begun: LeafStart
    metrics: Mapping[str, Number]


class Referee(IdleObserver):
    """Checks the laws during a run.

    Args:
        run: The run, before it begins.
        sequence: The sequence that it runs.

    Attributes:
        breaches: Breaches so far.
    """

    def __init__(self, run: Run, sequence: SkillSequence) -> None:
        self.run = run
        self.breaches: list[Breach] = []
        self._steps = {step.name: step for step in sequence.steps}
        self._now: Step | None = None
        self._begun: LeafStart | None = None
        self._sent: Vector | None = None
        self._generation = -1
        self._step_count = 0
        self._closed_unnamed = False  # the hand may then hold an unnamed object
        self._touched: set[tuple[str, str]] = set()
        # Contacts of the previous guarded move, which the hand may still touch.
        self._guarded_contacts: set[tuple[str, str]] = set()
        self._released_s: dict[str, float] = {}
        self._held_before: tuple[str, ...] = ()
        self._reported: set[tuple[str, str]] = set()

    # Looking on

    def after_step(self, time: float) -> None:
        """Check set-points in every step, and contacts every few steps."""
        world = self.run.world
        if ARM not in world.arms:
            return
        self._check_setpoint()
        held = world.attachments.attached_to(ARM)
        for obj in self._held_before:
            if obj not in held:
                self._released_s[obj] = time
        self._held_before = held
        self._step_count += 1
        if self._step_count % _CONTACT_STEPS == 0:
            self._check_contacts(time)

    def on_event(self, change: StatusChange) -> None:
        """Record the state when a leaf begins, and judge its end."""
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
        touching = frozenset((*self._pairs(), *self._near_held(held), *self._guarded_contacts))
        self._begun = LeafStart(tool, touching, held, poses)
        self._touched = set()
        self._guarded_contacts = set()
        away = float(np.abs(sent - world.arms[ARM].q).max())
        if away > _START_ERROR_RAD:
            self._report("set-point", f"it begins with the set-point {np.degrees(away):.2f}° away")

    def _end(self, step: Step, change: StatusChange) -> None:
        if step.skill == "move_until_contact":
            self._guarded_contacts = self._touched
        if change.code in _BROKEN_CODES:
            self._report("traceback", f"{change.code}: {change.reason}")
        for name, value in change.metrics.items():
            if isinstance(value, float) and not math.isfinite(value):
                self._report("bookkeeping", f"metric {name} is {value}")
        world = self.run.world
        if change.new == "SUCCESS":
            judge = getattr(self, f"_judge_{step.skill}", None)
            if judge is not None and self._begun is not None:
                for error_text in judge(SuccessfulLeaf(step, self._begun, change.metrics)):
                    self._report("false success", error_text)
        if ARM not in world.arms:
            return
        for error_text in self._bookkeeping_errors(change):
            self._report("bookkeeping", error_text)

    @property
    def _controller(self) -> Any:  # Any: private part of the run
        (arm,) = (one for one in self.run.assembly.arms.present if one.name == ARM)
        return arm._controller

    def _report(self, kind: str, what: str) -> None:
        step = self._now.name if self._now else ""
        key = (step, kind + what[:25])
        if key not in self._reported:  # a contact lasts many steps
            self._reported.add(key)
            self.breaches.append(Breach(kind, step, f"{self.run.time:.2f} s: {what}"))

    # Set-points

    def _check_setpoint(self) -> None:
        sent = self._controller.setpoint
        if not (np.isfinite(sent.q).all() and np.isfinite(self.run.world.arms[ARM].q).all()):
            self._report("set-point", "a position is not finite")
            return
        if self._sent is not None and sent.q is not self._sent:
            period = max(self._controller.period, self.run.world.timestep)
            limits = self.run.world.robots[ARM].limits
            jump = float((np.abs(sent.q - self._sent) / (limits.velocity * period)).max())
            if jump > 1.01:
                self._report("set-point", f"it jumps by {jump:.1f} times what the velocity allows")
        self._sent = sent.q

    # Contacts

    def _bind(self) -> None:
        """Name the owner of each shape: its hand, its link, another arm, an object, the scene."""
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
        """Pairs in contact, with the arm or a held object first."""
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
            for own, other in ((one, two), (two, one)):
                if (own.startswith("its ") and own != "its pedestal") or (
                    own in held and not other.startswith("its hand")
                ):
                    yield own, other

    def _near_held(self, held: tuple[str, ...]) -> Iterator[tuple[str, str]]:
        """Pairs of a held object and a shape so near that they may touch at first, like a hole."""
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

    def _check_contacts(self, time: float) -> None:
        held = self.run.world.attachments.attached_to(ARM)
        for pair in self._pairs():
            self._touched.add(pair)
            if self._now is None or self._begun is None or pair in self._begun.touching:
                continue
            if not self._may_touch(pair, held, time):
                self._report("contact", f"{pair[0]} touches {pair[1]}")

    def _may_touch(self, pair: tuple[str, str], held: tuple[str, ...], time: float) -> bool:
        own, other = pair
        step = self._now
        if step is None:
            return True
        if own == "its hand" and other == "its hand":
            return True
        if own in held and other.startswith("its "):
            return other == "its hand"
        may = _MAY_TOUCH.get(step.skill, "")
        if own == "its hand":
            if other in held or time - self._released_s.get(other, -math.inf) < _FALLING_S:
                return True
            if may == "hand and all":
                return True
            expected = {step.ports.get("object"), *(self._begun.held if self._begun else ())}
            return bool(may) and (
                other.partition(".")[0] in expected  # a moving part belongs to its object
                or (step.skill == "close_gripper" and other in self.run.world.objects)
            )
        if own in held:
            return bool(may)  # the skill picks it up, sets it down or releases it
        return False

    # What is held

    def _gaps(self, obj: str) -> list[float]:
        """Distances in m of an object from each finger, or from a hand without fingers."""
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

    def _bookkeeping_errors(self, change: StatusChange) -> Iterator[str]:
        """Differences between the bookkeeping of held objects and the true state."""
        world = self.run.world
        ending = f"{change.new} {change.code}".strip()
        for held in world.attachments:
            if held.arm != ARM:
                continue
            if held.object not in world.objects:
                yield f"after {ending} it holds {held.object}, which is not in the world"
                continue
            link = world.arms[ARM].tool_link_pose
            pose = link @ held.relative
            away = pose.distance(world.object_pose(held.object))
            limit = _BELIEF_M if held.by_gripper else _WELD_M
            if held.by_gripper and not self._is_in_hand(held.object):
                gap = max(self._gaps(held.object))
                yield f"after {ending} {held.object} counts as held and is {1e3 * gap:.1f} mm away"
            elif away > limit and change.new == "SUCCESS":
                yield f"after {ending} {held.object} is {1e3 * away:.1f} mm from its expected pose"
        gripped = [one.object for one in world.attachments.gripped_by(ARM)]
        # An object that has just been released has not fallen yet.
        opened = self._now is not None and self._now.skill in ("open_gripper", "release")
        unnamed = self._closed_unnamed or opened
        if not gripped and ARM in world.devices.mounted and not unnamed:
            for obj, spec in world.objects.items():
                welded = world.attachments.find(ARM, obj) is not None
                if not spec.is_free or welded or self._is_held(obj) or not self._is_in_hand(obj):
                    continue
                if not self._rests_on(obj) and self._speed_of(obj) < 0.1:
                    yield f"after {ending} {obj} hangs in the hand and does not count as held"
        if len(gripped) > 1:
            yield f"after {ending} one gripper counts as holding {gripped}"

    def _speed_of(self, obj: str) -> float:
        """Speed of an object, m/s."""
        return float(np.linalg.norm(self.run.world.object_velocity(obj)[3:]))

    # Checks of each skill's SUCCESS

    def _tool(self) -> Pose:
        return self.run.world.arms[ARM].tool_pose

    def _tool_errors(self, goal: Pose, meters: float, degrees: float) -> Iterator[str]:
        tool = self._tool()
        away = tool.distance(goal)
        turn = math.degrees(tool.angle(goal))
        if away > meters or turn > degrees:
            yield f"the tool is {1e3 * away:.1f} mm and {turn:.1f}° from its goal"

    def _goal_of(self, ports: Ports, start: Pose) -> Pose:
        if "to" in ports:
            return _pose_of(ports["to"], start)
        return _moved_by(ports["offset"], start)

    def _judge_reach_to_pose(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        world = self.run.world
        if "posture" in leaf.step.ports:
            goal = world.robots[ARM].postures[leaf.step.ports["posture"]]
            away = float(np.abs(world.arms[ARM].q - goal).max())
            if away > _ARRIVED_RAD:
                yield f"a joint is {np.degrees(away):.2f}° from the posture"
            return
        yield from self._tool_errors(self._goal_of(leaf.step.ports, leaf.begun.tool), 0.002, 0.8)

    def _judge_go_home(self, _: SuccessfulLeaf) -> Iterator[str]:
        world = self.run.world
        away = float(np.abs(world.arms[ARM].q - world.robots[ARM].postures["home"]).max())
        if away > _ARRIVED_RAD:
            yield f"a joint is {np.degrees(away):.2f}° from home"

    def _judge_move_joints(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        error = float(leaf.metrics["joint_error_rad"])
        if error > _ARRIVED_RAD:
            yield f"a joint is {np.degrees(error):.2f}° from its goal"

    def _judge_move_linear(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        yield from self._tool_errors(self._goal_of(leaf.step.ports, leaf.begun.tool), 0.005, 2.0)

    def _judge_move_through(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        goal = leaf.begun.tool
        for pose in leaf.step.ports["poses"]:
            goal = _pose_of(pose, goal)
        yield from self._tool_errors(goal, 0.005, 2.0)

    def _judge_rotate_tool(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        axis = np.eye(3)["xyz".index(leaf.step.ports["axis"])]
        start = leaf.begun.tool
        turn = Pose.from_rpy((0, 0, 0), tuple(np.radians(leaf.step.ports["angle"]) * axis))
        if leaf.step.ports["frame"] == "tool":
            goal = start @ turn
        else:
            turned = turn @ Pose(np.zeros(3), start.quaternion)
            goal = Pose(start.position, turned.quaternion)
        yield from self._tool_errors(goal, 0.005, 2.0)

    def _judge_circle(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        expected = (
            leaf.step.ports["radius"]
            if (leaf.step.ports["start"], leaf.step.ports["end"]) == ("around", "rim")
            else 0.0
        )
        away = self._tool().distance(leaf.begun.tool)
        if abs(away - expected) > 0.005:
            yield f"it ended {1e3 * away:.1f} mm from where it began, not {1e3 * expected:.1f} mm"

    def _judge_back(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        yield from self._tool_errors(leaf.begun.tool, 0.005, 2.0)

    _judge_lissajous = _judge_draw = _judge_follow_path = _judge_back

    def _judge_follow_tool(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        error = float(leaf.metrics["follow_max_m"])
        if error > 0.005:
            yield f"its tool was {1e3 * error:.1f} mm from the transform"

    def _judge_hold_still(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        yield from self._tool_errors(leaf.begun.tool, 0.005, 2.0)

    def _judge_stop(self, _: SuccessfulLeaf) -> Iterator[str]:
        speed = float(np.abs(self.run.world.arms[ARM].v).max())
        if speed > 0.03:
            yield f"a joint still moves by {speed:.3f} rad/s"

    def _judge_move_until_contact(self, _: SuccessfulLeaf) -> Iterator[str]:
        hand = [
            pair
            for pair in self._touched
            if pair[0] == "its hand" or not pair[0].startswith("its ")
        ]
        if not [pair for pair in hand if not pair[1].startswith("its ")]:
            yield f"nothing was touched: {sorted(self._touched)}"

    def _judge_grasp(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        obj = leaf.step.ports["object"]
        if "then_to" in leaf.step.ports:
            obj = f"{obj}.joint"
        if not self._is_in_hand(obj):
            yield f"{obj} is {1e3 * max(self._gaps(obj)):.1f} mm from a finger"
        if not self._is_held(obj):
            yield f"{obj} does not count as held"
        if self._rests_on(obj) and "lifted_m" in leaf.metrics:
            yield f"{obj} still lies on {self._rests_on(obj)}"

    _judge_regrasp = _judge_grasp

    def _is_held(self, obj: str) -> bool:
        """Whether an object counts as held; the next leaf may have released it in the same tick."""
        return obj in (*self._held_before, *self.run.world.attachments.attached_to(ARM))

    def _rests_on(self, obj: str) -> list[str]:
        """Shapes that an object touches, except the hand."""
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

    def _judge_approach_and_attach(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        obj = leaf.step.ports["object"]
        if not self._is_held(obj):
            yield f"{obj} is not attached"
        gap = self.run.world.tool_gap(ARM, obj)
        if gap > 0.007:
            yield f"{obj} is {1e3 * gap:.1f} mm from the tool"

    def _judge_detach(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        yield from self._release_errors(leaf.step.ports["object"])

    def _release_errors(self, obj: str) -> Iterator[str]:
        world = self.run.world
        if obj in world.attachments.attached_to(ARM):
            yield f"{obj} is still held"
        speed = self._speed_of(obj)
        if speed > 0.02:
            yield f"{obj} still moves by {speed:.3f} m/s"
        if not self._rests_on(obj):
            yield f"{obj} lies on nothing"

    def _judge_place(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        obj = leaf.step.ports.get("object") or next(iter(leaf.begun.held), None)
        if obj is None:
            yield "nothing was held when it began"
            return
        yield from self._release_errors(obj)
        yield from self._pose_errors(leaf, obj, leaf.step.ports["at"], 0.012, 6.0)

    def _pose_errors(
        self, leaf: SuccessfulLeaf, obj: str, at: Ports, meters: float, degrees: float
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
        else:  # without a given orientation only the tilt counts
            turn = math.acos(
                min(1.0, abs(float(pose.rotation_matrix[:, 2] @ goal.rotation_matrix[:, 2])))
            )
        if away > meters or math.degrees(turn) > degrees:
            yield f"{obj} is {1e3 * away:.1f} mm and {math.degrees(turn):.1f}° from its goal"
        for name in ("placed_error_m", "object_error_m", "inserted_error_m"):
            reported = leaf.metrics.get(name)
            if isinstance(reported, float) and abs(reported - away) > 0.003:
                self._report(
                    "bookkeeping", f"{name} says {1e3 * reported:.1f} mm; it is {1e3 * away:.1f} mm"
                )

    def _judge_insert(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        yield from self._pose_errors(leaf, "cube", leaf.step.ports["at"], 0.006, 8.0)

    def _judge_operate(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        world = self.run.world
        joint = world.joint_of("thing.joint")
        if joint is None:
            yield "there is no joint"
            return
        wrong = world.joint_position("thing.joint") - joint.spec.si(leaf.step.ports["to"])
        if abs(wrong) > (math.radians(3.0) if joint.spec.type == "hinge" else 0.007):
            yield f"its joint is {joint.spec.in_words(wrong)} from its goal"

    def _judge_transport(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        obj = leaf.step.ports["object"]
        if not self._is_held(obj):
            yield f"{obj} is not held"
        yield from self._pose_errors(leaf, obj, leaf.step.ports["to"], 0.008, 5.0)

    def _judge_close_gripper(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        obj = leaf.step.ports.get("object")
        if obj is not None and not self._is_in_hand(obj):
            yield f"{obj} is not between the fingers"

    def _judge_open_gripper(self, _: SuccessfulLeaf) -> Iterator[str]:
        gripped = self.run.world.attachments.gripped_by(ARM)
        if gripped:
            yield f"it still counts as holding {gripped[0].object}"

    _judge_release = _judge_open_gripper

    def _judge_holding(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        world = self.run.world
        expected = leaf.step.ports.get("object")
        candidates = [expected] if expected else list(world.objects)
        if not any(self._is_in_hand(obj) for obj in candidates):
            yield f"none of {candidates} is in the hand"

    def _judge_spawn(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        world = self.run.world
        if (
            leaf.step.ports.get("object") not in world.objects
            and leaf.step.ports.get("arm") not in world.arms
        ):
            yield "it is not in the world"

    def _judge_remove(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        world = self.run.world
        if (
            leaf.step.ports.get("object") in world.objects
            or leaf.step.ports.get("arm") in world.arms
        ):
            yield "it is still in the world"

    # Checks of camera skills

    def _in_camera(self, obj: str) -> Vector:
        """Position of an object in the true camera frame: x right, y down, z forward, m."""
        world = self.run.world
        camera = camera_pose(world.data, world.arms[ARM].camera_id)
        return camera.inverse.apply(world.object_pose(obj).position)

    def _is_in_view(self, obj: str) -> Iterator[str]:
        if obj not in self.run.world.objects:
            yield f"{obj} is not in the world"
            return
        x, y, z = self._in_camera(obj).tolist()
        half = math.tan(math.radians(30.0)) * 1.15
        if not (z > 0 and abs(y) < half * z and abs(x) < half * z * 4 / 3):
            yield f"{obj} is not in the image: at ({x:.2f}, {y:.2f}, {z:.2f}) m from the camera"

    def _judge_look_at(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        world = self.run.world
        camera = camera_pose(world.data, world.arms[ARM].camera_id)
        x, y, z = camera.inverse.apply(np.array(leaf.step.ports["at"]["xyz"])).tolist()
        if math.hypot(x, y) > 0.02 or abs(z - leaf.step.ports["distance"]) > 0.02:
            yield f"the point is at ({x:.3f}, {y:.3f}, {z:.3f}) m from the camera"

    def _judge_wait_for(self, _: SuccessfulLeaf) -> Iterator[str]:
        yield from self._is_in_view("other")

    def _judge_track(self, _: SuccessfulLeaf) -> Iterator[str]:
        yield from self._is_in_view("other")

    def _judge_count(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        there = sum(name == "other" for name in self.run.world.objects)
        found = int(leaf.metrics["found"])
        if found > there:
            yield f"it counts {found} of {there}"

    def _judge_locate(self, leaf: SuccessfulLeaf) -> Iterator[str]:
        error = leaf.metrics.get("located_error_m")
        if "other" not in self.run.world.objects:
            yield "what it located is not in the world"
        elif isinstance(error, float) and error > 0.012:
            yield f"it is {1e3 * error:.1f} mm from where it was located"

    def _judge_scan(self, _: SuccessfulLeaf) -> Iterator[str]:
        yield from self._is_in_view("other")

    def _judge_calibrate(self, _: SuccessfulLeaf) -> Iterator[str]:
        world = self.run.world
        body = world.arms[ARM]
        nominal = world.nominal[ARM].camera_pose_at(body.q)
        true = camera_pose(world.data, body.camera_id)
        away = nominal.distance(true)
        turn = math.degrees(nominal.angle(true))
        if away > 0.01 or turn > 2.0:
            yield f"the camera is {1e3 * away:.1f} mm and {turn:.2f}° from its nominal pose"


def final_breaches(result: RunResult, registry: Registry) -> list[Breach]:
    """Breaches of an ended run: its outcome, clipped set-points, undeclared failure codes."""
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


def _moved_by(offset: dict[str, object], tool: Pose) -> Pose:
    xyz = np.array(offset["xyz"], dtype=float)
    if offset["frame"] == "tool":
        return Pose(tool.apply(xyz), tool.quaternion)
    return Pose(tool.position + xyz, tool.quaternion)
