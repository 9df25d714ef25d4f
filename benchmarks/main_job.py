"""The demo with other robots: one arm carries a cube along two curves, another one tracks it.

    python -m benchmarks.main_job [--variants 200] [--seed 0] [--reality lab rough] [--lines]

Each variant is random: leader, its gripper and speed; follower, its viewpoint, frame rate and
latency of its camera, reality. The trees are those of `trees/pick_and_track.yaml`, with the
leader's poses within its reach. Only followers take part whose camera can face the curves squarely.

A variant counts if the leader ends with SUCCESS and the follower can execute the motion from the
first curve to the last, and in the second before it gives up: its tool can follow the true motion
of the cube within its limits of velocity, acceleration and jerk and the `reach` of `track`, without
a collision with itself or the floor, and is not slowed by its guard beside the leader. ``share`` is
the share of its own speed that this takes: its joints need ``share`` of a velocity limit, ``share``
squared of an acceleration limit, or ``share`` cubed of a jerk limit. Goals: SUCCESS in 95 % of
those variants, every run ends, and no SUCCESS is false (a true RMS error above ``max_error``);
exits with code 1 if one is missed.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.signal import savgol_filter

from benchmarks.campaign import Campaign, add_options, registry
from benchmarks.vantage import BASE, POSTURE, Vantage, vantage
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.behaviors.report import LeafReport
from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.core.errors import DualArmError, Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.world import World
from bt_dualarm.spec.yaml_reader import Data

LEADERS: Final = ("ur3", "ur5", "ur10", "panda", "xarm7", "fr3", "ur3e", "ur5e", "ur10e")
FOLLOWERS: Final = (*LEADERS, "z1", "jaco2")
GRIPPERS: Final = ("robotiq_2f85", "panda_hand", "suction_cup", "none")
RATES: Final = (30.0, 40.0, 60.0, 90.0)
LATENCIES_S: Final = (0.0, 0.017, 0.02, 0.035, 0.049)
SPEEDS: Final = (0.25, 0.5, 0.75, 1.0)
GOAL_SHARE: Final = 0.95

_LOOK = (-1.0, 0.0, 0.0)  # toward the leader
_DISTANCE_M = 0.35
_RESTS_S = 3.0  # time that the cube rests at the end
_LIMIT_S = 240.0
_SAMPLE_STEPS = 5  # steps between the points of the true path that the follower would execute
_WINDOW = 13  # number of these points from which its rates are determined
_JUDGED_S = 1.0  # last time span before a follower gives up, which counts too
_REACH_M = 0.3  # default distance from the start within which `track` follows
_PLACES = 5
_FLOOR_M = 0.0  # smallest height of the follower's base
_CURVES = ("circle", "lissajous")
_REFERENCE = "ur5"  # whose poses `trees/pick_and_track.yaml` has
_CENTER = ((0.42, 0.62), (-0.15, 0.15), (0.25, 0.40))  # of the curves, from its base, m
_CUBE = (0.40, -0.45)  # on the table, from the leader's base, m
_TABLE = ((0.09, 0.61), (-0.71, -0.29), 0.40)  # where the cube can lie, and the height, m
_SIZE_M = 0.05


@dataclass(frozen=True)
class Variant:
    """One variant of the demo.

    Attributes:
        leader: Robot that carries the cube.
        gripper: Its gripper, ``none`` for a magnetic tool.
        speed: Speed of both curves, as a fraction of the leader's limits.
        center: Center of the curves in the world, m.
        follower: Robot that follows.
        place: Seed of its viewpoint.
        fps: Frame rate, Hz.
        latency: Age of an image when it arrives, s.
        reality: Model mismatch of both arms.
        sized: Whether the follower knows the size of the cube.
        seed: Seed of the run.
    """

    leader: str
    gripper: str
    speed: float
    center: tuple[float, float, float]
    follower: str
    place: int
    fps: float
    latency: float
    reality: str
    sized: bool
    seed: int

    def __str__(self) -> str:
        camera = f"{self.fps:g}/{1e3 * self.latency:.0f}"
        sized = "sized" if self.sized else "-"
        return (
            f"{self.leader:<6} {self.gripper:<12} {self.speed:4.2f} {self.follower:<6} "
            f"{camera:<6} {self.reality:<5} {sized:<5} {self.seed}"
        )


@dataclass(frozen=True)
class Measured:
    """Measurements of one variant.

    Attributes:
        leader: Failure code of the leader's tree, or ``SUCCESS``.
        leaf: Failed leaf of the leader, if any, with its message.
        code: Failure code of `track`, ``SUCCESS``, or ``ENDLESS`` if it did not end.
        reason: Message of the failure of `track`.
        cause: Its metric ``cause``, if any.
        share: Share of the follower's speed that the curves need; infinite if they are infeasible,
            NaN if the leader did not complete them.
        rms: True RMS error, minus its mean, during both curves, m; NaN if `track` ended before.
        true: The metric ``true_rms_m``, m.
        allowed: The metric ``max_error_m``, m.
    """

    leader: str
    leaf: str
    code: str
    reason: str
    cause: str
    share: float
    rms: float
    true: float
    allowed: float

    @property
    def counts(self) -> bool:
        """Whether the follower can execute what a successful leader did."""
        return self.leader == "SUCCESS" and self.share < 1.0 and self.cause != "guard"

    @property
    def is_false(self) -> bool:
        """Whether it is a SUCCESS with a larger error than allowed."""
        return self.code == "SUCCESS" and self.true > self.allowed


@dataclass
class _Paths(IdleObserver):
    """Records the positions of the cube and the follower's tool."""

    world: World
    rows: list[tuple[float, ...]] = field(default_factory=list)

    def after_step(self, time: float) -> None:
        tool = self.world.arms["arm2"].tool_pose.position
        cube = self.world.object_pose("cube").position
        self.rows.append((time, *cube.tolist(), *tool.tolist()))


