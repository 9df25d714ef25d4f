"""``bt-tune-color``: shows what a camera detects as its target, and tunes the color."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from bt_dualarm.cli.entry import (
    FAILED,
    SUCCEEDED,
    add_params,
    add_skills,
    given_path,
    imported_skills,
    seed,
)
from bt_dualarm.core.errors import DualArmError

if TYPE_CHECKING:
    from bt_dualarm.spec.values import Color
    from bt_dualarm.tuning import ColorView, Save, Shot


# Arguments, and their validation.


_Add: TypeAlias = Callable[..., argparse.Action]

_EPILOG = """\
examples:
  bt-tune-color pick_and_track --at 7 --out seen.png    what the tracking camera sees after 7 s
  bt-tune-color my_tree.yaml --serve                    an interactive page of the first image
  bt-tune-color my_tree.yaml --pick 160,120 --write     write the color of a pixel into the file
  bt-tune-color photo.jpg --hue 45 65 --saturation 0.5 1 --snippet color.yaml

exit code:
  0 the color was found, or the page was closed   1 nothing was found
  2 invalid file or command line
"""


def command_line() -> argparse.ArgumentParser:
    """The parser of ``bt-tune-color``; building it needs no slow import."""
    parser = argparse.ArgumentParser(
        prog="bt-tune-color",
        description="Show what a camera detects as its target in one image, and tune the color "
        "that it looks for.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "file", metavar="FILE", help="a tree file, the name of a shipped tree, or an image"
    )
    _add_picture(parser.add_argument_group("choice of the image from a tree file").add_argument)
    color = parser.add_argument_group("color (default: the file's, otherwise yellow)")
    _add_color(color.add_argument)
    _add_output(parser.add_argument_group("output"))
    add_skills(parser)
    add_params(parser)
    return parser


def _add_picture(add: _Add) -> None:
    add("--arm", metavar="NAME", help="arm with the camera (default: the only one)")
    add("--at", metavar="S", type=_moment, default=0.0, help="simulated time of the image")
    add(
        "--posture",
        metavar="NAME",
        help="initial posture of the camera's arm (default: the file's)",
    )
    add("--seed", metavar="N", type=seed, help="random seed (default: the file's)")
    add("--renderer", choices=("auto", "gl", "ray"), help="camera renderer (default: the file's)")


def _add_color(add: _Add) -> None:
    ends = ("FROM", "TO")
    add("--color", metavar="COLOR", type=_color, help="a name, or ranges as in a tree file")
    add(
        "--pick",
        metavar="X,Y",
        type=_pixel,
        nargs="+",
        default=[],
        help="fit the range to these pixels",
    )
    add(
        "--widen",
        metavar="X,Y",
        type=_pixel,
        nargs="+",
        default=[],
        help="widen the first range to include these pixels",
    )
    add("--hue", metavar=ends, type=_degrees, nargs=2, help="degrees; 340 12 wraps through red")
    add("--saturation", metavar=ends, type=_share, nargs=2, help="0 is gray, 1 is pure")
    add("--value", metavar=ends, type=_share, nargs=2, help="0 is black, 1 is bright")


def _add_output(group: argparse._ArgumentGroup) -> None:
    add = group.add_argument
    save = group.add_mutually_exclusive_group().add_argument
    add(
        "--out",
        metavar="PNG",
        type=given_path,
        help="write image, mask and candidates side by side",
    )
    add("--json", action="store_true", help="print the result as JSON")
    add(
        "--serve",
        metavar="PORT",
        type=_port,
        nargs="?",
        const=0,
        help="serve a page for tuning by hand, on this port or any free one",
    )
    save("--write", action="store_true", help="write the color into the tree file")
    add("--line", metavar="N", type=int, help="line of the leaf, if several look for a color")
    save("--snippet", metavar="YAML", type=given_path, help="write the color into a separate file")


def _color(text: str) -> Color:
    from bt_dualarm.spec.problems import SpecError
    from bt_dualarm.spec.yaml_reader import read_text
    from bt_dualarm.tuning import ColorError, color_of

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


# ``bt-tune-color``: shows what a camera detects as its target, and tunes the color.


_PROGRAM = "bt-tune-color"


def main(argv: Sequence[str] | None) -> int:
    """Show what a color detects, and write new ranges; returns the exit code."""
    return _tune(command_line().parse_args(argv))


@dataclass(frozen=True)
class _Subject:
    """The image, its initial color, and the target of a new one."""

    shot: Shot
    color: Color
    save: Save | None


def _tune(arguments: argparse.Namespace) -> int:
    from bt_dualarm.tuning import ColorView, png

    subject = _of_image(arguments) if _is_image(arguments.file) else _of_tree(arguments)
    look = ColorView(subject.shot.frame, _wanted(arguments, subject))
    _print(arguments, subject, look)
    if arguments.out is not None:
        _write(arguments.out, png(look.picture(subject.shot.what)))
        if not arguments.json:
            print(f"written: {arguments.out}")
    if arguments.serve is not None:
        return _serve(subject, look.color, arguments.serve)
    if subject.save is not None:
        print(subject.save(look.color))
    return SUCCEEDED if look.found else FAILED


def _is_image(file: str) -> bool:
    from bt_dualarm.tuning import IMAGE_SUFFIXES

    return Path(file).suffix.lower() in IMAGE_SUFFIXES


def _of_image(arguments: argparse.Namespace) -> _Subject:
    from bt_dualarm.spec.values import Color
    from bt_dualarm.tuning import image_shot

    if arguments.write:
        raise DualArmError("--write: an image has no ranges; --snippet FILE writes a new file")
    shot = image_shot(Path(arguments.file))
    return _Subject(shot, Color.named("yellow"), _snippet(arguments, shot))


def _of_tree(arguments: argparse.Namespace) -> _Subject:
    from bt_dualarm.runtime.file_check import check
    from bt_dualarm.runtime.options import find_tree
    from bt_dualarm.spec.values import Color
    from bt_dualarm.tuning import (
        IntoTree,
        ShotTime,
        camera_arm,
        camera_shot,
        choose,
        color_ports,
    )

    path = find_tree(arguments.file)
    params = dict(arguments.param)
    if arguments.write and not Path(arguments.file).is_file():
        raise DualArmError(f"--write: {path} is shipped; copy it and tune the copy")
    registry = imported_skills("bt-tune-color", arguments.skills)
    file = check(path, registry.kinds, params, build=False).runnable()
    arm = camera_arm(file, arguments.arm)
    color = None
    save = None
    ports = list(color_ports(file, arm, registry.kinds))
    if arguments.write or arguments.line is not None or len(ports) == 1:
        port = choose(ports, arm, arguments.line)
        color = port.color
        if arguments.write:
            port.home()  # fails now rather than after tuning
            save = IntoTree(path, arm, arguments.line, registry, params)
    moment = ShotTime(arguments.at, arguments.posture, arguments.seed, arguments.renderer)
    shot = camera_shot(file, registry, arm, moment)
    return _Subject(shot, color or Color.named("yellow"), save or _snippet(arguments, shot))


def _snippet(arguments: argparse.Namespace, shot: Shot) -> Save | None:
    from bt_dualarm.tuning import AsSnippet

    return AsSnippet(arguments.snippet, shot.what) if arguments.snippet else None


def _wanted(arguments: argparse.Namespace, subject: _Subject) -> Color:
    """The color that the options define, starting from the color in the file."""
    from bt_dualarm.tuning import adjusted

    bounds = {name: getattr(arguments, name) for name in ("hue", "saturation", "value")}
    return adjusted(
        arguments.color or subject.color,
        subject.shot.frame.image,
        pick=arguments.pick,
        widen=arguments.widen,
        bounds={name: pair for name, pair in bounds.items() if pair is not None},
    )


def _print(arguments: argparse.Namespace, subject: _Subject, look: ColorView) -> None:
    if arguments.json:
        content = {"picture": subject.shot.what, "color": look.color.data, "found": look.table}
        print(json.dumps(content, indent=2))
        return
    print(subject.shot.what)
    print(f"color: {look.color.notation}")
    if not look.found:
        print("nothing of this color")
    for number, one in enumerate(look.found, start=1):
        x, y = one.centroid_px
        border = ", at the border of the image" if one.touches_border else ""
        print(
            f"  {number}  center {x:.1f}, {y:.1f} px  area {one.area_px:.0f} px²  "
            f"{one.confidence:.0%} of its outline filled{border}"
        )


def _write(path: Path, content: bytes) -> None:
    from bt_dualarm.core.share import write_atomically

    try:
        write_atomically(path, lambda file: file.write(content))
    except OSError as error:
        raise DualArmError(f"cannot write {path}: {error.strerror or error}") from error


def _serve(subject: _Subject, color: Color, port: int) -> int:
    """Serve the page until Ctrl-C."""
    from bt_dualarm.tuning import Tuning, page_server

    with page_server(Tuning(subject.shot, color, subject.save), port) as server:
        host, number = server.server_address[:2]
        print(f"open http://{host!s}:{number}/ in a browser; Ctrl-C ends it", flush=True)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            print()
    return SUCCEEDED
