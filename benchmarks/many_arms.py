"""Two to six arms in a cell: python -m benchmarks.many_arms [FILES [SEED]].

Each file is generated (`benchmarks.crowd`): robots of the catalog with random base poses and
feasible tasks. It is run once for each arm alone and once with all of them. Prints a line for each
file and for each violation:

- an arm that cannot meet any other one ends differently than alone;
- a leaf fails with IN_COLLISION because of another arm although none came within 50 mm;
- arms touch.

Exits with code 1 after a violation.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from dataclasses import asdict, dataclass, field
from typing import Any

from benchmarks.campaign import Campaign, add_options, registry
from benchmarks.crowd import Solo, cannot_meet, crowd
from benchmarks.crowd_members import file_text
from benchmarks.two_arms import Contacts
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.behaviors.report import LeafReport
from bt_dualarm.collision.distance import HORIZON, ArmDistance
from bt_dualarm.runtime.outcome import ArmResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry

FILES = 200
SEED = 0

CLEAR_M = 0.05
"""True distance in meters above which no other arm can be the reason of a failure."""

TICKS_S = 0.05
"""Seconds by which an arm that cannot meet others may end earlier or later than alone."""

_SAMPLE_STEPS = 4  # physics steps between two samples of the distances


class Distances(Contacts):
    """The true distance of each arm from all others over time, and the steps with a contact."""

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self._separations = {name: ArmDistance(world, name) for name in world.arms}
        self._times: list[float] = []
        self._meters: dict[str, list[float]] = {name: [] for name in world.arms}
        self._steps = 0

    def after_step(self, time: float) -> None:
        """Count contacts, and sample the distances every few steps."""
        super().after_step(time)
        self._steps += 1
        if self._steps % _SAMPLE_STEPS:
            return
        self._times.append(time)
        for name, separation in self._separations.items():
            self._meters[name].append(separation.gap({}, HORIZON).meters)

    def nearest(self, arm: str, start: float = 0.0, end: float = float("inf")) -> float:
        """Smallest distance from an arm to any other in a time span, infinite above 0.1 m."""
        times = zip(self._times, self._meters[arm], strict=True)
        return min((meters for time, meters in times if start <= time <= end), default=float("inf"))


@dataclass
class Finding:
    """Result of one file.

    Attributes:
        arms: Number of arms.
        apart: Number of arms that cannot meet any other one.
        outcomes: Number of arms by outcome.
        wrong: Violations as sentences.
        failed: Failures that are not violations, as sentences.
        contacts: Physics steps in which two arms touched.
        nearest: Smallest true distance in m, infinite above 0.1 m.
    """

    arms: int
    apart: int
    outcomes: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    contacts: int = 0
    nearest: float = float("inf")


def judged(seed: int, skills: Registry) -> Finding:
    """Run one generated file and judge it."""
    solos = crowd(seed, skills)
    members = [solo.member for solo in solos]
    with Run(load_tree_file(file_text(members, members), skills.kinds), skills) as run:
        distances = Distances(run.world)
        run.watch(distances)
        result = run.finish()
    free = [solo for solo in solos if _has_room(solo, solos)]
    finding = Finding(len(solos), len(free), contacts=distances.steps)
    if distances.steps:
        finding.wrong.append(f"arms touch at {distances.first_s:.2f} s")
    if result.error:
        finding.wrong.append(result.error)
    for solo, together in zip(solos, result.arms.values(), strict=True):
        finding.outcomes[together.outcome] += 1
        finding.nearest = min(finding.nearest, distances.nearest(together.name))
        if solo in free and not _ends_alike(solo.result, together):
            finding.wrong.append(f"{_label(solo)} ends differently than alone: {_why(together)}")
        elif together.outcome != "SUCCESS":
            finding.failed.append(f"{_label(solo)}: {_why(together)}")
        finding.wrong += [
            f"{_label(solo)} {leaf.started_s:.2f} s: {leaf.reason}"
            for leaf in together.runs
            if _is_unfounded(leaf, distances, together.name)
        ]
    return finding


def _has_room(solo: Solo, solos: list[Solo]) -> bool:
    return all(other is solo or cannot_meet(solo, other) for other in solos)


def _ends_alike(alone: ArmResult, together: ArmResult) -> bool:
    """Whether the same leaves end with the same codes, within a tick or two of the same time."""
    one, other = (
        [(leaf.path, leaf.status, leaf.code) for leaf in run.runs] for run in (alone, together)
    )
    return one == other and abs((alone.ended_s or 0.0) - (together.ended_s or 0.0)) <= TICKS_S


def _is_unfounded(leaf: LeafReport, distances: Distances, arm: str) -> bool:
    """Whether a leaf fails because of an arm that never came near."""
    if leaf.code != "IN_COLLISION":
        return False
    end = leaf.ended_s if leaf.ended_s is not None else float("inf")
    return distances.nearest(arm, leaf.started_s, end) > CLEAR_M


def _why(result: ArmResult) -> str:
    failed = [leaf for leaf in result.runs if leaf.status == "FAILURE"]
    text = [f"{leaf.skill} at {leaf.ended_s} s {leaf.code}: {leaf.reason}" for leaf in failed]
    return "; ".join((str(result.outcome), *text))


def _label(solo: Solo) -> str:
    return f"{solo.member.name} ({solo.member.robot})"


def evaluate(seed: int) -> dict[str, Any]:
    """Result of one file as JSON values."""
    finding = judged(seed, registry())
    outcomes = {str(name): count for name, count in finding.outcomes.items()}
    wrong = bool(finding.wrong)
    return {
        **asdict(finding),
        "outcomes": outcomes,
        "outcome": "FAILURE" if wrong else "SUCCESS",
        "code": "WRONG" if wrong else "",
    }


def main() -> int:
    """Print the results of all files; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("files", type=int, nargs="?", default=FILES)
    parser.add_argument("seed", type=int, nargs="?", default=SEED)
    add_options(parser)
    options = parser.parse_args()
    with Campaign(options) as campaign:
        return run_files(options.files, options.seed, campaign)


def run_files(files: int, seed: int, campaign: Campaign) -> int:
    """Run the files and print the results; returns the exit code."""
    began = time.perf_counter()
    outcomes = Counter[str]()
    wrong = arms = apart = contacts = 0
    nearest = float("inf")
    cases = [{"seed": seed + number} for number in range(files)]
    for case, found in campaign.run(evaluate, cases):
        number = case["seed"] - seed
        arms = arms + found["arms"]
        apart = apart + found["apart"]
        outcomes.update(found["outcomes"])
        wrong = wrong + len(found["wrong"])
        contacts = contacts + found["contacts"]
        nearest = min(nearest, found["nearest"])
        ended = ", ".join(f"{count} {name}" for name, count in found["outcomes"].items())
        print(
            f"[{number + 1}/{files}] seed {seed + number}: {found['arms']} arms, "
            f"{found['apart']} with room: {ended}",
            flush=True,
        )
        for sentence in (*(f"WRONG {one}" for one in found["wrong"]), *found["failed"]):
            print(f"    {sentence}", flush=True)
    print(f"{files} files, {arms} arms in {time.perf_counter() - began:.0f} s wall-clock time")
    for name, count in outcomes.most_common():
        print(f"{name:22} {count:5d}")
    print(f"{'arms that had room':22} {apart:5d}")
    print(f"{'steps with a contact':22} {contacts:5d}")
    print(f"{'nearest':22} {1e3 * nearest:5.0f} mm")
    print(f"{'wrong':22} {wrong:5d}")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