def variants(options: argparse.Namespace) -> Iterator[Variant]:
    """All variants, with equal numbers of each leader, follower and gripper."""
    rng = np.random.default_rng(options.seed)
    remaining: dict[str, list[str]] = defaultdict(list)

    def next_of(role: str, names: tuple[str, ...]) -> str:
        if not remaining[role]:
            remaining[role] = [str(name) for name in rng.permutation(names)]
        return remaining[role].pop()

    for _ in range(options.variants):
        leader = next_of("leader", LEADERS)
        x, y, z = (_scale(leader) * rng.uniform(*ends) for ends in _CENTER)
        yield Variant(
            leader=leader,
            gripper=next_of("gripper", GRIPPERS),
            speed=float(rng.choice(SPEEDS)),
            center=(round(x, 3), round(y, 3), round(z + _TABLE[2], 3)),
            follower=next_of("follower", FOLLOWERS),
            place=int(rng.integers(1, 10**6)),
            fps=float(rng.choice(RATES)),
            latency=float(rng.choice(LATENCIES_S)),
            reality=str(rng.choice(options.reality)),
            sized=bool(rng.integers(2)),
            seed=int(rng.integers(1, 10**6)),
        )


@cache
def _scale(leader: str) -> float:
    """Reach of a robot relative to that for which the poses of the demo were chosen, at most 1."""
    reach, reference = (
        Kinematics(load_robot(name), Pose.from_rpy((0, 0, 0))).bounding_ball[1]
        for name in (leader, _REFERENCE)
    )
    return min(1.0, float(reach / reference))


def run_variant(**fields: Any) -> dict[str, Any]:  # Any: fields of `Variant`
    """Measurements of a variant, or why it was rejected."""
    variant = Variant(**fields)
    try:
        found = follow(variant, _viewpoint(variant))
    except Failure as failure:
        return {"outcome": "SKIPPED", "why": str(failure)}
    except DualArmError as error:
        return {"outcome": "SKIPPED", "why": f"{type(error).__name__}: {error}"}
    good = found.code == "SUCCESS" and found.leader == "SUCCESS" and not found.is_false
    outcome = "SUCCESS" if good else "FAILURE" if found.counts or found.is_false else "SKIPPED"
    return {"outcome": outcome, "code": found.code, "found": asdict(found)}


