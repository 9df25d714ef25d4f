"""Picking cubes from the whole table: success and refusal rates, and a map.

    python -m benchmarks.picking [--poses 50] [--seed 0] [--back 0] [--out DIR]

Each random pose on the table top is a separate run: attach the cube, then lift it by 0.2 m. The
outcome of the tree is compared with the simulator's true state. Exits with code 1 after a false
SUCCESS, if a run fails after it has begun to move, or if less than 95 % of the poses within reach
are picked. A pose is within reach if inverse kinematics alone places a tool that points straight
down on the cube and above it. That holds for the whole table; ``--back 0.3`` moves the arm away,
so that part of it is out of reach.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from benchmarks.campaign import Campaign, add_options, registry
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.behaviors.report import LeafReport, StatusChange
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry

TABLE = ((0.05, 0.65), (-0.75, -0.25))
"""Edges in x and y of the top of the scene ``table``, m."""

# edge of the cube and height of the table, m
EDGE = 0.05
TOP = 0.40
# m
STANDOFF = 0.10
LIFT = 0.20
SCENE = """\
bt_dualarm: 1
world: {{scene: table, time_limit: 60}}
objects:
  cube:
    {{shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, color: yellow,
      pose: {{xyz: [{x:.6f}, {y:.6f}, 0.425], rpy: [0, 0, {yaw:.4f}]}}}}
arms:
  arm1:
    robot: ur5
    base: {{xyz: [0, {back:.3f}, 0.40]}}
    tree:
      sequence:
        - approach_and_attach: {{object: cube}}
        - selector:
            - transport: {{object: cube, to: {{xyz: [{x:.6f}, {y:.6f}, 0.627]}}}}
            - transport: {{object: cube, to: {{xyz: [0.30, -0.45, 0.650]}}}}
"""

Verdict: TypeAlias = Literal["picked", "refused", "failed", "false success"]


@dataclass(frozen=True)
class Place:
    """Pose of a cube: meters, degrees."""

    x: float
    y: float
    yaw: float


@dataclass(frozen=True)
class Attempt:
    """Result of one pose.

    Attributes:
        verdict: picked: truly attached and lifted. refused: failed before the arm moved.
            failed: failed after the arm had moved. lied: outcome and true state differ.
        within_reach: Whether inverse kinematics alone reaches the pose.
        reason: Why it was not picked.
        seconds: Simulated time until the cube was attached, s.
    """

    place: Place
    verdict: Verdict
    within_reach: bool
    reason: str
    seconds: float


def places(count: int, seed: int) -> list[Place]:
    """Uniformly distributed poses of cubes entirely on the table."""
    rng = np.random.default_rng(seed)
    margin = EDGE / np.sqrt(2)
    (left, right), (front, back) = TABLE
    low = (left + margin, front + margin, -45.0)
    high = (right - margin, back - margin, 45.0)
    return [Place(*row) for row in rng.uniform(low, high, size=(count, 3)).tolist()]


class TruthObserver(IdleObserver):
    """Observes the true motion of the arm, and the true pose of the cube in the tool frame."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._start = world.arms["arm1"].q
        self._attached_at: tuple[float, Pose] | None = None
        self.moved = 0.0
        self.time_attached = np.nan

    def on_event(self, change: StatusChange) -> None:
        """Record the pose of the cube after attaching."""
        if change.kind == "approach_and_attach" and change.new == "SUCCESS":
            self.time_attached = change.time
            height = self._world.object_pose("cube").position[2]
            self._attached_at = float(height), self._cube_in_tool()

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the world has its own clock
        """Update the largest displacement of a joint, rad."""
        displacement = float(np.abs(self._world.arms["arm1"].q - self._start).max())
        self.moved = max(self.moved, displacement)

    def holds(self) -> bool:
        """Whether the cube is attached, was lifted, and has not moved in the hand."""
        if self._attached_at is None or self._world.attachments.find("arm1", "cube") is None:
            return False
        height, in_tool = self._attached_at
        rise = float(self._world.object_pose("cube").position[2]) - height
        return rise > LIFT - 0.01 and in_tool.distance(self._cube_in_tool()) < 0.002

    def _cube_in_tool(self) -> Pose:
        return self._world.arms["arm1"].tool_pose.inverse @ self._world.object_pose("cube")


def attempt(place: Place, skills: Registry, back: float = 0.0) -> Attempt:
    """Run one pose, with the arm ``back`` m farther from the table."""
    text = SCENE.format(x=place.x, y=place.y, yaw=place.yaw, back=back)
    with Run(load_tree_file(text, skills.kinds), skills) as opened:
        reach = within_reach(opened.world, place)
        observer = TruthObserver(opened.world)
        opened.watch(observer)
        arm = opened.finish().arms["arm1"]
    failed = [leaf for leaf in arm.runs if leaf.status == "FAILURE"]
    succeeded = arm.outcome == "SUCCESS"
    verdict: Verdict = "failed"
    if succeeded or observer.holds():
        verdict = "picked" if succeeded and observer.holds() else "false success"
    elif observer.moved < 1e-3:
        verdict = "refused"
    return Attempt(place, verdict, reach, _reasons(failed), observer.time_attached)


