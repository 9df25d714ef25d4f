"""Whole tasks with many robots: success rate, and whether a SUCCESS is ever false.

    python -m benchmarks.false_success [--trees pick_and_track] [--sets lab rough] [--seeds 100]
                                       [--first 0]

A seed is one robot with its own deviations from the model. Each SUCCESS is compared with the
simulator's state at that time: an attached object is held and near the tool, a transported one is
at its goal and still held, a released one is no longer held, a tracked one is in the camera's image
and was tracked within 5 mm RMS. At the end a held object has not moved in the hand, and a detached
one has not moved since. Goals: all seeds succeed in `lab`, 98 of 100 in `rough`, no false SUCCESS;
exits with code 1 if one is missed.
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
OBJECT = "cube"
AWAY_M = 0.005
"""Largest true distance of the object from its goal, and from the tip of a tool that holds it."""
SLIPPED_M = 0.002
FOLLOWED_M = 0.005
GOAL_SHARE = {"ideal": 1.0, "lab": 1.0, "rough": 0.98}


@dataclass
class Judge(IdleObserver):
    """Compares each SUCCESS of a leaf with the true state.

    Attributes:
        world: World of the run.
        goals: Goal position of each transport, by the name of its node, m.
        deviations: Deviations of the true state from a SUCCESS, as sentences.
    """

    world: World
    goals: dict[str, Vector]
    deviations: list[str] = field(default_factory=list)
    _in_hand: dict[str, Pose] = field(default_factory=dict)
    _holders: frozenset[str] = frozenset()
    _detached_at: Vector | None = None

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the world has its own clock
        """Record the holders: a tick may end one leaf and run the next one, which releases."""
        self._holders = frozenset(one.arm for one in self.world.attachments)

    def on_event(self, change: StatusChange) -> None:
        """Compare a SUCCESS with the true state."""
        if change.new != "SUCCESS":
            return
        check = getattr(self, f"_{change.kind}", None)
        for deviation in check(change) if check else ():
            self.deviations.append(f"{change.time:.2f} s: {change.arm}/{change.path}: {deviation}")

    def at_the_end(self) -> None:
        """Check that a held object has not moved in the hand, and a detached one has stayed."""
        for arm, before in self._in_hand.items():
            slipped = before.distance(self._held_at(arm))
            if slipped > SLIPPED_M:
                self.deviations.append(
                    f"at the end: it moved by {1e3 * slipped:.1f} mm in the hand"
                )
        if self._detached_at is not None:
            away = float(np.linalg.norm(self._position - self._detached_at))
            if away > AWAY_M:
                self.deviations.append(
                    f"at the end: it is {1e3 * away:.1f} mm from its release pose"
                )

    @property
    def _position(self) -> Vector:
        return self.world.object_pose(OBJECT).position

    def _held_at(self, arm: str) -> Pose:
        return self.world.arms[arm].tool_pose.inverse @ self.world.object_pose(OBJECT)

    def _approach_and_attach(self, change: StatusChange) -> Iterator[str]:
        if self.world.attachments.find(change.arm, OBJECT) is None:
            yield "it is not held"
        gap = self.world.tool_gap(change.arm, OBJECT)
        if gap > AWAY_M:
            yield f"it is {1e3 * gap:.1f} mm from the tool"
        self._in_hand[change.arm] = self._held_at(change.arm)

    def _grasp(self, change: StatusChange) -> Iterator[str]:
        if self.world.attachments.find(change.arm, OBJECT) is None:
            yield "it is not held"
        self._in_hand[change.arm] = self._held_at(change.arm)

    def _transport(self, change: StatusChange) -> Iterator[str]:
        if change.arm not in self._holders:
            yield "it is not held"
        goal = self.goals[change.path.rpartition("/")[2]]
        away = float(np.linalg.norm(self._position - goal))
        if away > AWAY_M:
            yield f"it is {1e3 * away:.1f} mm from its goal"

    def _detach(self, change: StatusChange) -> Iterator[str]:
        if self.world.attachments.find(change.arm, OBJECT) is not None:
            yield "it is still held"
        self._in_hand.pop(change.arm, None)
        self._detached_at = self._position.copy()

    def _track(self, change: StatusChange) -> Iterator[str]:
        rms = float(change.metrics["yz_rms_m"])
        if not rms <= FOLLOWED_M:
            yield f"it was followed to {1e3 * rms:.1f} mm RMS"
        world = self.world
        body = self.world.arms[change.arm]
        camera = camera_pose(world.data, body.camera_id)
        x, y, z = camera.inverse.apply(self._position).tolist()
        half = math.tan(math.radians(float(world.model.cam_fovy[body.camera_id])) / 2)
        width, height = world.declared_arms[change.arm].camera.resolution  # type: ignore[union-attr]  # has one
        if not (z > 0 and abs(y) < half * z and abs(x) < half * z * width / height):
            yield "it is not in the image"


@dataclass(frozen=True)
class PlayedRun:
    """One run: whether it succeeded, why not, and the deviations from a SUCCESS."""

    seed: int
    succeeded: bool
    reason: str
    deviations: tuple[str, ...]


def play(file: TreeFile, skills: Registry, reality: RealityName, seed: int) -> PlayedRun:
    """Run a tree once with a judge."""
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
    succeeded = result.outcome == "SUCCESS"
    reason = "" if succeeded else "; ".join(reasons) or f"{result.ending} {result.error}"
    return PlayedRun(seed, succeeded, reason, tuple(judge.deviations))


@cache
def _file(tree: str) -> TreeFile:
    return load_tree_file(find_tree(tree), registry().kinds)


def evaluate(tree: str, reality: RealityName, seed: int) -> dict[str, Any]:
    """Whether a run succeeded, why not, and the deviations from a SUCCESS."""
    one = play(_file(tree), registry(), reality, seed)
    outcome = "FALSE_SUCCESS" if one.deviations else "SUCCESS" if one.succeeded else "FAILURE"
    return {"outcome": outcome, **asdict(one)}


def main() -> int:
    """Print failures as they occur, and a line for each tree and reality."""
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
            for case, one in campaign.run(evaluate, cases):
                succeeded = succeeded + one["succeeded"]
                false = false + bool(one["deviations"])
                for line in (*one["deviations"], *((one["reason"],) if one["reason"] else ())):
                    print(f"    {tree} {reality} seed {case['seed']}: {line}", flush=True)
            good = succeeded >= GOAL_SHARE[reality] * arguments.seeds and not false
            missed |= not good
            text = f"{succeeded} of {arguments.seeds} succeeded, {false} with a false SUCCESS"
            print(f"{tree:18} {reality:6} {text}  {'ok' if good else 'MISSED'}", flush=True)
        return missed


if __name__ == "__main__":
    sys.exit(main())