def _viewpoint(variant: Variant) -> Vantage:
    """Viewpoint of the follower: the first of some random ones with its base above the floor.

    Raises:
        Failure: ``OUT_OF_REACH`` if there is none.
    """
    for place in range(variant.place, variant.place + _PLACES):
        viewpoint = vantage(variant.follower, _LOOK, place)
        if _base(variant, viewpoint)[2] >= _FLOOR_M:
            return viewpoint
    raise Failure("OUT_OF_REACH", f"{variant.follower} would stand below the floor")


def _base(variant: Variant, viewpoint: Vantage) -> Vector:
    """Position of the follower's base, of shape (3,), m."""
    base: Vector = np.array(BASE[0]) + np.array(variant.center) - viewpoint.ahead(_DISTANCE_M)
    return base


def follow(variant: Variant, viewpoint: Vantage) -> Measured:
    """Run one variant.

    Raises:
        DualArmError: The file check rejects the variant.
    """
    base = _base(variant, viewpoint)
    with tempfile.TemporaryDirectory() as folder:
        tree = _tree(variant, viewpoint.write_description(Path(folder)), base)
        file = load_tree_file(tree, registry().kinds, folder=Path(folder))
        with Run(file, registry(), RunOptions(seed=variant.seed, renderer="ray")) as run:
            paths = _Paths(run.world)
            run.watch(paths)
            arms = run.finish().arms
            checker = CollisionChecker(run.world, "arm2", {}, frozenset({"arm1", "cube"}))
    rows = np.array(paths.rows)
    leader, follower = list(arms["arm1"].runs), arms["arm2"].runs
    failed = next((leaf for leaf in reversed(leader) if str(leaf.status) != "SUCCESS"), None)
    track = next(leaf for leaf in follower if leaf.skill == "track")
    code = "SUCCESS" if str(track.status) == "SUCCESS" else str(track.code or "ENDLESS")
    if code in ("HALTED", "TIMEOUT"):
        code = "ENDLESS"
    return Measured(
        leader="SUCCESS" if failed is None else str(failed.code or "ENDLESS"),
        leaf="" if failed is None else f"{failed.path}: {failed.reason}",
        code=code,
        reason=str(track.reason),
        cause=str(track.metrics.get("cause", "")),
        share=_share(variant, viewpoint, base, _judged(leader, track, rows), checker),
        rms=_rms(leader, track, rows),
        true=float(track.metrics.get("true_rms_m", np.nan)),
        allowed=float(track.metrics.get("max_error_m", 0.01)),
    )


def _during(leaves: list[LeafReport], rows: Matrix) -> list[Matrix]:
    """Rows of each curve that the leader has ended, of shape (n, 7), s and m."""
    curves = [leaf for leaf in leaves if leaf.skill in _CURVES and str(leaf.status) == "SUCCESS"]
    ends = [np.inf if leaf.ended_s is None else leaf.ended_s for leaf in curves]
    return [
        rows[(rows[:, 0] >= leaf.started_s) & (rows[:, 0] <= end)]
        for leaf, end in zip(curves, ends, strict=True)
    ]


def _judged(leader: list[LeafReport], track: LeafReport, rows: Matrix) -> Matrix:
    """Rows from the first curve to the last, or from the second before the follower gave up.

    Empty if the leader has not ended both curves.
    """
    curves = _during(leader, rows)
    if len(curves) < len(_CURVES):
        return rows[:0]
    begin = curves[0][0, 0]
    if track.ended_s is not None and str(track.status) != "SUCCESS":
        begin = min(begin, track.ended_s - _JUDGED_S)
    judged: Matrix = rows[(rows[:, 0] >= begin) & (rows[:, 0] <= curves[-1][-1, 0])]
    return judged


