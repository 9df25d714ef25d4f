"""Every arm of the catalog tracks a cube at rest or on a slow circle: errors and oscillation.

    python -m benchmarks.following [--robot NAME ...] [--fps N ...] [--motion rest|circle]
                                   [--reality ideal|lab|rough] [--sized] [--seeds N] [--part I/N]

A resting cube: all combinations of robots, planes, 10, 30, 60 and 120 Hz, 0.1, 0.3 and 1 of the
limits, and latencies of 0, 17 and 60 ms: 540 runs of about two seconds. A circle of 0.1 m at 0.1
m/s: likewise, with one latency. Arms start with the camera facing the plane; with ``--sized`` they
know the cube's size. A seed is one robot with its own deviations from the model. Prints the error
of each run, the highest peak in the spectrum of the tool's path, and missed goals, among them
losses of the cube; exits with code 1 if a goal is missed. Outside `ideal`, calibration errors of
the camera shift the cube, so only oscillation, losses and failures count. ``--part 2/11`` runs
every eleventh case, starting with the second.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from benchmarks.campaign import Campaign, add_options, registry
from benchmarks.following_trial import LOOKS, Outcome, Spot, follow
from benchmarks.measured_robots import MEASURED
from bt_dualarm.robots.robot_description import robot_names

FPS = (10.0, 30.0, 60.0, 120.0)
SHARES = (0.1, 0.3, 1.0)
LATENCIES = (0.0, 0.017, 0.06)


def spots(options: argparse.Namespace) -> Iterator[Spot]:
    """All cases."""
    latencies = LATENCIES if options.motion == "rest" else (Spot.latency,)
    each = itertools.product(
        options.robot, LOOKS, options.fps, SHARES, latencies, range(options.seeds)
    )
    for robot, plane, fps, share, latency, seed in each:
        more = options.motion, options.reality, options.sized, seed
        yield Spot(robot, plane, fps, share, latency, *more)


def complaints(spot: Spot, found: Outcome) -> list[str]:
    """Missed goals; NOT_FOLLOWING is accepted on the circle, which can be too fast for an arm."""
    if found.code == "NOT_FOLLOWING" and spot.motion == "circle":
        return []
    if found.code:
        return [found.code]
    is_accurate = found.rms <= spot.goal or spot.reality != "ideal"
    missed = [] if is_accurate else [f"RMS above {1e3 * spot.goal:g} mm"]
    missed += [f"lost {found.lost} times"] * (found.lost > 0)
    return missed + ["swings"] * (spot.motion == "rest" and found.swings(spot.goal))


def run_case(**fields: Any) -> dict[str, Any]:  # Any: fields of `Spot`
    """Measurements of a case, and its missed goals."""
    spot = Spot(**fields)
    found = follow(spot, registry())
    wrong = complaints(spot, found)
    return {
        "outcome": "FAILURE" if wrong else "SUCCESS",
        "code": "; ".join(wrong),
        "measured": asdict(found),
    }


def main(arguments: list[str]) -> int:
    """Print a line for each case; returns the exit code."""
    parser = argparse.ArgumentParser(description="every arm tracks a cube")
    parser.add_argument("--robot", nargs="+", default=list(MEASURED), choices=robot_names())
    parser.add_argument("--fps", nargs="+", type=float, default=list(FPS))
    parser.add_argument("--motion", choices=("rest", "circle"), default="rest")
    parser.add_argument("--reality", choices=("ideal", "lab", "rough"), default="ideal")
    parser.add_argument("--sized", action="store_true")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--part", default="1/1")
    add_options(parser)
    options = parser.parse_args(arguments)
    first, every = (int(number) for number in options.part.split("/"))
    failed = 0
    of_group: dict[tuple[str, float], list[Outcome]] = defaultdict(list)
    cases = [asdict(spot) for spot in list(spots(options))[first - 1 :: every]]
    with Campaign(options) as campaign:
        for fields, result in campaign.run(run_case, cases):
            spot = Spot(**fields)
            found = Outcome(**result["measured"])
            of_group[spot.robot, spot.fps].append(found)
            failed += bool(result["code"])
            print(f"{spot}: {found} {result['code']}".rstrip(), flush=True)
        for (robot, fps), all_found in of_group.items():
            rms = max(one.rms for one in all_found)
            peak = max(one.peak for one in all_found)
            print(
                f"{robot}, {fps:g} Hz: {len(all_found)} runs, RMS at most {1e3 * rms:.3f} mm, "
                f"highest peak {1e3 * peak:.3f} mm"
            )
        print(f"{failed} miss their goal")
        return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
