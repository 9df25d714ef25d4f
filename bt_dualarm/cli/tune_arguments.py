"""The arguments of ``bt-tune-color``: what may be given, and what is refused at once."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from bt_dualarm.cli.run_arguments import seed
from bt_dualarm.cli.words import add_params, add_skills

if TYPE_CHECKING:
    from bt_dualarm.spec.color import Color

_Add: TypeAlias = Callable[..., argparse.Action]

_EPILOG = """\
examples:
  bt-tune-color pick_and_track --at 7 --out seen.png    what the tracking camera sees after 7 s
  bt-tune-color my_tree.yaml --serve                    what it sees at the start, as a live page
  bt-tune-color my_tree.yaml --pick 160,120 --write     look for the colour of a pixel from now on
  bt-tune-color photo.jpg --hue 45 65 --saturation 0.5 1 --snippet color.yaml

exit code:
  0 something of the colour was found, or the page was closed   1 nothing was found
  2 the file or the command is wrong
"""


def command_line() -> argparse.ArgumentParser:
    """The parser of ``bt-tune-color``; building it imports nothing heavy."""
    parser = argparse.ArgumentParser(
        prog="bt-tune-color",
        description="Show what a camera takes for its target in one picture, and choose the colour "
        "that it looks for.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("file", metavar="FILE", help="a tree file, a shipped one, or an image")
    _add_picture(parser.add_argument_group("which picture of a tree file").add_argument)
    color = parser.add_argument_group("which colour (default: the file's, else yellow)")
    _add_color(color.add_argument)
    _add_output(parser.add_argument_group("what becomes of it"))
    add_skills(parser)
    add_params(parser)
    return parser


def _add_picture(add: _Add) -> None:
    add("--arm", metavar="NAME", help="whose camera (default: the only one)")
    add("--at", metavar="S", type=_moment, default=0.0, help="run so many simulated seconds first")
    add("--posture", metavar="NAME", help="of the camera's arm at the start (default: the file's)")
    add("--seed", metavar="N", type=seed, help="of everything random (default: the file's)")
    add("--renderer", choices=("auto", "gl", "ray"), help="default: the file's")


def _add_color(add: _Add) -> None:
    ends = ("FROM", "TO")
    add("--color", metavar="COLOR", type=_color, help="a name, or ranges as a tree file has them")
    add(
        "--pick",
        metavar="X,Y",
        type=_pixel,
        nargs="+",
        default=[],
        help="the colour of these pixels",
    )
    add(
        "--widen",
        metavar="X,Y",
        type=_pixel,
        nargs="+",
        default=[],
        help="the first range and these pixels",
    )
    add("--hue", metavar=ends, type=_degrees, nargs=2, help="degrees; 340 12 goes through red")
    add("--saturation", metavar=ends, type=_share, nargs=2, help="0 is grey, 1 is pure")
    add("--value", metavar=ends, type=_share, nargs=2, help="0 is black, 1 is bright")


def _add_output(group: argparse._ArgumentGroup) -> None:
    add, save = group.add_argument, group.add_mutually_exclusive_group().add_argument
    add("--out", metavar="PNG", type=Path, help="image, mask and candidates side by side")
    add("--json", action="store_true", help="print the result for programs")
    add(
        "--serve",
        metavar="PORT",
        type=_port,
        nargs="?",
        const=0,
        help="a page on this machine to tune by hand, on any free port or on this one",
    )
    save("--write", action="store_true", help="write the colour into the tree file")
    add("--line", metavar="N", type=int, help="of the leaf, where several look for a colour")
    save("--snippet", metavar="YAML", type=Path, help="write the colour into a file of its own")


def _color(text: str) -> Color:
    from bt_dualarm.spec.problems import SpecError
    from bt_dualarm.spec.reader import read_text
    from bt_dualarm.tuning.wanted import ColorError, color_of

    try:
        return color_of(read_text(text).data)
    except SpecError as error:
        raise argparse.ArgumentTypeError(error.problems[0].message) from None
    except ColorError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _pixel(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"([0-9]{1,5}),([0-9]{1,5})", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} is not a pixel X,Y such as 160,120")
    return int(match[1]), int(match[2])


def _number(text: str, most: float, what: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not 0.0 <= number <= most:
        raise argparse.ArgumentTypeError(f"{text!r} is not {what}")
    return number


def _degrees(text: str) -> float:
    return _number(text, 360.0, "a hue from 0 to 360 degrees")


def _share(text: str) -> float:
    return _number(text, 1.0, "a number from 0 to 1")


def _moment(text: str) -> float:
    return _number(text, 86400.0, "a number of seconds from 0 to 86400")


def _port(text: str) -> int:
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is not a port from 0 to 65535")
    return int(text)
