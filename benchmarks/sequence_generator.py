"""Random sequences of skills: a small world, and two or three leaves as a user could chain them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from benchmarks.articulated import MAKERS, REACH_M
from bt_dualarm.core.pose import Pose

Ports = dict[str, Any]

ROBOTS: Final[Mapping[str, tuple[float, float, float, float]]] = {
    "ur3": (0.30, 0.08, 0.27, 0.12),
    "ur5": (0.48, 0.10, 0.30, 0.18),
    "ur10": (0.66, 0.16, 0.36, 0.20),
    "panda": (0.46, 0.0, 0.32, 0.16),
    "xarm7": (0.40, 0.0, 0.30, 0.15),
}
"""Center of the workspace (x, y), height of free motions, and half its width; m, from the base."""

_HOME_HEIGHT: Final = {"ur3": 0.31, "ur5": 0.43, "ur10": 0.64, "panda": 0.49, "xarm7": 0.43}
"""Height of the tool in the home posture without a gripper, m, from the base."""

GRIPPERS: Final = ("panda_hand", "robotiq_2f85", "suction_cup", None)
REALITIES: Final = ("ideal", "lab", "rough")

CAMERA_SKILLS: Final = ("look_at", "scan", "wait_for", "count", "locate", "track", "calibrate")
GRIPPER_SKILLS: Final = (
    "grasp",
    "place",
    "regrasp",
    "insert",
    "close_gripper",
    "open_gripper",
    "release",
    "holding",
)
JOINT_SKILLS: Final = ("carry_together", "hand_over", "take_over")
"""Skills that need a second arm, which `benchmarks.carry` and `benchmarks.handover` cover."""

FINGER_SKILLS: Final = ("operate",)
"""Skills that need fingers around a handle."""

FREE_SKILLS: Final = (
    "reach_to_pose",
    "move_linear",
    "move_through",
    "move_joints",
    "move_until_contact",
    "rotate_tool",
    "circle",
    "lissajous",
    "draw",
    "follow_path",
    "go_home",
    "follow_tool",
    "hold_still",
    "stop",
    "approach_and_attach",
    "detach",
    "transport",
    "spawn",
    "remove",
)
MOST_SPOTS: Final = 2000
"""Number of random positions that are tried to find a free one."""

NEEDS_HELD: Final = ("place", "insert", "regrasp", "transport", "release", "holding", "detach")
"""Skills that need a held object; sometimes they are called with an empty hand all the same."""


@dataclass(frozen=True)
class Step:
    """One leaf of a sequence.

    Attributes:
        name: Name of its node.
        skill: Skill that it runs.
        ports: Values of the skill's ports.
    """

    name: str
    skill: str
    ports: Ports


@dataclass(frozen=True)
class SkillSequence:
    """Sequence of one seed.

    Attributes:
        seed: Seed of the sequence and of its run.
        file: Tree file, as data.
        steps: Leaves of the first arm in order, preparatory ones included.
        label: Robot, gripper, reality and skills, as text.
    """

    seed: int
    file: dict[str, Any]
    steps: tuple[Step, ...]
    label: str


def generate(
    seed: int, count: int, reality: str | None = None, skills: Sequence[str] = ()
) -> SkillSequence:
    """The sequence of a seed; deterministic.

    Each leaf runs whether the one before it has succeeded or not, as in a tree with a recovery.

    Args:
        seed: Seed of world and skills.
        count: Number of chained skills, besides one that may put an object into the hand.
        reality: Set of errors of world and arm; random if None.
        skills: Skills to chain instead of those of the seed, which change when skills are
            added.
    """
    return _Author(np.random.default_rng((seed, count)), seed).write(count, reality, skills)


class _Author:
    """Writes one sequence; the object that should be held determines the ports of later skills."""

    def __init__(self, rng: np.random.Generator, seed: int) -> None:
        self._rng = rng
        self._seed = seed

    def write(self, count: int, reality: str | None, given: Sequence[str]) -> SkillSequence:
        rng = self._rng
        self.robot = str(rng.choice(list(ROBOTS)))
        self.gripper = GRIPPERS[int(rng.integers(len(GRIPPERS)))]
        random_reality = str(rng.choice(REALITIES))
        self.reality = reality or random_reality
        skills = self._skills(count)
        skills = list(given) or skills
        if any(skill in CAMERA_SKILLS for skill in skills) and self.robot == "panda":
            self.robot = "ur5"  # the Panda's camera looks ahead, and sees no table from its home
        self.middle = np.array(ROBOTS[self.robot][:2])
        _, _, self.height, self.half = ROBOTS[self.robot]
        self.surface = float(rng.choice([0.0, 0.05, -0.08]))
        self.base = Pose.from_rpy(
            (0.0, 0.0, 0.5 if self.surface else 0.0), (0, 0, float(rng.uniform(-np.pi, np.pi)))
        )
        # The camera skills look for another object than the one in the hand.
        self.looks = any(skill in CAMERA_SKILLS for skill in skills)
        self._add_objects(skills)
        if any(skill in FINGER_SKILLS for skill in skills):
            self._add_articulated()
        self.held: str | None = None
        self.steps: list[Step] = []
        if self._begins_held(skills[0]):
            self._add("grasp" if self.gripper else "approach_and_attach")
            if skills[0] in FREE_SKILLS and skills[0] != "detach" and self._rng.uniform() < 0.85:
                self.steps.append(Step("2 lift", "move_linear", self._lift()))
        for number, skill in enumerate(skills):
            following = skills[number + 1] if number + 1 < len(skills) else None
            before = self.steps[-1].skill if self.steps else ""
            looks = skill in ("wait_for", "count", "locate", "track", "calibrate")
            if looks and before not in ("look_at", "scan"):
                self._look_first()
            self._add(skill, following)
            if skill == "operate" and self._rng.uniform() < 0.8:
                self._add("release")
        return SkillSequence(self._seed, self._file(skills), tuple(self.steps), self._label())

    def _label(self) -> str:
        hand = self.gripper or "no gripper"
        return f"{self.robot}, {hand}, {self.reality}: {' > '.join(s.skill for s in self.steps)}"

    def _skills(self, count: int) -> list[str]:
        known = list(FREE_SKILLS + CAMERA_SKILLS)
        if self.gripper is not None:
            known += [*GRIPPER_SKILLS, "place", "grasp"]
        if self.gripper not in (None, "suction_cup"):
            known += [*FINGER_SKILLS]
        return [str(skill) for skill in self._rng.choice(known, count)]

    def _begins_held(self, first: str) -> bool:
        if first in ("approach_and_attach", "grasp"):
            return bool(self._rng.uniform() < 0.15)
        if first in FINGER_SKILLS:
            return bool(self._rng.uniform() < 0.1)
        if first in NEEDS_HELD:
            return bool(self._rng.uniform() < 0.93)
        return bool(self._rng.uniform() < 0.5)

    # The world

    def _add_objects(self, skills: list[str]) -> None:
        """Add an object to handle, another one to look at, and one that is not spawned yet."""
        rng = self._rng
        side = float(rng.choice([-1, 1]))
        offset = min(self.half, 0.13)
        # A peg needs a hole, a calibration a ball.
        self.inserts = "insert" in skills
        box = self.inserts or rng.uniform() < 0.6
        if self.inserts:
            size = [0.05, 0.05, 0.05]
            self.half_height = 0.025
        elif box:
            size = [float(edge) for edge in rng.uniform(0.042, 0.06, 3)]
            self.half_height = size[2] / 2
        else:
            size = [float(rng.uniform(0.022, 0.03)), float(rng.uniform(0.045, 0.07))]
            self.half_height = size[1] / 2
        self.spots = {
            "cube": self.middle + rng.uniform(-0.02, 0.02, 2),
            "other": self.middle + np.array((rng.uniform(-0.02, 0.03), side * offset)),
            "spare": self.middle + np.array((rng.uniform(-0.02, 0.03), -side * offset)),
        }
        self.objects: dict[str, Any] = {
            "cube": {
                "shape": "box" if box else "cylinder",
                "size": size,
                "mass": float(rng.uniform(0.05, 0.35)),
                "color": "yellow",
                "pose": self._pose_on_surface(
                    "cube", self.half_height, float(rng.uniform(-45, 45))
                ),
            }
        }
        ball = "calibrate" in skills
        self.other_half = 0.02 if ball else 0.0225
        self.objects["other"] = {
            "shape": "sphere" if ball else "box",
            "size": [0.02] if ball else [0.045, 0.045, 0.045],
            "mass": 0.1,
            "color": "red",
            "fixed": ball,
            "pose": self._pose_on_surface("other", self.other_half, float(rng.uniform(-45, 45))),
        }
        self.objects["spare"] = {
            "shape": "box",
            "size": [0.04, 0.04, 0.04],
            "mass": 0.1,
            "color": "green",
            "spawned": False,
            "pose": self._pose_on_surface("spare", 0.02, 0.0),
        }
        if self.surface:
            self.objects["bench"] = {
                "shape": "box",
                "size": [0.44, 0.60, 0.04],
                "mass": 50,
                "fixed": True,
                "pose": self._pose((*self.middle, self.surface - 0.02), (0, 0, 0)),
            }
            if self.surface > 0.0:  # not below the arm's own base
                self.objects["bench"]["size"] = [0.40, 0.60, 0.04]
                ahead = self.middle + np.array((0.06, 0.0))
                self.objects["bench"]["pose"] = self._pose((*ahead, self.surface - 0.02), (0, 0, 0))
        if self.inserts:
            self.hole = self.spots["spare"]
            for name, x, y, width, depth in (
                ("left", -0.036, 0.0, 0.02, 0.092),
                ("right", 0.036, 0.0, 0.02, 0.092),
                ("front", 0.0, -0.036, 0.052, 0.02),
                ("back", 0.0, 0.036, 0.052, 0.02),
            ):
                self.objects[name] = {
                    "shape": "box",
                    "size": [width, depth, 0.012],
                    "mass": 50,
                    "fixed": True,
                    "pose": self._pose(
                        (self.hole[0] + x, self.hole[1] + y, self.surface + 0.006), (0, 0, 0)
                    ),
                }
            self.spots["spare"] = self.middle + np.array((-0.10, 0.0))
            self.objects["spare"]["pose"] = self._pose_on_surface("spare", 0.02, 0.0)

    def _add_articulated(self) -> None:
        """Add a door, drawer, lid or lever beside the workspace, above the ground."""
        rng = self._rng
        far = REACH_M[self.robot]
        articulated = MAKERS[str(rng.choice(list(MAKERS)))](rng, min(far / 0.75, 1.2))
        bearing = float(rng.choice([-1, 1]) * rng.uniform(1.2, 1.9))
        handle = far * np.array((0.75 * np.cos(bearing), 0.75 * np.sin(bearing), 0.0))
        handle[2] = far * float(rng.uniform(0.35, 0.45))
        turn = Pose.from_rpy((0, 0, 0), (0, 0, bearing - np.pi / 2))
        yaw_deg = float(np.degrees(bearing)) - 90.0
        self.opened = round(articulated.to, 4)
        self.objects["thing"] = {
            "shape": "compound",
            "mass": 5.0,
            "fixed": True,
            "color": "gray",
            "parts": articulated.parts,
            "joints": {"joint": articulated.joint},
            "pose": self._pose(handle - turn.apply(articulated.handle), (0, 0, yaw_deg)),
        }

    def _pose_on_surface(self, name: str, half_height: float, yaw_deg: float) -> Ports:
        spot = self.spots[name]
        return self._pose((*spot, self.surface + half_height + 5e-4), (0, 0, yaw_deg))

    def _pose(self, xyz: Any, rpy_deg: Any = None) -> Ports:
        """A pose in the base frame as a tree file's pose in the world; no rotation if None."""
        turn = np.radians(rpy_deg if rpy_deg is not None else (0, 0, 0))
        pose = self.base @ Pose.from_rpy(np.asarray(xyz, dtype=float).tolist(), turn.tolist())
        written: Ports = {"xyz": [round(float(value), 6) for value in pose.position]}
        if rpy_deg is not None:
            written["rpy"] = [round(float(np.degrees(value)), 4) for value in pose.rpy]
        return written

    def _file(self, skills: list[str]) -> dict[str, Any]:
        rng = self._rng
        base = {
            "xyz": [float(value) for value in self.base.position],
            "rpy": [float(np.degrees(value)) for value in self.base.rpy],
        }
        arm: Ports = {"robot": self.robot, "base": base}
        if self.gripper is not None:
            arm["gripper"] = self.gripper
        if self.looks:
            fine = "locate" in skills  # the size of what is located is measured, too
            pixels = [320, 240] if fine else [160, 120]
            arm["camera"] = {"mount": "wrist", "resolution": pixels, "fov": 60, "fps": 20}
        leaves: list[Ports] = []
        for step in self.steps:
            if (
                step.skill == "remove"
            ):  # in the tick in which the previous leaf ends it cannot be judged
                leaves.append({"wait": 0.04})
            node = {step.skill: step.ports | {"name": step.name}}
            leaves.append({"force_success": {"child": node}})
            if rng.uniform() < 0.4:
                leaves.append({"wait": round(float(rng.uniform(0.02, 0.3)), 3)})
        arms: Ports = {"arm1": arm | {"tree": {"sequence": leaves}}}
        if any(skill in ("spawn", "remove", "follow_tool") for skill in skills):
            far = self._pose((-1.3, 0.4, 0.0), (0, 0, 0))
            arms["arm2"] = {
                "robot": "ur3",
                "base": far,
                "spawned": "spawn" not in skills,
                "removable": True,
                "last_life_counts": True,
                "tree": {"reach_to_pose": {"posture": "up", "speed": 0.3}},
            }
        return {
            "bt_dualarm": 1,
            "name": "sequence",
            "world": {
                "scene": "empty",
                "seed": self._seed % 2**31,
                "time_limit": 180,
                "reality": self.reality,
            },
            "objects": self.objects,
            "arms": arms,
        }

    # The leaves

    def _add(self, skill: str, following: str | None = None) -> None:
        ports = getattr(self, f"_{skill}")(following)
        self.steps.append(Step(f"{len(self.steps) + 1} {skill}", skill, ports))

    def _speed(self) -> float:
        return float(self._rng.choice([1.0, 0.5]))

    def _free_xyz(self) -> np.ndarray:
        beside = self._rng.uniform(-1, 1, 2) * (0.4 * self.half, 0.6 * self.half)
        height = self.surface + self.height + self._rng.uniform(-0.05, 0.06)
        return np.array((*(self.middle + beside), height))

    def _free_pose(self) -> Ports:
        yaw = float(self._rng.uniform(-40, 40))
        tilt = self._rng.uniform(-12, 12, 2)
        return self._pose(self._free_xyz(), (180 + tilt[0], tilt[1], yaw))

    def _offset(self, longest: float) -> Ports:
        offset = [round(float(one), 4) for one in self._rng.uniform(-longest, longest, 3)]
        return {"xyz": offset, "frame": str(self._rng.choice(["world", "tool"]))}

    def _reach_to_pose(self, _: str | None) -> Ports:
        kind = self._rng.uniform()
        goal: Ports
        if kind < 0.55:
            goal = {"to": self._free_pose()}
        elif kind < 0.85:
            goal = {"offset": self._offset(0.06)}
        else:
            goal = {
                "posture": str(
                    self._rng.choice(["home", "home", "up"][: 2 + (self.robot != "panda")])
                )
            }
        return goal | {"speed": self._speed()}

    def _move_linear(self, _: str | None) -> Ports:
        if self._rng.uniform() < 0.7:
            return {"offset": self._offset(0.05), "speed": self._speed()}
        return {"to": self._pose(self._free_xyz()), "speed": self._speed()}

    def _lift(self) -> Ports:
        return {"offset": {"xyz": [0, 0, 0.08], "frame": "world"}, "speed": 1.0}

    def _move_through(self, _: str | None) -> Ports:
        poses = [self._pose(self._free_xyz()) for _ in range(int(self._rng.integers(1, 4)))]
        return {"poses": poses, "speed": self._speed()}

    def _move_joints(self, _: str | None) -> Ports:
        count = 7 if self.robot in ("panda", "xarm7") else 6
        turn = [round(float(one), 2) for one in self._rng.uniform(-12, 12, count)]
        return {"by": turn, "speed": self._speed()}

    def _look_first(self) -> None:
        """Usually look at the object first: a camera that looks elsewhere sees nothing."""
        if self._rng.uniform() < 0.85:
            self._add("look_at")

    def _move_until_contact(self, _: str | None) -> Ports:
        far = _HOME_HEIGHT[self.robot] - self.surface + 0.05
        return {"direction": [0, 0, -1], "distance": round(far, 3), "speed": 0.02}

    def _rotate_tool(self, _: str | None) -> Ports:
        return {
            "axis": str(self._rng.choice(["x", "y", "z"])),
            "angle": round(float(self._rng.choice([-1, 1]) * self._rng.uniform(5, 30)), 2),
            "frame": str(self._rng.choice(["tool", "world"])),
            "speed": self._speed(),
        }

    def _plane(self) -> str:
        return str(self._rng.choice(["xy", "yz", "xz"]))

    def _circle(self, _: str | None) -> Ports:
        start, end = [("around", "center"), ("around", "rim"), ("from", "rim")][
            int(self._rng.integers(3))
        ]
        radius = round(float(self._rng.uniform(0.015, 0.04)), 4)
        shape = {"plane": self._plane(), "radius": radius, "start": start, "end": end}
        return shape | {"speed": self._speed()}

    def _lissajous(self, _: str | None) -> Ports:
        sizes = [round(float(one), 4) for one in self._rng.uniform(0.015, 0.04, 2)]
        return {"plane": self._plane(), "amplitudes": sizes, "end": "center", "speed": 1.0}

    def _draw(self, _: str | None) -> Ports:
        angles = np.sort(self._rng.uniform(0, 2 * np.pi, 5)) + np.arange(5) * 0.3
        points = 0.03 * np.column_stack((np.cos(angles), np.sin(angles)))
        return {
            "plane": self._plane(),
            "points": points.round(4).tolist(),
            "end": "center",
            "speed": 1.0,
        }

    def _follow_path(self, _: str | None) -> Ports:
        width, height = self._rng.uniform(30, 60, 2).round(1).tolist()
        return {
            "plane": self._plane(),
            "points": [[0, 0], [width, 0], [width, height], [0, height]],
            "closed": True,
            "tool_speed": 0.03,
        }

    def _go_home(self, _: str | None) -> Ports:
        return {"speed": self._speed()}

    def _follow_tool(self, _: str | None) -> Ports:
        return {"arm": "arm2", "duration": 2.0, "speed": 1.0}

    def _hold_still(self, _: str | None) -> Ports:
        compliance = round(float(self._rng.uniform(2e-4, 1e-3)), 6)
        return {"duration": 1.0, "compliance": 0.0 if self._rng.uniform() < 0.5 else compliance}

    def _stop(self, _: str | None) -> Ports:
        return {}

    def _approach_and_attach(self, _: str | None) -> Ports:
        obj = "cube"
        if self.held == "cube" and not self.looks and self._rng.uniform() < 0.7:
            obj = "other"
        self.held = self.held or obj
        return {"object": obj, "speed": 1.0}

    @property
    def _object(self) -> str:
        """The object in the hand if all went well, else the one to handle."""
        return self.held or "cube"

    @property
    def _object_half(self) -> float:
        return self.other_half if self._object == "other" else self.half_height

    def _detach(self, _: str | None) -> Ports:
        obj = self._object
        self.held = None
        return {"object": obj}

    def _transport(self, following: str | None) -> Ports:
        xyz = self._free_xyz() - (0, 0, 0.04)
        if following == "detach":  # it can only stay where it is with support below
            xyz[2] = self.surface + self._object_half + 0.003
        return {
            "object": self._object,
            "to": self._pose(xyz, (0, 0, float(self._rng.uniform(-40, 40)))),
            "speed": self._speed(),
        }

    def _spawn(self, _: str | None) -> Ports:
        if self._rng.uniform() < 0.4:
            return {"arm": "arm2"}
        return {"object": "spare"}

    def _remove(self, _: str | None) -> Ports:
        if self._rng.uniform() < 0.3:
            return {"arm": "arm2"}
        obj = str(self._rng.choice(["cube", "other"]))
        if obj == self.held:
            self.held = None
        return {"object": obj}

    def _grasp(self, _: str | None) -> Ports:
        obj = "cube" if self.held is not None or self._rng.uniform() < 0.85 else "other"
        if self.held == "cube" and self._rng.uniform() < 0.5:
            obj = "other"
        if self.looks:
            obj = "cube"
        self.held = self.held or obj
        return {"object": obj, "speed": 1.0}

    def _free_spot(self) -> np.ndarray:
        """A free position on the surface, or the one farthest from all other objects."""
        others = [self.spots[name] for name in ("cube", "other", "spare") if name != self._object]
        others += [self.hole] if self.inserts else []
        best = self.middle
        farthest = -1.0
        for _ in range(MOST_SPOTS):  # within a UR3's reach there may be none
            spot = self.middle + self._rng.uniform(-1, 1, 2) * (0.3 * self.half, 0.8 * self.half)
            clearance = min(float(np.linalg.norm(spot - other)) for other in others)
            if clearance > farthest:
                best = spot
                farthest = clearance
            if clearance > 0.11:
                break
        return best

    def _standing(self) -> Ports:
        """A pose in which the object stands on the surface."""
        turn = None if self._rng.uniform() < 0.5 else (0, 0, float(self._rng.uniform(-60, 60)))
        return self._pose((*self._free_spot(), self.surface + self._object_half), turn)

    def _operate(self, _: str | None) -> Ports:
        """Grasp the handle first, unless the hand is full; open and close it alternately."""
        to = self.opened
        if self.held is not None and self._rng.uniform() < 0.7:
            self._add("release")
        if self.steps and self.steps[-1].skill == "operate":
            to = 0.0
        elif self.held is None:
            taken = {"object": "thing", "part": "handle", "then_to": to, "speed": 1.0}
            self.steps.append(Step(f"{len(self.steps) + 1} grasp", "grasp", taken))
        return {"object": "thing", "joint": "joint", "to": to}

    def _place(self, _: str | None) -> Ports:
        goal = self._standing()
        self.held = None
        return {"at": goal, "speed": 1.0}

    def _regrasp(self, _: str | None) -> Ports:
        self.held = self._object
        return {"object": self.held, "speed": 1.0}

    def _insert(self, _: str | None) -> Ports:
        pose = self._pose((*self.hole, self.surface + 0.025), (0, 0, 0))
        return {"object": "cube", "at": pose, "depth": 0.012, "speed": 1.0}

    def _close_gripper(self, _: str | None) -> Ports:
        return {"empty": True}

    def _open_gripper(self, _: str | None) -> Ports:
        self.held = None
        return {}

    def _release(self, _: str | None) -> Ports:
        self.held = None
        return {}

    def _holding(self, _: str | None) -> Ports:
        return {"object": "cube"} if self._rng.uniform() < 0.5 else {}

    def _look_at(self, _: str | None) -> Ports:
        point = self._pose((*self.spots["other"], self.surface + 0.02))
        return {"at": point, "distance": 0.3, "speed": 1.0}

    def _scan(self, _: str | None) -> Ports:
        center = self._pose((*self.middle, self.surface))["xyz"]
        return {
            "object": "other",
            "center": center,
            "width": 0.3,
            "depth": 0.3,
            "distance": 0.35,
            "speed": 1.0,
        }

    def _wait_for(self, _: str | None) -> Ports:
        return {"object": "other", "wait": 1.5}

    def _count(self, _: str | None) -> Ports:
        return {"object": "other"}

    def _locate(self, _: str | None) -> Ports:
        return {"object": "other", "accuracy": 0.003, "speed": 1.0}

    def _track(self, _: str | None) -> Ports:
        return {
            "color": "red",
            "plane": "xy",
            "distance": 0.35,
            "duration": 1.0,
            "wait": 1.5,
            "speed": 1.0,
        }

    def _calibrate(self, _: str | None) -> Ports:
        return {"color": "red", "distance": 0.35, "speed": 1.0}
