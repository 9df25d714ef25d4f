"""Whole tasks on many robots of the batch: how many succeed, and whether a SUCCESS is ever false.

    python -m benchmarks.false_success [--trees pick_and_track] [--sets lab rough] [--seeds 100]
                                       [--first 0]

Each SUCCESS is compared with the simulator's true state of that moment: what was attached is held
and near the tool, what was transported is where it was to go and still held, what was let go of is
held no more, what was followed is in the camera's image and was followed within 5 mm RMS. At the
end what is held has not moved in the hand, and what was put down lies there. Asked for: lab all
seeds, rough 98 of 100, nothing false. Exit code 1 if that is missed.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from functools import cache
from typing import Any

import numpy as np

from benchmarks.campaign import Campaign, add_options, registry
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.behaviors.report import StatusChange
from bt_dualarm.core.pose import Pose, Vector, camera_pose
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.options import RunOptions, find_tree
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import REALITY_NAMES, RealityName, TreeFile

TREES = ("pick_and_transport", "pick_and_track")
THING = "cube"
AWAY_M = 0.005
"""How far from where it was to be a thing may truly be, and how far from the tool's tip."""
SLIPPED_M = 0.002
FOLLOWED_M = 0.005
ASKED = {"ideal": 1.0, "lab": 1.0, "rough": 0.98}


@dataclass
class Judge(IdleObserver):
    """Looks at the truth whenever a leaf says SUCCESS.

    Attributes:
        world: World of the run.
        goals: Where the thing is to be after a transport, by the name of its node.
        lies: What was said and was not so.
    """

    world: World
    goals: dict[str, Vector]
    lies: list[str] = field(default_factory=list)
    _in_hand: dict[str, Pose] = field(default_factory=dict)
    _holders: frozenset[str] = frozenset()
    _put: Vector | None = None

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the world has its own clock
        """Keep who holds it: a tick may end one leaf and run the next, which lets go."""
        self._holders = frozenset(one.arm for one in self.world.attachments)

    def on_event(self, change: StatusChange) -> None:
        """Compare what is said with what is so."""
        if change.new != "SUCCESS":
            return
        look = getattr(self, f"_{change.kind}", None)
        for lie in look(change) if look else ():
            self.lies.append(f"{change.time:.2f} s: {change.arm}/{change.path}: {lie}")

    def at_the_end(self) -> None:
        """What is held has not moved in the hand; what was put down has stayed."""
        for arm, before in self._in_hand.items():
            slipped = before.distance(self._held_at(arm))
            if slipped > SLIPPED_M:
                self.lies.append(f"at the end: it moved by {1e3 * slipped:.1f} mm in the hand")
        if self._put is not None:
            away = float(np.linalg.norm(self._place - self._put))
            if away > AWAY_M:
                self.lies.append(f"at the end: it lies {1e3 * away:.1f} mm from where it was put")

    @property
    def _place(self) -> Vector:
        return self.world.object_pose(THING).position

    def _held_at(self, arm: str) -> Pose:
        return self.world.arms[arm].tool_pose.inverse @ self.world.object_pose(THING)

    def _approach_and_attach(self, change: StatusChange) -> Iterator[str]:
        if self.world.attachments.find(change.arm, THING) is None:
            yield "it is not held"
        gap = self.world.tool_gap(change.arm, THING)
        if gap > AWAY_M:
            yield f"it is {1e3 * gap:.1f} mm from the tool"
        self._in_hand[change.arm] = self._held_at(change.arm)

    def _grasp(self, change: StatusChange) -> Iterator[str]:
        if self.world.attachments.find(change.arm, THING) is None:
            yield "it is not held"
        self._in_hand[change.arm] = self._held_at(change.arm)

    def _transport(self, change: StatusChange) -> Iterator[str]:
        if change.arm not in self._holders:
            yield "it is not held"
        goal = self.goals[change.path.rpartition("/")[2]]
        away = float(np.linalg.norm(self._place - goal))
        if away > AWAY_M:
            yield f"it is {1e3 * away:.1f} mm from its goal"

    def _detach(self, change: StatusChange) -> Iterator[str]:
        if self.world.attachments.find(change.arm, THING) is not None:
            yield "it is still held"
        self._in_hand.pop(change.arm, None)
        self._put = self._place.copy()

    def _track(self, change: StatusChange) -> Iterator[str]:
        rms = float(change.metrics["yz_rms_m"])
        if not rms <= FOLLOWED_M:
            yield f"it was followed to {1e3 * rms:.1f} mm RMS"
        world = self.world
        body = self.world.arms[change.arm]
        camera = camera_pose(world.data, body.camera_id)
        x, y, z = camera.inverse.apply(self._place).tolist()
        half = math.tan(math.radians(float(world.model.cam_fovy[body.camera_id])) / 2)
        width, height = world.declared_arms[change.arm].camera.resolution  # type: ignore[union-attr]  # it looked
        if not (z > 0 and abs(y) < half * z and abs(x) < half * z * width / height):
            yield "it is not in the image"