def _share(
    variant: Variant, viewpoint: Vantage, base: Vector, rows: Matrix, checker: CollisionChecker
) -> float:
    """Share of the follower's speed that the judged rows need, see `Measured`."""
    if not len(rows):
        return np.nan
    robot = load_robot(variant.follower)
    arm = Kinematics(robot, Pose.from_rpy(base.tolist(), np.radians(BASE[1]).tolist()))
    tool = Pose.from_matrix(arm.matrix(viewpoint.q))
    limits = (robot.limits.velocity, robot.limits.acceleration, robot.limits.jerk)
    offsets = rows[::_SAMPLE_STEPS, 1:4] - np.array(variant.center)
    offsets[:, 0] = 0.0  # it follows in the plane
    if np.linalg.norm(offsets, axis=1).max() > _REACH_M:
        return np.inf
    q = viewpoint.q
    joints = []
    for offset in offsets:
        try:
            q = arm.solve(Pose(tool.position + offset, tool.quaternion), q)
        except Failure:
            return np.inf
        joints.append(q)
    if checker.first_contact(np.array(joints)) is not None:
        return np.inf
    share = 0.0
    step = float(np.median(np.diff(rows[::_SAMPLE_STEPS, 0])))
    for order, limit in enumerate(limits, start=1):
        rates = savgol_filter(joints, _WINDOW, 3, deriv=order, delta=step, axis=0)
        share = max(share, float((np.abs(rates) / limit).max()) ** (1.0 / order))
    return share


def _rms(leader: list[LeafReport], track: LeafReport, rows: Matrix) -> float:
    """True RMS error during both curves, see `Measured`."""
    ended = track.ended_s or np.inf
    curves = [curve for curve in _during(leader, rows) if curve[-1, 0] <= ended]
    if len(curves) < len(_CURVES):
        return np.nan
    both = np.vstack(curves)
    error = (both[:, 4:7] - both[:, 1:4])[:, 1:]
    error -= error.mean(axis=0)
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


def _tree(variant: Variant, robot: str, base: Vector) -> dict[str, Data]:
    """The tree file of a variant."""
    scale = _scale(variant.leader)
    (x_min, x_max), (y_min, y_max), top = _TABLE
    start = [
        float(np.clip(scale * _CUBE[0], x_min, x_max)),
        float(np.clip(scale * _CUBE[1], y_min, y_max)),
        top + 0.5 * _SIZE_M,
    ]
    center = list(variant.center)
    cube: dict[str, Data] = {
        "shape": "box",
        "size": [_SIZE_M] * 3,
        "mass": 0.1,
        "color": "yellow",
        "pose": {"xyz": start},
        "noise": {"xyz": [0.02, 0.02, 0.0], "yaw": 20},
    }
    to: dict[str, Data] = {"xyz": center, "rpy": [0, -90, 0]}
    take: dict[str, Data] = {"grasp": {"object": "cube", "then_at": to}}
    if variant.gripper == "none":
        take = {"approach_and_attach": {"object": "cube", "standoff": 0.10}}
    leader: dict[str, Data] = {
        "robot": variant.leader,
        "gripper": variant.gripper,
        "base": {"xyz": [0, 0, top]},
        "tree": {
            "sequence": [
                take,
                {"transport": {"object": "cube", "to": to}},
                {"wait": {"seconds": 1.5}},
                {"circle": {"plane": "yz", "radius": 0.10, "turns": 2, "speed": variant.speed}},
                {"transport": {"object": "cube", "to": {"xyz": center}}},
                {
                    "lissajous": {
                        "plane": "yz",
                        "amplitudes": [0.10, 0.10],
                        "frequencies": [1, 2],
                        "speed": variant.speed,
                    }
                },
            ]
        },
    }
    track: dict[str, Data] = {
        "plane": "yz",
        "distance": _DISTANCE_M,
        "score": "cube",
        "until_still": _RESTS_S,
    }
    if variant.sized:
        track["target_size"] = _SIZE_M
    follower: dict[str, Data] = {
        "robot": robot,
        "base": {"xyz": base.tolist(), "rpy": list(BASE[1])},
        "posture": POSTURE,
        "camera": {
            "mount": "wrist",
            "resolution": [320, 240],
            "fov": 50,
            "fps": variant.fps,
            "latency": variant.latency,
        },
        "tree": {"track": track},
    }
    world: dict[str, Data] = {
        "scene": "table",
        "time_limit": _LIMIT_S,
        "reality": variant.reality,
    }
    return {
        "bt_dualarm": 1,
        "world": world,
        "objects": {"cube": cube},
        "arms": {"arm1": leader, "arm2": follower},
    }