def run_case(x: float, y: float, yaw: float, back: float) -> dict[str, Any]:
    """Result of a pose as JSON values."""
    one = attempt(Place(x, y, yaw), registry(), back)
    outcome = "SUCCESS" if one.verdict == "picked" else "FAILURE"
    return {"outcome": outcome, "code": one.verdict, **asdict(one)}


def within_reach(world: World, place: Place) -> bool:
    """Whether a tool that points straight down reaches the cube and the point above it."""
    arm = world.arms["arm1"]
    kinematics = Kinematics(arm.robot, arm.base)
    top = (place.x, place.y, TOP + EDGE)
    above = (place.x, place.y, TOP + EDGE + STANDOFF)
    return any(
        all(_reaches(kinematics, Pose.from_rpy(at, (np.pi, 0, turn)), arm.q) for at in (top, above))
        for turn in np.deg2rad(np.arange(0, 360, 30))
    )


def _reaches(kinematics: Kinematics, target: Pose, near: Vector) -> bool:
    try:
        kinematics.solve(target, near)
    except Failure:
        return False
    return True


def _reasons(failed: Sequence[LeafReport]) -> str:
    return "; ".join(f"{leaf.skill} {leaf.code}: {leaf.reason}" for leaf in failed)


def report(attempts: Sequence[Attempt]) -> bool:
    """Print the figures; returns whether all goals are met."""
    counts = Counter(attempt.verdict for attempt in attempts)
    reachable = [attempt for attempt in attempts if attempt.within_reach]
    picked = sum(attempt.verdict == "picked" for attempt in reachable)
    share = picked / len(reachable) if reachable else 1.0
    for number, one in enumerate(attempts):
        if one.verdict != "picked":
            where = f"({one.place.x:.3f}, {one.place.y:.3f}), {one.place.yaw:.0f}°"
            reach = "within reach" if one.within_reach else "out of reach"
            print(f"{number:3} {one.verdict:8} {reach:13} at {where:24} {one.reason}")
    print(", ".join(f"{name} {counts[name]}" for name in get_args(Verdict)))
    print(f"within reach: {len(reachable)} of {len(attempts)}, picked {100 * share:.1f} % of them")
    seconds = [one.seconds for one in attempts if one.verdict == "picked"]
    if seconds:
        print(
            f"simulated time to attach: median {np.median(seconds):.2f} s, max {max(seconds):.2f} s"
        )
    return share >= 0.95 and counts["failed"] == counts["false success"] == 0


def draw(attempts: Sequence[Attempt], back: float, path: Path) -> None:
    """Draw a map of the table with the outcome of each pose."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    figure = Figure(figsize=(7, 6), layout="constrained")
    axes = figure.add_subplot()
    (left, right), (front, back) = TABLE
    axes.add_patch(Rectangle((left, front), right - left, back - front, color="#eee4d8", zorder=0))
    styles = {"picked": ("o", "#2a8c4a"), "refused": ("s", "#8a8f98"), "failed": ("X", "#c2402f")}
    for verdict, (marker, color) in {**styles, "false success": ("P", "#7a1fa2")}.items():
        found = [one.place for one in attempts if one.verdict == verdict]
        label = f"{verdict} ({len(found)})"
        axes.scatter(
            [p.x for p in found], [p.y for p in found], marker=marker, c=color, label=label
        )
    axes.plot(0, back, marker="^", color="black", linestyle="none", label="base of the arm")
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="Picking a cube from the table")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    figure.savefig(path, dpi=120)


def main() -> int:
    """Parse the options and run the benchmark; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--poses", type=int, default=50, help="number of poses")
    parser.add_argument("--seed", type=int, default=0, help="seed of the poses")
    parser.add_argument("--back", type=float, default=0.0, help="move the arm away by so many m")
    parser.add_argument(
        "--out", type=Path, default=Path("out/picking"), help="folder of the map and the results"
    )
    add_options(parser, has_out=True)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    cases = [
        {**asdict(place), "back": arguments.back}
        for place in places(arguments.poses, arguments.seed)
    ]
    with Campaign(arguments) as campaign:
        attempts = [
            Attempt(
                Place(**found["place"]),
                found["verdict"],
                found["within_reach"],
                found["reason"],
                found["seconds"],
            )
            for _, found in campaign.run(run_case, cases)
        ]
        good = report(attempts)
        draw(attempts, arguments.back, arguments.out / "picking.png")
        print(f"map: {arguments.out / 'picking.png'}")
        return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