@dataclass(frozen=True)
class Played:
    """One run: whether it said SUCCESS, why not, and what of it was false."""

    seed: int
    succeeded: bool
    reason: str
    lies: tuple[str, ...]


def play(file: TreeFile, skills: Registry, reality: RealityName, seed: int) -> Played:
    """Run a tree once and look on."""
    nodes = [node for arm in file.arms.values() for node in arm.tree.walk()]
    goals = {
        node.name: np.array(node.ports["to"]["xyz"], dtype=float)
        for node in nodes
        if node.kind == "transport"
    }
    with Run(file, skills, RunOptions(seed=seed, renderer="ray", reality=reality)) as run:
        judge = Judge(run.world, goals)
        run.watch(judge)
        result = run.finish()
        if result.outcome == "SUCCESS":
            judge.at_the_end()
    reasons = [
        f"{name}: {leaf.skill}: {leaf.code}: {leaf.reason}"
        for name, arm in result.arms.items()
        for leaf in arm.runs
        if leaf.status == "FAILURE"
    ]
    said = result.outcome == "SUCCESS"
    reason = "" if said else "; ".join(reasons) or f"{result.ending} {result.error}"
    return Played(seed, said, reason, tuple(judge.lies))


@cache
def _file(tree: str) -> TreeFile:
    return load_tree_file(find_tree(tree), registry().kinds)


def judged(tree: str, reality: RealityName, seed: int) -> dict[str, Any]:
    """Whether a run said SUCCESS, why not, and what of it was false."""
    one = play(_file(tree), registry(), reality, seed)
    outcome = "FALSE_SUCCESS" if one.lies else "SUCCESS" if one.succeeded else "FAILURE"
    return {"outcome": outcome, **asdict(one)}


def main() -> int:
    """Print what fails as it comes, and a line for each tree and reality."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--trees", nargs="+", default=TREES, choices=TREES)
    parser.add_argument("--sets", nargs="+", default=["lab", "rough"], choices=REALITY_NAMES)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    add_options(parser)
    arguments = parser.parse_args()
    missed = False
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    with Campaign(arguments) as campaign:
        for tree, reality in itertools.product(arguments.trees, arguments.sets):
            succeeded = false = 0
            cases = [{"tree": tree, "reality": reality, "seed": seed} for seed in seeds]
            for case, one in campaign.run(judged, cases):
                succeeded = succeeded + one["succeeded"]
                false = false + bool(one["lies"])
                for line in (*one["lies"], *((one["reason"],) if one["reason"] else ())):
                    print(f"    {tree} {reality} seed {case['seed']}: {line}", flush=True)
            good = succeeded >= ASKED[reality] * arguments.seeds and not false
            missed |= not good
            text = f"{succeeded} of {arguments.seeds} succeeded, {false} with a false SUCCESS"
            print(f"{tree:18} {reality:6} {text}  {'ok' if good else 'MISSED'}", flush=True)
        return missed


if __name__ == "__main__":
    sys.exit(main())