def summary(results: list[tuple[Variant, Measured]]) -> Iterator[str]:
    """Lines of the tables."""
    leaders = Counter(one.leader for _, one in results)
    yield "leaders: " + ", ".join(f"{count} {code}" for code, count in leaders.most_common())
    known = [(variant, one) for variant, one in results if one.leader == "SUCCESS"]
    yield f"{'':<14} {'runs':>5} {'SUCCESS':>8} {'median':>7} {'p95':>7}  mm RMS; other outcomes"
    groups: dict[str, list[Measured]] = defaultdict(list)
    for variant, found in known:
        share = found.share
        bucket = "<= 0.8" if share <= 0.8 else "0.8 to 1" if share < 1.0 else "above 1"
        groups[f"share {bucket}"].append(found)
        if found.counts:
            for name in (
                f"by {variant.follower}",
                f"{variant.fps:g} Hz",
                f"{1e3 * variant.latency:.0f} ms",
                variant.reality,
                variant.gripper,
                f"speed {variant.speed:g}",
                "counted",
            ):
                groups[name].append(found)
    for name in sorted(groups):
        group = groups[name]
        good = sum(one.code == "SUCCESS" for one in group)
        rms = 1e3 * np.array([one.rms for one in group if not np.isnan(one.rms)])
        others = Counter(f"{one.code} {one.cause}".strip() for one in group)
        del others["SUCCESS"]
        median, late = (np.median(rms), np.percentile(rms, 95)) if len(rms) else (np.nan, np.nan)
        text = ", ".join(f"{count} {code}" for code, count in others.most_common())
        yield f"{name:<14} {len(group):5d} {good:8d} {median:7.2f} {late:7.2f}  {text}"
    all_runs = [one for _, one in results]
    yield f"false SUCCESS: {sum(one.is_false for one in all_runs)}"
    yield f"did not end: {sum('ENDLESS' in (one.code, one.leader) for one in all_runs)}"


def main(arguments: list[str]) -> int:
    """Print the tables; returns 1 if a goal is missed."""
    parser = argparse.ArgumentParser(description="the demo with other robots")
    parser.add_argument("--variants", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reality", nargs="+", default=["lab", "rough"])
    parser.add_argument("--lines", action="store_true", help="print each variant")
    add_options(parser)
    options = parser.parse_args(arguments)
    results: list[tuple[Variant, Measured]] = []
    refused: Counter[str] = Counter()
    with Campaign(options) as campaign:
        for fields, result in campaign.run(run_variant, [asdict(one) for one in variants(options)]):
            variant = Variant(**fields)
            if "found" not in result:
                refused[str(result["why"])[:100]] += 1
                continue
            found = Measured(**result["found"])
            results.append((variant, found))
            if options.lines:
                print(
                    f"{variant}: leader {found.leader} {found.leaf}, share {found.share:.2f}, "
                    f"{1e3 * found.rms:.2f} mm, {found.code} {found.cause} {found.reason}",
                    flush=True,
                )
    for why, count in refused.most_common():
        print(f"rejected, {count}: {why}")
    for text in summary(results):
        print(text)
    counted = [found for _, found in results if found.counts]
    good = sum(found.code == "SUCCESS" for found in counted)
    print(f"followed: {good} of {len(counted)} that the follower can execute (goal: 95 %)")
    endless = any("ENDLESS" in (found.code, found.leader) for _, found in results)
    false = any(found.is_false for _, found in results)
    return int(good < GOAL_SHARE * len(counted) or endless or false)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
