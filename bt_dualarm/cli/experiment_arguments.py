"""The arguments of ``bt-experiments``, and which experiments they ask for."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final, get_args

from bt_dualarm.errors import DualArmError
from bt_dualarm.experiments.cases import (
    CASES,
    JERK,
    UNTUNED,
    Cell,
    ControllerName,
    CurveName,
    RendererName,
)
from bt_dualarm.spec.reality import REALITY_NAMES

_EXAMPLES: Final = """\
examples:
  bt-experiments                                    all of them into out/experiments: a quarter
                                                    of an hour on two cores
  bt-experiments --seeds 10 --fps 30 --out out/slow
  bt-experiments --untuned --controller predictive  five curves that nothing was tuned on
  bt-experiments --case circle --speed 1.0 --controller predictive --seeds 1 --json cell.json

exit code: 0 every run was measured and the report written, 1 not, 2 the command is wrong,
130 or 143 interrupted: what was complete by then is written
"""


def command_line() -> argparse.ArgumentParser:
    """The parser of ``bt-experiments``."""
    parser = argparse.ArgumentParser(
        prog="bt-experiments",
        description="Run the five tracking experiments, or some of them, and write a report.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--untuned", action="store_true", help="five other curves, which nothing was tuned on")
    add("--case", choices=get_args(CurveName), help="only this curve")
    add("--speed", type=float, metavar="S", help="of the leading arm, 0.05 to 1 (default: all)")
    add("--controller", choices=("proportional", "predictive"), help="only this one")
    add(
        "--renderer",
        choices=("ray", "gl", "both"),
        default="ray",
        help="of the camera: ray casting, OpenGL, or everything with each (default: ray)",
    )
    add(
        "--jobs",
        type=_count,
        metavar="N",
        help="runs side by side, for the same numbers (default: one for each core)",
    )
    add("--seeds", type=_count, default=3, metavar="N", help="repetitions (default: 3)")
    add("--fps", type=_positive, default=60.0, help="of the camera (default: 60)")
    add("--latency", type=float, metavar="S", help="of a frame (default: the time of one frame)")
    add("--drop", type=float, default=0.0, help="share of the frames that get lost, 0 to 0.9")
    add("--noise", type=float, default=0.0, metavar="PX", help="shake of the camera")
    told = "how far both arms are from what is believed of them (default: lab)"
    add("--reality", choices=REALITY_NAMES, default="lab", help=told)
    add(
        "--jerk",
        type=float,
        default=JERK,
        metavar="S",
        help=f"share of the leading arm's limit of jerk, 0.05 to 1 (default: {JERK:g})",
    )
    add("--json", type=_path, metavar="FILE", help="of the numbers; no report unless --out")
    add("--out", type=_path, metavar="DIR", help="of the report (default: out/experiments)")
    return parser


def _count(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 1000:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 1 to 1000")
    return int(text)


def _positive(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return number


def _path(text: str) -> Path:
    if not text.strip():
        raise argparse.ArgumentTypeError("a name is missing; '.' is the current folder")
    return Path(text)


def cells_of(arguments: argparse.Namespace) -> Iterator[Cell]:
    """The experiments that were asked for, in the order of the table.

    Raises:
        DualArmError: None is left, or OpenGL was asked for and does not work here.
    """
    both: tuple[ControllerName, ...] = ("proportional", "predictive")
    settings = {
        "fps": arguments.fps,
        "latency": arguments.latency,
        "drop": arguments.drop,
        "noise": arguments.noise,
        "jerk": arguments.jerk,
        "reality": arguments.reality,
    }
    curves = _curves(arguments)
    for renderer in _renderers(arguments.renderer):
        for cell in curves:
            for controller in (arguments.controller,) if arguments.controller else both:
                yield replace(cell, controller=controller, renderer=renderer, **settings)


def _curves(arguments: argparse.Namespace) -> list[Cell]:
    """Curves and speeds alone.

    Raises:
        DualArmError: None is left.
    """
    cells = UNTUNED if arguments.untuned else tuple(Cell(case, speed) for case, speed in CASES)
    cells = tuple(cell for cell in cells if arguments.case in (None, cell.case))
    if not cells:
        raise DualArmError(f"{arguments.case} is not among these curves: see --untuned")
    if arguments.speed is None:
        return list(cells)
    slower = (replace(cell, speed=arguments.speed) for cell in cells)
    return list({cell.name: cell for cell in slower}.values())


def _renderers(asked: str) -> tuple[RendererName, ...]:
    """The renderer that was asked for, or both.

    Raises:
        RendererError: OpenGL was asked for and does not work here, which is said before the first
            run and not after half of them.
    """
    if asked == "ray":
        return ("ray",)
    from bt_dualarm.world.rendering.choose import choose_renderer

    choose_renderer("gl")
    return ("gl",) if asked == "gl" else ("ray", "gl")
