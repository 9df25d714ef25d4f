"""Whether ``until_still`` waits for a motion: targets that never move, and targets that do.

Usage: python -m benchmarks.until_still [RUNS] [SEED]

A Panda tracks a cube that is not in the middle of its image and nearer or farther than assumed,
with cameras of several frame rates, latencies and noise, and with and without the cube's size. In
half of the runs the cube never moves, and `track` must not end within 12 s. In the others it moves
by 15 mm in a random direction, and `track` must end once it rests.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

import bt_dualarm as bt
from benchmarks.campaign import Campaign, add_options
from bt_dualarm.runtime.outcome import Outcome

CENTER = np.array((0.68, 0.11, 0.70))  # middle of the image, 0.35 m in front of the camera
MOVED_M = 0.015
FAILED = "it failed"
MOVES_S = 4.0
LASTS_S = 0.3
GIVEN_S = 12.0


@dataclass(frozen=True)
class Case:
    """One run.

    Attributes:
        place: Position of the cube at the start, of shape (3,), m.
        way: Displacement of the cube, of shape (3,), m.
        camera: Properties of the camera, as in a tree file.
        known: Whether the cube's size is known.
        seed: Seed of the run.
    """

    place: np.ndarray[Any, np.dtype[np.float64]]
    way: np.ndarray[Any, np.dtype[np.float64]]
    camera: dict[str, Any]
    known: bool
    seed: int

    @property
    def moves(self) -> bool:
        """Whether the cube moves."""
        return bool(self.way.any())


def draw(rng: np.random.Generator, *, moves: bool) -> Case:
    """A random case."""
    place = CENTER + rng.uniform((-0.15, -0.07, -0.07), (0.12, 0.07, 0.07))
    angle = rng.uniform(0.0, 2.0 * np.pi)
    way = MOVED_M * np.array((0.0, np.cos(angle), np.sin(angle))) if moves else np.zeros(3)
    camera = {
        "mount": "wrist",
        "resolution": [320, 240],
        "fov": 50,
        "fps": int(rng.choice((15, 30, 60))),
        "latency": float(rng.choice((0.0, 0.02, 0.06))),
        "noise": float(rng.choice((0.0, 0.5, 1.0))),
    }
    return Case(place, way, camera, bool(rng.integers(2)), int(rng.integers(1, 1000)))


def tree(case: Case) -> dict[str, Any]:
    """The tree file of a case."""
    track: dict[str, Any] = {"until_still": 1.0}
    if case.known:
        track["target_size"] = 0.05
    return {
        "bt_dualarm": 1,
        "name": "until_still",
        "world": {"scene": "empty"},
        "objects": {
            "cube": {
                "shape": "box",
                "size": [0.05, 0.05, 0.05],
                "mass": 0.1,
                "color": "yellow",
                "fixed": True,
                "pose": {"xyz": case.place.tolist()},
            }
        },
        "arms": {
            "arm1": {
                "robot": "panda",
                "base": {"xyz": [1.60, 0.11, 0.28], "rpy": [0, 0, 180]},
                "posture": "look_out",
                "camera": case.camera,
                "tree": {"track": track},
            }
        },
    }


def ends_well(case: Case) -> str:
    """Failure of the run of a case, or an empty text."""
    with bt.open(tree(case), seed=case.seed, renderer="ray") as run:
        while not run.done and run.time < GIVEN_S:
            share = min(max((run.time - MOVES_S) / LASTS_S, 0.0), 1.0)
            place = case.place + share * case.way
            run.assembly.world.model.body_pos[run.assembly.world.object_body("cube")] = place
            run.step(0.02)
        if not run.done:
            return "it did not end" if case.moves else ""
        if run.result.outcome is not Outcome.SUCCESS:
            return f"{FAILED}: {run.result.arms['arm1'].leaves['track'].reason}"
        early = not case.moves or run.time < MOVES_S + 1.0
        return f"it ended at {run.time:.1f} s" if early else ""


def evaluate(**fields: Any) -> dict[str, Any]:  # Any: fields of `Case`
    """Failure of the run of a case as JSON values."""
    failure = ends_well(_case_of(fields))
    code = "" if not failure else "FAILED" if failure.startswith(FAILED) else "WRONG"
    return {"outcome": "FAILURE" if failure else "SUCCESS", "code": code, "message": failure}


def _case_of(fields: Mapping[str, Any]) -> Case:
    vectors = {name: np.array(fields[name], dtype=float) for name in ("place", "way")}
    return Case(**{**fields, **vectors})


def main() -> None:
    """Print the failures, and the counts of each half."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("runs", type=int, nargs="?", default=40)
    parser.add_argument("seed", type=int, nargs="?", default=0)
    add_options(parser)
    options = parser.parse_args()
    runs = options.runs
    rng = np.random.default_rng(options.seed)
    cases = [asdict(draw(rng, moves=bool(number % 2))) for number in range(runs)]
    wrong = {False: 0, True: 0}
    failed = {False: 0, True: 0}
    with Campaign(options) as campaign:
        for fields, found in campaign.run(evaluate, cases):
            if failure := found["message"]:
                case = _case_of(fields)
                counts = failed if failure.startswith(FAILED) else wrong
                counts[case.moves] += 1
                print(f"{'moves' if case.moves else 'rests'}: {failure}; {case}", flush=True)
        print(f"never moved: {wrong[False]} of {runs - runs // 2} ended, {failed[False]} failed")
        ended = runs // 2 - wrong[True] - failed[True]
        print(f"moved by 15 mm: {ended} of {runs // 2} ended once it rested, {failed[True]} failed")


if __name__ == "__main__":
    main()
