"""Doors, drawers, lids and levers, opened and closed by five robots: success rate and forces.

    python -m benchmarks.articulated [--objects 20] [--robots ur3 ur5 ur10 panda xarm7] [--seed 0]
                                     [--reality lab] [--only KIND] [--verbose]

Each object has a random size, pose, joint, friction and handle. A tree grasps the handle, operates
the joint to its open position and back, releases the handle and goes home. A run succeeds if the
tree succeeds and the simulated joint was within 5 mm or 2° of both positions. The force is that of
the hand on the part, summed over all their contacts and averaged over 20 ms; its maximum while the
part is held is printed. Exits with code 1 if less than 95 % succeed or a force exceeds 40 N.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import mujoco
import numpy as np
import yaml

from benchmarks.campaign import Campaign, add_options, registry
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.core.errors import OverlapError
from bt_dualarm.core.pose import Pose
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.run import Run
from bt_dualarm.skill.registry import Registry

KINDS: Final = ("drawer", "door", "lid", "lever")
ROBOTS: Final = ("ur3", "ur5", "ur10", "panda", "xarm7")
REACH_M: Final = {"ur3": 0.42, "ur5": 0.75, "ur10": 1.1, "panda": 0.7, "xarm7": 0.65}
"""Reach from the base, m; handles are at 70 to 85 % of it."""

MOST_N: Final = 40.0
SHARE: Final = 0.95
_MEAN_S: Final = 0.02
_BASE_M: Final = 0.4
_ATTEMPTS: Final = 5


def _bar(length: float, axis: int, thick: float) -> list[float]:
    size = [thick, thick, thick]
    size[axis] = length
    return size


@dataclass
class Articulated:
    """An object in a frame in which the robot is on its -y side.

    Attributes:
        parts: Its parts, as in a tree file.
        joint: Its joint, as in a tree file.
        to: Open position, degrees or m.
        handle: Position of the handle, of shape (3,), m.
    """

    parts: dict[str, Any]
    joint: dict[str, Any]
    to: float
    handle: np.ndarray


def drawer(rng: np.random.Generator, scale: float) -> Articulated:
    """A drawer in a frame that is open to the front."""
    x, y, z = (scale * float(one) for one in rng.uniform((0.2, 0.18, 0.1), (0.32, 0.26, 0.16)))
    thick = 0.01
    z = max(z, 0.06)
    out = -0.5 * y - 0.05
    across = int(rng.integers(2)) == 0
    bar = _bar(0.1 if across else 0.08, 0 if across else 2, float(rng.uniform(0.01, 0.018)))
    offset = [0.035, 0.0] if across else [0.0, 0.028]
    parts = {
        "top": {
            "shape": "box",
            "size": [x + 0.03, y, thick],
            "pose": {"xyz": [0, 0, z / 2 + 0.01]},
        },
        "left": {"shape": "box", "size": [thick, y, z], "pose": {"xyz": [-x / 2 - 0.01, 0, 0]}},
        "right": {"shape": "box", "size": [thick, y, z], "pose": {"xyz": [x / 2 + 0.01, 0, 0]}},
        "tray": {"shape": "bin", "size": [x, y, z - 0.02], "wall": 0.005},
        "handle": {"shape": "box", "size": bar, "pose": {"xyz": [0, out, 0]}, "color": "red"},
    }
    for name, sign in (("stem1", -1.0), ("stem2", 1.0)):
        at = [sign * offset[0], out / 2 - y / 4, sign * offset[1]]
        length = abs(out) - y / 2
        parts[name] = {"shape": "box", "size": [0.01, length, 0.01], "pose": {"xyz": at}}
    longest = 0.8 * y
    joint = {"type": "slide", "axis": [0, -1, 0], "range": [0, longest]} | _joint_properties(
        rng, 8.0, 30.0
    )
    joint["parts"] = ["tray", "handle", "stem1", "stem2"]
    return Articulated(
        parts, joint, float(rng.uniform(0.6, 1.0)) * longest, np.array((0.0, out, 0.0))
    )


def door(rng: np.random.Generator, scale: float) -> Articulated:
    """A door with its hinge on the left or on the right, in front of a back panel."""
    x, z = (scale * float(one) for one in rng.uniform((0.18, 0.25), (0.3, 0.4)))
    side = float(rng.choice((-1.0, 1.0)))  # of the hinge
    out = -0.055
    at = -side * (x / 2 - 0.03)
    bar = _bar(0.09, 2, float(rng.uniform(0.01, 0.018)))
    parts = {
        "back": {"shape": "box", "size": [x, 0.01, z], "pose": {"xyz": [0, 0.12, 0]}},
        "panel": {"shape": "box", "size": [x, 0.012, z], "color": "white"},
        "handle": {"shape": "box", "size": bar, "pose": {"xyz": [at, out, 0]}, "color": "red"},
    }
    for name, sign in (("stem1", -1.0), ("stem2", 1.0)):
        pose = {"xyz": [at, out / 2, 0.032 * sign]}
        parts[name] = {"shape": "box", "size": [0.01, -out, 0.01], "pose": pose}
    # Opening turns the free edge toward the robot.
    joint: dict[str, Any] = {"type": "hinge", "axis": [0, 0, side], "anchor": [side * x / 2, 0, 0]}
    joint |= {"range": [0, 110]} | _joint_properties(rng, 0.8, 1.0)
    joint["parts"] = ["panel", "handle", "stem1", "stem2"]
    return Articulated(parts, joint, float(rng.uniform(40, 75)), np.array((at, out, 0.0)))


def lid(rng: np.random.Generator, scale: float) -> Articulated:
    """A box whose lid opens upward, about its rear edge."""
    x, y, z = (scale * float(one) for one in rng.uniform((0.16, 0.14, 0.08), (0.28, 0.22, 0.14)))
    out = -0.5 * y - 0.045
    parts = {
        "box": {"shape": "bin", "size": [x, y, z], "pose": {"xyz": [0, 0, -z / 2 - 0.008]}},
        "lid": {"shape": "box", "size": [x, y, 0.01], "color": "white"},
        "stem": {"shape": "box", "size": [0.012, 0.05, 0.008],
                 "pose": {"xyz": [0, -y / 2 - 0.02, 0]}},
        "handle": {"shape": "box", "size": [0.06, 0.02, 0.012], "pose": {"xyz": [0, out, 0]},
                   "color": "red"},
    }  # fmt: skip
    joint: dict[str, Any] = {
        "type": "hinge",
        "axis": [-1, 0, 0],
        "anchor": [0, y / 2, 0],
        "range": [0, 100],
    }
    joint |= _joint_properties(rng, 0.5, 0.5) | {"parts": ["lid", "stem", "handle"]}
    return Articulated(parts, joint, float(rng.uniform(30, 60)), np.array((0.0, out, 0.0)))


def lever(rng: np.random.Generator, scale: float) -> Articulated:
    """A lever with a grip at its end, which turns about a horizontal or a vertical axis."""
    length = max(scale, 0.7) * float(rng.uniform(0.12, 0.2))
    wide = float(rng.uniform(0.014, 0.022))
    upright = int(rng.integers(2)) == 0
    stem: list[float]
    grip: list[float]
    base = {"shape": "box", "size": [0.06, 0.06, 0.06], "pose": {"xyz": [0, 0.03, -0.04]}}
    if upright:  # like a switch, in a vertical plane to and from the robot
        stem, grip = [0, 0, length / 2], [0, 0, length + 0.03]
        size, axis = [0.01, 0.01, length], [1, 0, 0]
        bar = [wide, wide, 0.06]
    else:  # like a crank, in the horizontal plane
        stem, grip = [0, -length / 2, 0], [0, -length, 0.045]
        size, axis = [0.012, length, 0.012], [0, 0, 1]
        bar = [wide, wide, 0.08]
    parts = {
        "base": base,
        "stem": {"shape": "box", "size": size, "pose": {"xyz": stem}},
        "handle": {"shape": "box", "size": bar, "pose": {"xyz": grip}, "color": "red"},
    }
    joint: dict[str, Any] = {
        "type": "hinge",
        "axis": axis,
        "range": [-50, 50],
        "parts": ["stem", "handle"],
    }
    joint |= _joint_properties(rng, 1.0, 0.5) | {"friction": float(rng.uniform(0.3, 1.0))}
    sign = 1.0 if upright else float(rng.choice((-1.0, 1.0)))
    return Articulated(parts, joint, sign * float(rng.uniform(20, 45)), np.array(grip, float))


def _joint_properties(
    rng: np.random.Generator, friction: float, damping: float
) -> dict[str, float]:
    """Friction, damping and mass of a joint."""
    return {
        "friction": float(rng.uniform(0.1, 1.0)) * friction,
        "damping": float(rng.uniform(0.1, 1.0)) * damping,
        "mass": float(rng.uniform(0.2, 0.8)),
    }


MAKERS: Final = {"drawer": drawer, "door": door, "lid": lid, "lever": lever}


def task(kind: str, robot: str, seed: int, reality: str, attempt: int = 0) -> dict[str, Any]:
    """The tree file of one run; each attempt has another object at another pose."""
    rng = np.random.default_rng([seed, KINDS.index(kind), *([attempt] if attempt else [])])
    far = REACH_M[robot]
    obj = MAKERS[kind](rng, min(far / 0.75, 1.2))
    distance = far * float(rng.uniform(0.7, 0.85))
    bearing = math.radians(float(rng.uniform(-40, 40)))
    height = _BASE_M + far * float(rng.uniform(0.05, 0.45))
    yaw = bearing - math.pi / 2 + math.radians(float(rng.uniform(-10, 10)))
    handle = distance * np.array((math.cos(bearing), math.sin(bearing), 0.0))
    handle[2] = height
    turn = Pose.from_rpy((0, 0, 0), (0, 0, yaw))
    place = handle - turn.apply(obj.handle)
    to = round(obj.to, 4)
    pose = {"xyz": [round(float(one), 4) for one in place], "rpy": [0, 0, math.degrees(yaw)]}
    body = {"shape": "compound", "mass": 5.0, "fixed": True, "color": "gray", "pose": pose}
    body |= {"parts": obj.parts, "joints": {"joint": obj.joint}}
    operate = {"object": "thing", "joint": "joint"}
    leaves: list[Any] = [
        {"grasp": {"object": "thing", "part": "handle", "then_to": to}},
        {"operate": operate | {"to": to}},
        {"operate": operate | {"to": 0.0}},
        {"release": {"width": 0.03}},
        "go_home",
    ]
    gripper = "panda_hand" if robot == "panda" else "robotiq_2f85"
    arm = {"robot": robot, "gripper": gripper, "base": {"xyz": [0, 0, _BASE_M]}}
    return {
        "bt_dualarm": 1,
        "name": f"{kind}_{seed}",
        "world": {"scene": "empty", "reality": reality, "time_limit": 120},
        "objects": {"thing": body},
        "arms": {"arm1": arm | {"tree": {"sequence": leaves}}},
    }


@dataclass
class Observer(IdleObserver):
    """Measures the true joint position and the true force on the moving part.

    Attributes:
        run: The run.
        lowest: Smallest position of the joint so far, rad or m.
        highest: Largest position of the joint so far, rad or m.
        force_n: Largest force so far while the part is held, N.
    """

    run: Run = field(init=False)
    lowest: float = math.inf
    highest: float = -math.inf
    force_n: float = 0.0
    _recent: deque[np.ndarray] = field(default_factory=deque)

    def begin(self) -> None:
        """Subscribe to the steps at which contacts and their forces match."""
        self.run.world.on_forces.append(self._measure)

    def after_step(self, time: float) -> None:  # noqa: ARG002 - of the interface
        """Update the range of joint positions."""
        position = self.run.world.joint_position("thing.joint")
        self.lowest = min(self.lowest, position)
        self.highest = max(self.highest, position)

    def _measure(self) -> None:
        world = self.run.world
        model, data = world.model, world.data
        geoms = set(world.object_geoms("thing.joint"))
        hand = world.arms["arm1"].geom_ids
        total = np.zeros(3)
        wrench = np.zeros(6)
        for index, (one, other) in enumerate(data.contact.geom.tolist()):
            if (one in geoms and other in hand) or (other in geoms and one in hand):
                mujoco.mj_contactForce(model, data, index, wrench)
                frame = data.contact.frame[index].reshape(3, 3)
                total += (1.0 if other in geoms else -1.0) * (frame.T @ wrench[:3])
        self._recent.append(total)
        while len(self._recent) > round(_MEAN_S / model.opt.timestep):
            self._recent.popleft()
        if world.attachments.attached_to("arm1"):
            self.force_n = max(self.force_n, float(np.linalg.norm(np.mean(self._recent, axis=0))))


def play(kind: str, robot: str, seed: int, reality: str, skills: Registry) -> tuple[str, float]:
    """Failure of one run, or an empty text, and the largest force, N."""
    for attempt in range(_ATTEMPTS):
        try:
            return _play(task(kind, robot, seed, reality, attempt), seed, skills)
        except OverlapError:  # the arm would overlap the object at the start
            continue
    raise RuntimeError(f"no free pose for {kind} {seed} in front of {robot}")


def _play(data: dict[str, Any], seed: int, skills: Registry) -> tuple[str, float]:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "task.yaml"
        path.write_text(yaml.safe_dump(data), encoding="utf-8")
        file = load_tree_file(path, skills.kinds)
        observer = Observer()
        run = observer.run = Run(file, skills, RunOptions(seed=seed, renderer="ray"))
        observer.begin()
        run.watch(observer)
        with run:
            result = run.finish()
    failed = [leaf for leaf in result.arms["arm1"].leaves.values() if leaf.status == "FAILURE"]
    if failed:
        return f"{failed[0].path}: {failed[0].code} {failed[0].reason}", observer.force_n
    if str(result.outcome) != "SUCCESS":
        return str(result.outcome), observer.force_n
    to = data["arms"]["arm1"]["tree"]["sequence"][0]["grasp"]["then_to"]
    is_hinge = data["objects"]["thing"]["joints"]["joint"]["type"] == "hinge"
    goal = math.radians(to) if is_hinge else to
    reached = observer.highest if goal > 0 else observer.lowest
    end = run.world.joint_position("thing.joint")
    allowed = math.radians(2.0) if is_hinge else 0.005
    if abs(reached - goal) > allowed or abs(end) > allowed:
        return f"reached {reached:.3f} of {goal:.3f}, ended at {end:.3f}", observer.force_n
    return "", observer.force_n


def evaluate(kind: str, robot: str, seed: int, reality: str) -> dict[str, Any]:
    """Failure of a run, or an empty text, and its largest force, N."""
    wrong, force = play(kind, robot, seed, reality, registry())
    outcome = "FAILURE" if wrong else "SUCCESS"
    return {"outcome": outcome, "code": kind if wrong else "", "wrong": wrong, "force_n": force}


def main() -> int:
    """Run all cases and print the figures; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--objects", type=int, default=20)
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS), choices=ROBOTS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reality", default="lab")
    parser.add_argument("--only", choices=KINDS)
    parser.add_argument("--verbose", action="store_true")
    add_options(parser)
    options = parser.parse_args()
    forces: list[float] = []
    cases = [
        {
            "kind": options.only or KINDS[number % len(KINDS)],
            "robot": robot,
            "seed": options.seed + number,
            "reality": options.reality,
        }
        for number in range(options.objects)
        for robot in options.robots
    ]
    with Campaign(options) as campaign:
        for case, found in campaign.run(evaluate, cases):
            wrong, force = found["wrong"], found["force_n"]
            if not wrong:
                forces.append(force)
            if wrong or options.verbose:
                label = f"{case['kind']} {case['seed']} {case['robot']}"
                print(f"{label}: {wrong or 'ok'}, {force:.1f} N", flush=True)
        done, runs = len(forces), len(cases)
        top = max(forces, default=0.0)
        print(f"{options.reality}: {done} of {runs} opened and closed; force of these: median")
        print(f"{np.median(forces or [0.0]):.1f} N, largest {top:.1f} N")
        return int(done < SHARE * runs or top > MOST_N)


if __name__ == "__main__":
    sys.exit(main())
