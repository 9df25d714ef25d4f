"""``bt-tune-color``: see what a camera takes for its target, and change that."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bt_dualarm.cli.entry import FAILED, SUCCEEDED
from bt_dualarm.cli.skill_import import imported_skills
from bt_dualarm.cli.tune_arguments import command_line
from bt_dualarm.errors import DualArmError

if TYPE_CHECKING:
    from bt_dualarm.spec.color import Color
    from bt_dualarm.tuning.look import Look
    from bt_dualarm.tuning.saving import Save
    from bt_dualarm.tuning.shot import Shot

_PROGRAM = "bt-tune-color"


def main(argv: Sequence[str] | None) -> int:
    """Show what a colour finds, and write new ranges; returns the exit code."""
    return _tune(command_line().parse_args(argv))


@dataclass(frozen=True)
class _Subject:
    """The picture, the colour that it is looked at with first, and where a new one goes."""

    shot: Shot
    color: Color
    save: Save | None


def _tune(arguments: argparse.Namespace) -> int:
    from bt_dualarm.tuning.look import Look, png

    subject = _of_image(arguments) if _is_image(arguments.file) else _of_tree(arguments)
    look = Look(subject.shot.frame, _wanted(arguments, subject))
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
    from bt_dualarm.tuning.image_file import IMAGE_SUFFIXES

    return Path(file).suffix.lower() in IMAGE_SUFFIXES


def _of_image(arguments: argparse.Namespace) -> _Subject:
    from bt_dualarm.spec.color import Color
    from bt_dualarm.tuning.shot import image_shot

    if arguments.write:
        raise DualArmError("--write: an image has no ranges; --snippet FILE writes a fresh file")
    shot = image_shot(Path(arguments.file))
    return _Subject(shot, Color.named("yellow"), _snippet(arguments, shot))


def _of_tree(arguments: argparse.Namespace) -> _Subject:
    from bt_dualarm.preflight.check import check
    from bt_dualarm.runtime.shipped import find_tree
    from bt_dualarm.spec.color import Color
    from bt_dualarm.tuning.color_port import choose, color_ports
    from bt_dualarm.tuning.saving import IntoTree
    from bt_dualarm.tuning.shot import Moment, camera_arm, camera_shot

    path, params = find_tree(arguments.file), dict(arguments.param)
    if arguments.write and not Path(arguments.file).is_file():
        raise DualArmError(f"--write: {path} is shipped; copy it and tune the copy")
    registry = imported_skills("bt-tune-color", arguments.skills)
    file = check(path, registry.kinds, params, build=False).runnable()
    arm = camera_arm(file, arguments.arm)
    color, save, ports = None, None, list(color_ports(file, arm, registry.kinds))
    if arguments.write or arguments.line is not None or len(ports) == 1:
        port = choose(ports, arm, arguments.line)
        color = port.color
        if arguments.write:
            port.home()  # refuses now what could not be written later
            save = IntoTree(path, arm, arguments.line, registry, params)
    moment = Moment(arguments.at, arguments.posture, arguments.seed, arguments.renderer)
    shot = camera_shot(file, registry, arm, moment)
    return _Subject(shot, color or Color.named("yellow"), save or _snippet(arguments, shot))


def _snippet(arguments: argparse.Namespace, shot: Shot) -> Save | None:
    from bt_dualarm.tuning.saving import AsSnippet

    return AsSnippet(arguments.snippet, shot.what) if arguments.snippet else None


def _wanted(arguments: argparse.Namespace, subject: _Subject) -> Color:
    """The colour that the options ask for, from the one that the file has."""
    from bt_dualarm.tuning.wanted import adjusted

    bounds = {name: getattr(arguments, name) for name in ("hue", "saturation", "value")}
    return adjusted(
        arguments.color or subject.color,
        subject.shot.frame.image,
        pick=arguments.pick,
        widen=arguments.widen,
        bounds={name: pair for name, pair in bounds.items() if pair is not None},
    )


def _print(arguments: argparse.Namespace, subject: _Subject, look: Look) -> None:
    if arguments.json:
        content = {"picture": subject.shot.what, "color": look.color.data, "found": look.table}
        print(json.dumps(content, indent=2))
        return
    print(subject.shot.what)
    print(f"color: {look.color.notation}")
    if not look.found:
        print("nothing of this colour")
    for number, one in enumerate(look.found, start=1):
        x, y = one.centroid_px
        border = ", at the border of the image" if one.touches_border else ""
        print(
            f"  {number}  centre {x:.1f}, {y:.1f} px  area {one.area_px:.0f} px²  "
            f"{one.confidence:.0%} of its outline filled{border}"
        )


def _write(path: Path, content: bytes) -> None:
    from bt_dualarm.runtime.atomic_write import write_atomically

    try:
        write_atomically(path, lambda file: file.write(content))
    except OSError as error:
        raise DualArmError(f"cannot write {path}: {error.strerror or error}") from error


def _serve(subject: _Subject, color: Color, port: int) -> int:
    """Until Ctrl-C, which is how one closes the page."""
    from bt_dualarm.tuning.page import Tuning, page_server

    with page_server(Tuning(subject.shot, color, subject.save), port) as server:
        host, number = server.server_address[:2]
        print(f"open http://{host!s}:{number}/ in a browser; Ctrl-C ends it", flush=True)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            print()
    return SUCCEEDED
