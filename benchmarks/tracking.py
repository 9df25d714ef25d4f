"""Visual tracking: error, bound, camera faults, occlusion, a second target, CPU time.

    python -m benchmarks.tracking [--quick] [--seeds 10] [--figure N ...] [--reality lab] [--jobs 2]
                                  [--out DIR]

Prints every figure with its goal, and exits with code 1 if one is missed. 60 Hz, 320x240, one frame
of latency, gains and filter as shipped; figures 1 to 4 in ``--reality``, the others in ``lab``.
``--quick`` uses one seed and fewer cases.

    1  the five experiments, and five curves on which nothing was tuned, at 60 Hz
    2  the same at 30 Hz; predictive versus proportional control
    3  measured error relative to the bound of the estimator at its measured noise
    4  a map over latency, lost frames and shake of the camera (``tracking_map.png``)
    5  a screen in front of the target for 0.05 to 2 s
    6  a second target of the same color that crosses the view; other colors
    7  CPU time of each part
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.camera_map import draw, survey, table
from benchmarks.disturbances import (
    COVERED_FROM_S,
    TWIN_X_M,
    ages_of_data,
    came_back,
    covered,
    crossed,
    was_stolen,
)
from benchmarks.tracking_bench import Bench
from bt_dualarm.control.planar_servo import PlanarServo
from bt_dualarm.experiments.trials import CASES, UNTUNED, Cell, TrialError, run_trial
from bt_dualarm.sim.camera import Camera
from bt_dualarm.spec.document import REALITY_NAMES, RealityName

GOALS: Final[Mapping[RealityName, Mapping[float, tuple[float, float]]]] = {
    "ideal": {60.0: (1.0, 3.0), 30.0: (2.5, 7.0)},
    "lab": {60.0: (1.0, 3.0), 30.0: (2.5, 7.0)},
    "rough": {60.0: (2.0, 6.0), 30.0: (4.0, 12.0)},
}
"""Goals for RMS and largest error in mm, by frame rate in Hz."""


def experiments(fps: float) -> Iterator[Cell]:
    """The five on which the filter was tuned, then the others."""
    for cell in (*(Cell(case, speed) for case, speed in CASES), *UNTUNED):
        yield replace(cell, fps=fps)


def errors(bench: Bench, fps: float) -> None:
    """Print the errors and losses of figures 1 and 2."""
    rms, worst = GOALS[bench.reality][fps]
    cells = list(experiments(fps))
    for cell, result in zip(cells, bench.results(cells), strict=True):
        lost = sum(trial.lost_count for trial in result.trials)
        bench.report(f"{cell.name}: RMS", 1e3 * result.rms, rms)
        bench.report(f"{cell.name}: max", 1e3 * result.worst, worst)
        bench.report(f"{cell.name}: losses", lost, 0, "")


def figure_1(bench: Bench) -> None:
    """Errors at 60 Hz."""
    errors(bench, 60.0)


def figure_2(bench: Bench) -> None:
    """Errors at 30 Hz, and relative to proportional control."""
    errors(bench, 30.0)
    for case, speed in CASES:
        for fps in (60.0, 30.0) if speed == 1.0 else ():
            cell = Cell(case, speed, fps=fps)
            plain = bench.result(replace(cell, controller="proportional"))
            ratio = bench.result(cell).rms / plain.rms
            print(f"  {cell.name}, {fps:g} Hz: proportional {1e3 * plain.rms:.2f} mm RMS")
            bench.report(f"{cell.name}, {fps:g} Hz: predictive ÷ proportional", ratio, 1 / 12, "")


def figure_3(bench: Bench) -> None:
    """Errors relative to the bound of the estimator."""
    cells = list(experiments(60.0))
    for cell, result in zip(cells, bench.results(cells), strict=True):
        bound = result.bound
        noise = 1e3 * result.mean("sighting_sd")
        print(f"  {cell.name}: noise {noise:.3f} mm, bound {1e3 * bound:.2f} mm")
        bench.report(f"{cell.name}: RMS ÷ bound", result.rms / bound, 1.5, "")


def figure_4(bench: Bench) -> None:
    """Map over camera faults, and its unstable points."""
    spots = survey(bench.trials, coarse=bench.quick)
    print(table(spots))
    for spot in spots:
        for complaint in spot.complaints:
            print(f"  {spot.faults}: {complaint}")
    draw(spots, bench.seeds, bench.out / "tracking_map.png")
    unstable = sum(bool(spot.complaints) for spot in spots)
    bench.report(f"of {len(spots)} points of the map that are not stable", unstable, 0, "")


def figure_5(bench: Bench) -> None:
    """Occlusion: the target is regained, and old data causes no motion."""
    rng = np.random.default_rng(0)
    times = 3 if bench.quick else 20
    old = 0
    with ages_of_data() as ages:
        for length in (0.05, 0.1, 0.5, 2.0):
            regained = 0
            for seed in range(times):
                begin = float(rng.uniform(*COVERED_FROM_S))
                try:
                    trial = covered(bench.registry, seed, begin, length)
                except TrialError as error:
                    print(f"  covered from {begin:.2f} s for {length} s: {error}")
                    continue
                is_regained = came_back(trial, begin, length)
                if not is_regained:
                    print(
                        f"  covered from {begin:.2f} s for {length} s: {trial.reason or 'astray'}"
                    )
                regained += is_regained
                old += trial.old_data_steps
            bench.report(
                f"covered for {length} s: not regained of {times}", times - regained, 0, ""
            )
    print(f"  {ages.asked} set-points by prediction")
    bench.report("oldest data that a set-point was made of", 1e3 * ages.oldest, 100, "ms")
    bench.report("control steps that moved toward older data", old, 0, "")


def figure_6(bench: Bench) -> None:
    """A second target that crosses; cubes of other colors."""
    times = 4 if bench.quick else 20
    rng = np.random.default_rng(1)
    thefts = 0
    for seed in range(times):
        height = float(rng.uniform(-0.05, 0.05))
        depth = TWIN_X_M[seed % 2]
        trial = crossed(bench.registry, seed, height, depth)
        stolen = trial.outcome != "SUCCESS" or was_stolen(trial, height)
        if stolen or trial.error.max() > 0.01:
            worst = 1e3 * trial.error.max()
            print(f"  crossing {seed}: {worst:.1f} mm, lost {trial.lost_count} times, {stolen=}")
        thefts += stolen
    bench.report(f"thefts by a twin that crosses {times} times", thefts, 0, "")
    colors = ("yellow", "red", "green", "blue", "orange")
    results = list(bench.results([Cell("circle", 1.0, more={"color": color}) for color in colors]))
    for color, result in zip(colors[1:], results[1:], strict=True):
        ratio = result.rms / results[0].rms
        bench.report(f"{color}: RMS by that of yellow", ratio, 1.2, "")


def figure_7(bench: Bench) -> None:
    """CPU time of each part relative to simulated time."""
    spent: dict[str, float] = {}
    parts: Mapping[str, tuple[type, str]] = {
        "camera": (Camera, "capture"),
        "detection and estimation": (Camera, "deliver"),
        "following": (PlanarServo, "__call__"),
    }
    plain = {name: getattr(kind, method) for name, (kind, method) in parts.items()}
    for name, (kind, method) in parts.items():
        setattr(kind, method, _timed(plain[name], name, spent))
    try:
        trial = run_trial(Cell("circle", 1.0), 0, bench.registry)
    finally:
        for name, (kind, method) in parts.items():
            setattr(kind, method, plain[name])
    simulated = trial.frames / 60.0
    for name, seconds in spent.items():
        print(f"  {name:<58} {100 * seconds / simulated:9.2f} %")
    bench.report(
        "all together, of a core at real time", 100 * sum(spent.values()) / simulated, 40, "%"
    )


def _timed(function: Callable[..., Any], name: str, spent: dict[str, float]) -> Callable[..., Any]:
    def timed(*arguments: Any) -> Any:
        began = time.process_time()
        try:
            return function(*arguments)
        finally:
            spent[name] = spent.get(name, 0.0) + time.process_time() - began

    return timed


FIGURES = (figure_1, figure_2, figure_3, figure_4, figure_5, figure_6, figure_7)


def main() -> int:
    """Print the requested figures; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--figure", type=int, action="append", choices=range(1, 8))
    parser.add_argument("--reality", choices=REALITY_NAMES, default="lab")
    parser.add_argument("--out", type=Path, default=Path("out"))
    parser.add_argument("--jobs", type=int, default=1, help="parallel processes")
    arguments = parser.parse_args()
    seeds = 1 if arguments.quick else arguments.seeds
    bench = Bench(seeds, arguments.quick, arguments.out, arguments.jobs, arguments.reality)
    for number, figure in enumerate(FIGURES, start=1):
        if arguments.figure is None or number in arguments.figure:
            print(f"{number}  {figure.__doc__}", flush=True)
            figure(bench)
    print(f"goals missed: {', '.join(bench.missed) or 'none'}")
    return 1 if bench.missed else 0


if __name__ == "__main__":
    sys.exit(main())
