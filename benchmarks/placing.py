"""Placing: measured and true contact forces, success rate and position errors.

    python -m benchmarks.placing [--runs 10] [--seed 0] [--robot ur5] [--gripper robotiq_2f85]
                                 [--reality lab]
    python -m benchmarks.placing --poses 100 [--tight] [--seed 0] [--reality lab]

In each run, an object of 0.05 to 1.5 kg (for a suction cup up to 0.8 kg) is grasped and placed
elsewhere. ``felt`` is ``impact_n``; ``true`` the largest force between object and ground until the
gripper opens; ``after`` that from then to the end, minus the object's weight. Exits with code 1 if
an object is not placed, or is released before the ground bears any of its weight.

With ``--poses`` the runs vary five robots, three grippers, top, side and tilted grasps, tables,
shelves and bins; they place the object directly, after carrying it or after `locate`, at random
poses. A failed pose counts as reachable unless none of 200 random starts of the inverse kinematics
leads to a posture 8 mm above it, with cans turned at random about their axes, from which the whole
line down and the retreat can be followed without collision. With ``--tight`` goals are as far out
as an arm reaches, boards above shelves are lower, and cans have any yaw angle. ``lower`` and
``turned`` count the poses that were approached from less than the required height, or with the can
turned about its axis. A branch jump is a motion that does not begin at the arm's configuration. A
SUCCESS is false if the object is more than 9 mm or 6° from its goal a second later, or touches the
tool. Goals: 97 % of the reachable poses placed, no branch jump, no false SUCCESS; exits with code 1
if one is missed.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

import bt_dualarm as bt
from benchmarks.campaign import Campaign
from benchmarks.grip_arguments import grip_cases, grip_parser
from bt_dualarm.behaviors.report import LeafReport, StatusChange
from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.sim.penetration import SHALLOW_DEPTH
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.paths import line

TABLE = 0.40
"""Height of the table's top, m."""

PLACE_METRICS = ("impact_n", "placed_error_m", "placed_turned_rad")
"""Metrics of `place`."""


def task(options: argparse.Namespace, seed: int) -> dict[str, Any]:
    """The tree file of one run."""
    rng = np.random.default_rng(seed)
    cup = options.gripper == "suction_cup"
    shape = str(rng.choice(["box", "cylinder"]))
    edges = [float(edge) for edge in rng.uniform(0.045 if cup else 0.025, 0.065, 3)]
    size, height = (
        (edges, edges[2] / 2) if shape == "box" else ([edges[0] / 2, edges[1]], edges[1] / 2)
    )
    x = (0.10, 0.24) if options.robot == "ur3" else (0.20, 0.45)
    y = (-0.36, -0.25) if options.robot == "ur3" else (-0.52, -0.32)
    start, end = ([float(rng.uniform(*x)), float(rng.uniform(*y))] for _ in range(2))
    mass = float(np.exp(rng.uniform(np.log(0.05), np.log(0.8 if cup else 1.5))))
    pose = {"xyz": [*start, TABLE + height + 5e-4], "rpy": [0, 0, float(rng.uniform(0, 90))]}
    declared = {"shape": shape, "size": size, "mass": mass, "pose": pose}
    place = {"object": "thing", "at": {"xyz": [*end, TABLE + height]}}
    leaves = [{"grasp": {"object": "thing"}}, {"place": place}]
    arm = {"robot": options.robot, "gripper": options.gripper, "base": {"xyz": [0, 0, TABLE]}}
    return {
        "bt_dualarm": 1,
        "name": "placing",
        "world": {"scene": "table", "reality": options.reality, "seed": seed, "time_limit": 60},
        "objects": {"thing": declared},
        "arms": {"arm1": arm | {"tree": {"sequence": leaves}}},
    }


