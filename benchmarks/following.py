"""Every arm of the catalog before a cube, in figures: does it come to rest, does it swing?

    python -m benchmarks.following [--robot NAME ...] [--fps N ...] [--motion rest|circle]
                                   [--reality ideal|lab|rough] [--sized] [--seeds N] [--part I/N]

A resting cube: robots by planes by 10, 30, 60, 120 frames a second by shares 0.1, 0.3, 1 of the
limits by latencies of 0, 17 and 60 ms, 540 runs of about two seconds each. A slow circle, 0.1 m
around at 0.1 m/s: robots by planes by rates by shares. Arms start where they look squarely at the
plane; with ``--sized`` they know the cube's size. A seed is a robot of the batch. Printed for each
is the error, the highest line of the spectrum of the tool's path, and what misses its goal, as a
loss of the cube does; the exit code is 1 if anything does. Where the camera is not where its
calibration has it, the cube is off by that, and only swings, losses and failures count.
``--part 2/11`` runs every eleventh, from the second on.
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


def spots(asked: argparse.Namespace) -> Iterator[Spot]:
    """All of the family."""
    latencies = LATENCIES if asked.motion == "rest" else (Spot.latency,)
    each = itertools.product(asked.robot, LOOKS, asked.fps, SHARES, latencies, range(asked.seeds))
    for robot, plane, fps, share, latency, seed in each:
        more = asked.motion, asked.reality, asked.sized, seed
        yield Spot(robot, plane, fps, share, latency, *more)


def complaints(spot: Spot, found: Outcome) -> list[str]:
    """What misses its goal; an arm that has too little speed for the circle may say so."""
    if found.code == "NOT_FOLLOWING" and spot.motion == "circle":
        return []
    if found.code:
        return [found.code]
    right = found.rms <= spot.goal or spot.reality != "ideal"
    said = [] if right else [f"RMS above {1e3 * spot.goal:g} mm"]
    said += [f"lost {found.lost} times"] * (found.lost > 0)
    return said + ["swings"] * (spot.motion == "rest" and found.swings(spot.goal))


def tried(**fields: Any) -> dict[str, Any]:  # Any: fields of `Spot`
    """What was measured at a spot, and what misses its goal."""
    spot = Spot(**fields)
    found = follow(spot, registry())
    wrong = complaints(spot, found)
    return {
        "outcome": "FAILURE" if wrong else "SUCCESS",
        "code": "; ".join(wrong),
        "measured": asdict(found),
    }


def main(arguments: list[str]) -> int:
    """Print a line for each; the exit code."""
    parser = argparse.ArgumentParser(description="every arm before a cube")
    parser.add_argument("--robot", nargs="+", default=list(MEASURED), choices=robot_names())
    parser.add_argument("--fps", nargs="+", type=float, default=list(FPS))
    parser.add_argument("--motion", choices=("rest", "circle"), default="rest")
    parser.add_argument("--reality", choices=("ideal", "lab", "rough"), default="ideal")
    parser.add_argument("--sized", action="store_true")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--part", default="1/1")
    add_options(parser)
    asked = parser.parse_args(arguments)
    first, every = (int(number) for number in asked.part.split("/"))
    failed = 0
    of_group: dict[tuple[str, float], list[Outcome]] = defaultdict(list)
    cases = [asdict(spot) for spot in list(spots(asked))[first - 1 :: every]]
    with Campaign(asked) as campaign:
        for fields, result in campaign.run(tried, cases):
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