class Ground(IdleObserver):
    """Contact force between the ground and the object while it is placed.

    Attributes:
        pressed, after: Largest force before and after the gripper begins to open, N.
        began: Simulated time at which `place` began, s.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._force = np.empty(6)
        self.pressed = self.after = 0.0
        self.began: float | None = None
        world.on_forces.append(self._measure)

    def on_event(self, change: StatusChange) -> None:
        """Record when the object is grasped."""
        if change.kind == "grasp" and change.new == "SUCCESS":
            self.began = change.time

    def _measure(self) -> None:
        if self.began is None:
            return
        force = self._ground_force()
        if self._world.grippers["arm1"].commanded.width > 0.0:
            self.after = max(self.after, force)
        else:
            self.pressed = max(self.pressed, force)

    def _ground_force(self) -> float:
        model = self._world.model
        data = self._world.data
        obj = self._world.object_geom("thing")
        arm_geoms = self._world.arms["arm1"].geom_ids
        force = np.zeros(3)
        for i, (one, other) in enumerate(data.contact.geom.tolist()):
            if obj in (one, other) and not {one, other} & set(arm_geoms):
                mujoco.mj_contactForce(model, data, i, self._force)
                frame = data.contact.frame[i].reshape(3, 3)
                force += (1.0 if other == obj else -1.0) * (self._force[:3] @ frame)
        return float(np.linalg.norm(force))


def run(file: dict[str, Any]) -> tuple[LeafReport, Ground]:
    """The last leaf of a run, and the forces on the ground."""
    with bt.open(file) as opened:
        ground = Ground(opened.world)
        opened.watch(ground)
        return opened.finish().arms["arm1"].runs[-1], ground


ROBOTS = ("ur3", "ur5", "ur10", "panda", "xarm7")
GRIPPERS = ("robotiq_2f85", "panda_hand", "suction_cup")
APPROACHES = ("top", "side", "tilted")
GROUNDS = ("table", "shelf", "bin")
BEFORE = ("grasp", "carry", "locate")
REACHES = {
    "ur3": (0.24, 0.42),
    "ur5": (0.35, 0.68),
    "ur10": (0.45, 0.95),
    "panda": (0.38, 0.62),
    "xarm7": (0.35, 0.58),
}
"""Distances of the goals from the base, m."""

_TABLE_X = (0.08, 0.62)
_TABLE_Y = (-0.72, -0.28)


@dataclass(frozen=True)
class RandomPose:
    """A randomly drawn pose.

    Attributes:
        file: The tree file.
        goal: Goal pose of the object.
        label: What was drawn, as text.
    """

    file: dict[str, Any]
    goal: Pose
    label: str


def draw_pose(
    number: int, seed: int, reality: str, again: int = 0, *, tight: bool = False
) -> RandomPose:
    """Draw a pose, with the arm and its surroundings.

    Args:
        number: Number of the pose; determines robot and gripper.
        seed: Seed of the random numbers.
        reality: Name of the reality.
        again: Number of earlier attempts for this number, in which objects overlapped.
        tight: Whether goals are far out, boards low, and cans turned arbitrarily.
    """
    rng = np.random.default_rng((seed, number, again))
    robot = ROBOTS[number % 5]
    gripper = GRIPPERS[number // 5 % 3]
    approach = APPROACHES[int(rng.integers(3))]
    ground = GROUNDS[int(rng.integers(3))]
    if tight and ground == "shelf":
        approach = "side"  # no other approach fits
    if approach == "side" and ground == "bin":
        ground = "shelf"  # the hand does not go through its wall
    if approach == "top" and ground == "shelf":
        ground = "table"
    before = BEFORE[int(rng.integers(3))]
    cup = gripper == "suction_cup"
    obj: dict[str, Any] = {"mass": float(rng.uniform(0.05, 0.4)), "color": "red"}
    height = float(rng.uniform(0.07, 0.11))
    wide = float(rng.uniform(0.036, 0.05))
    if cup or rng.random() < 0.5:
        deep = float(rng.uniform(0.036, 0.055))
        obj |= {"shape": "box", "size": [max(deep, 0.045) if cup else deep, wide, height]}
    else:
        obj |= {"shape": "cylinder", "size": [wide / 2, height]}
    near, far = REACHES[robot]
    if tight:
        near = 0.8 * far
        far = 1.15 * far
    room = (0.015, 0.08) if tight else (0.12, 0.2)  # below the upper board
    small = robot == "ur3"
    x, y = ((0.10, 0.24), (-0.36, -0.28)) if small else ((0.20, 0.42), (-0.50, -0.32))
    objects: dict[str, Any] = {}
    top = TABLE
    while True:
        start = np.array((rng.uniform(*x), rng.uniform(*y)))
        angle = rng.uniform(-np.pi / 2.2, 0.0) if ground != "shelf" else rng.uniform(0.0, 1.2)
        there = rng.uniform(near, far) * np.array((np.cos(angle), np.sin(angle)))
        on_table = _TABLE_X[0] < there[0] < _TABLE_X[1] and _TABLE_Y[0] < there[1] < _TABLE_Y[1]
        if ground == "shelf" or (on_table and np.linalg.norm(there - start) > 0.12):
            break
    bearing = np.arctan2(start[1], start[0])
    if ground == "shelf":
        top = float(rng.uniform(0.45, 0.70))
        half = 0.11
        turn = float(np.degrees(angle))
        for name, level in (("low", top - 0.01), ("high", top + height + rng.uniform(*room))):
            at = {"xyz": [*there.tolist(), float(level)], "rpy": [0, 0, turn]}
            objects[name] = {"shape": "box", "size": [2 * half, 0.3, 0.02], "mass": 5} | {
                "fixed": True,
                "pose": at,
            }
    if ground == "bin":
        inner = float(rng.uniform(0.08, 0.11))
        wall = 0.05
        for name, dx, dy in (("w", -1, 0), ("e", 1, 0), ("s", 0, -1), ("n", 0, 1)):
            at = {"xyz": [there[0] + dx * inner, there[1] + dy * inner, TABLE + wall / 2]}
            size = [0.01 if dx else 2 * inner, 0.01 if dy else 2 * inner, wall]
            objects[name] = {"shape": "box", "size": size, "mass": 5, "fixed": True, "pose": at}
    components = {"top": (0.0, 1.0), "side": (1.0, 0.0), "tilted": (0.7, 0.7)}
    flat, down = components[approach]
    along = [flat * float(np.cos(bearing)), flat * float(np.sin(bearing)), -down]
    # One of its faces points to the arm, at the start and at the goal.
    face = float(np.degrees(bearing))
    within = 180.0 if tight and obj["shape"] == "cylinder" else 15.0
    yaw = float(np.degrees(angle)) + float(rng.uniform(-within, within))
    goal = Pose.from_rpy((*there.tolist(), top + height / 2), (0.0, 0.0, np.radians(yaw)))
    objects["thing"] = obj | {
        "pose": {"xyz": [*start.tolist(), TABLE + height / 2 + 5e-4], "rpy": [0, 0, face]}
    }
    grasp: dict[str, Any] = {"object": "thing", "approach": along}
    leaves: list[Any] = []
    arm: dict[str, Any] = {"robot": robot, "gripper": gripper, "base": {"xyz": [0, 0, TABLE]}}
    if before == "locate":
        arm["camera"] = {"mount": "wrist", "resolution": [320, 240], "fov": 50, "fps": 30}
        look = {"xyz": [*start.tolist(), TABLE + height / 2]}
        leaves += [
            {"look_at": {"at": look, "distance": 0.3 if small else 0.4}},
            {"locate": {"object": "thing", "pose": "{seen}", "accuracy": 0.002}},
        ]
        grasp["at"] = "{seen}"
    leaves.append({"grasp": grasp})
    if before == "carry":
        middle = start * (1.0 if small else 0.95)
        leaves.append(
            {"transport": {"object": "thing", "to": {"xyz": [*middle.tolist(), TABLE + 0.22]}}}
        )
    at = {"xyz": goal.position.tolist(), "rpy": [0, 0, yaw]}
    leaves += [{"place": {"object": "thing", "at": at}}, {"wait": {"seconds": 1.0}}]
    file = {
        "bt_dualarm": 1,
        "name": "placing",
        "world": {"scene": "table", "reality": reality, "seed": seed, "time_limit": 120},
        "objects": objects,
        "arms": {"arm1": arm | {"tree": {"sequence": leaves}}},
    }
    return RandomPose(file, goal, f"{robot} {gripper} {approach} {ground} after {before}")


class Oracle(IdleObserver):
    """Whether a refused pose is reachable: is there a posture from which it can be placed?

    Attributes:
        reachable: Whether there is one; None before the search.
    """

    def __init__(self, world: World, goal: Pose) -> None:
        self._world = world
        self._goal = goal
        self.reachable: bool | None = None

    def on_event(self, change: StatusChange) -> None:
        """Search while the object is still held, if the pose was refused."""
        if change.kind == "place" and change.new == "FAILURE" and change.code in REFUSALS:
            self.reachable = self._search()

    def _search(self) -> bool:
        world = self._world
        held = world.attachments.find("arm1", "thing")
        if held is None:
            return True
        robot = world.robots["arm1"]
        kinematics = Kinematics(robot, world.arms["arm1"].base)
        in_tool = robot.tool.inverse @ held.relative
        is_round = world.objects["thing"].shape == "cylinder"
        heights = np.outer((LOWEST_M, 0.006, -0.004), (0.0, 0.0, 1.0))
        free = CollisionChecker(world, "arm1")
        alone = CollisionChecker(world, "arm1", ignore=frozenset({"thing"}))
        rng = np.random.default_rng(0)
        lower = kinematics.lower
        upper = kinematics.upper
        for _ in range(200):
            turn = rng.uniform(-np.pi, np.pi) if is_round else 0.0
            tool = self._goal @ Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, turn)) @ in_tool.inverse
            up = [Pose(tool.position + height, tool.quaternion) for height in heights]
            back = tool @ Pose.from_rpy((0.0, 0.0, -0.08))
            try:
                q = kinematics.solve(up[0], rng.uniform(lower, upper))
                down = kinematics.follow_on(line(up[0], up[1]).poses, q)
                low = kinematics.follow_on(line(up[1], tool).poses, down[-1])
                kinematics.follow_on(line(tool, up[2]).poses, low[-1])
                out = kinematics.follow_on(line(tool, back).poses, low[-1])
            except bt.Failure:
                continue
            if free.first_contact(down) is None and alone.first_contact(out) is None:
                return True
        return False


LOWEST_M = 0.008
"""Smallest height above the goal from which objects are lowered, m."""

REFUSALS = ("UNREACHABLE", "PATH_BROKEN", "SINGULAR", "IN_COLLISION", "INVALID_TARGET", "NO_PLAN")
"""Codes with which a pose is refused before the arm moves there."""


def open_pose(number: int, seed: int, reality: str, tight: bool) -> tuple[RandomPose, bt.Run]:
    """A random pose without overlaps at the start, and its run."""
    for again in range(20):
        one = draw_pose(number, seed, reality, again, tight=tight)
        try:
            opened = bt.open(one.file)
        except bt.WorldError:
            continue
        if any(opened.world.overlaps(SHALLOW_DEPTH)):  # contacts would throw the object away
            opened.close()
            continue
        return one, opened
    raise AssertionError("20 random scenes in a row have overlaps at the start")


def try_pose(number: int, seed: int, reality: str, *, tight: bool) -> dict[str, Any]:
    """Place an object at a random pose; returns what to count and what to print."""
    one, opened = open_pose(number, seed, reality, tight)
    with opened:
        oracle = Oracle(opened.world, one.goal)
        opened.watch(oracle)
        result = opened.finish()
        runs = result.arms["arm1"].runs
        leaf = next((leaf for leaf in runs if leaf.skill == "place"), runs[-1])
        true = opened.world.object_pose("thing")
        touched = opened.world.touches("arm1", "thing")
    counts: Counter[str] = Counter()
    declared = f"{number:3} {one.label}: {leaf.skill} {leaf.status} {leaf.code or ''}"
    if leaf.skill != "place":
        counts["not held"] += 1
        return {"outcome": "SKIPPED", "counts": counts, "message": f"{declared} {leaf.reason}"}
    counts["asked"] += 1
    counts["jumps"] += "the motion starts" in leaf.reason
    counts["exceptions"] += leaf.code == "EXCEPTION"
    if leaf.status == "SUCCESS":
        counts["reachable"] += 1
        spec = one.file["objects"]["thing"]
        rotation_error = bt.KnownShape(spec["shape"], tuple(spec["size"])).angle(true, one.goal)
        away = true.distance(one.goal)
        if away > 0.009 or rotation_error > np.radians(6.0) or touched:
            counts["false"] += 1
            declared += (
                f" FALSE: {1e3 * away:.1f} mm, {np.degrees(rotation_error):.1f}°, {touched=}"
            )
        counts["placed"] += 1
        declared += f" {1e3 * away:.2f} mm"
        for count, metric in (("lower", "lowered_from_m"), ("turned", "spun_rad")):
            if metric in leaf.metrics:
                counts[count] += 1
                declared += f", {metric} {float(leaf.metrics[metric]):.3g}"
    else:
        reachable = oracle.reachable is not False
        counts["reachable"] += reachable
        declared += f" ({'reachable' if reachable else 'out of reach'}) {leaf.reason}"
    return {"outcome": leaf.status, "code": leaf.code, "counts": counts, "message": declared}


def run_poses(options: argparse.Namespace, campaign: Campaign) -> int:
    """Place objects at random poses and print the figures; returns 1 if a goal is missed."""
    counts: Counter[str] = Counter()
    settings = {name: getattr(options, name) for name in ("seed", "reality", "tight")}
    cases = [{"number": number, **settings} for number in range(options.poses)]
    for _, found in campaign.run(try_pose, cases):
        counts.update(found["counts"])
        print(found["message"], flush=True)
    share = counts["placed"] / max(counts["reachable"], 1)
    print(
        f"{options.reality}: {options.poses} poses, {counts['not held']} not held before, "
        f"{counts['asked']} asked, {counts['reachable']} reachable, {counts['placed']} placed "
        f"({100 * share:.1f} %; {counts['lower']} from lower, {counts['turned']} turned), "
        f"{counts['jumps']} branch jumps, "
        f"{counts['exceptions']} exceptions, {counts['false']} false SUCCESS"
    )
    return 1 if share < 0.97 or counts["jumps"] or counts["false"] or counts["exceptions"] else 0


def place_once(seed: int, **settings: str) -> dict[str, Any]:
    """Figures of one run, or what went wrong."""
    file = task(argparse.Namespace(**settings), seed)
    leaf, ground = run(file)
    mass = file["objects"]["thing"]["mass"]
    if leaf.skill != "place" or leaf.status != "SUCCESS":
        message = f"seed {seed}: {leaf.skill} {leaf.code}: {leaf.reason}"
        outcome = "FAILURE" if leaf.skill == "place" else "SKIPPED"
        return {"outcome": outcome, "code": leaf.code, "wrong": message}
    felt, position_error, rotation_error = (float(leaf.metrics[name]) for name in PLACE_METRICS)
    seconds = (leaf.ended_s or 0.0) - leaf.started_s
    figures = [
        felt,
        ground.pressed,
        ground.after - 9.81 * mass,
        position_error,
        rotation_error,
        seconds,
    ]
    found = {
        "figures": figures,
        "message": f"seed {seed}: {mass:.2f} kg " + " ".join(f"{value:.3g}" for value in figures),
    }
    if ground.pressed <= 0.0:
        message = f"seed {seed}: released before the ground bore any weight"
        return {"outcome": "FAILURE", "code": "LET_GO", "wrong": message, **found}
    return {"wrong": "", **found}


def main() -> int:
    """Run all cases and print the figures; returns 1 if an object was not placed."""
    parser = grip_parser(__doc__, 10)
    parser.add_argument("--verbose", action="store_true", help="print each run")
    parser.add_argument("--poses", type=int, default=0, help="number of random poses to place at")
    parser.add_argument("--tight", action="store_true", help="use poses with less room")
    options = parser.parse_args()
    with Campaign(options) as campaign:
        return run_poses(options, campaign) if options.poses else run_seeds(options, campaign)


def run_seeds(options: argparse.Namespace, campaign: Campaign) -> int:
    """Place the objects of all seeds and print the figures; returns 1 if one was not placed."""
    rows: list[list[float]] = []
    failed = 0
    for _, found in campaign.run(place_once, grip_cases(options)):
        failed += found.get("outcome") == "FAILURE"
        if found["wrong"]:
            print(found["wrong"], flush=True)
        if "figures" in found:
            rows.append(found["figures"])
            if options.verbose:
                print(found["message"])
    worst = np.max(rows, axis=0).tolist() if rows else [float("nan")] * 6
    arm = f"{options.robot}, {options.gripper}, {options.reality}"
    print(f"{arm}: {len(rows)} placed, {failed} not")
    names = ("felt N", "true N", "after, beyond its weight, N", "error m", "turned rad", "seconds")
    print("  worst: " + ", ".join(f"{n} {v:.3g}" for n, v in zip(names, worst, strict=True)))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
