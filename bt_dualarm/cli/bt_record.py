"""``bt-record``: exports records to formats that other programs read."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from bt_dualarm.cli.entry import SUCCEEDED, given_path
from bt_dualarm.core.errors import DualArmError

if TYPE_CHECKING:
    from bt_dualarm.export.lerobot import Demonstrations
    from bt_dualarm.replay.record import Record


_EPILOG = """\
examples:
  bt-record export out --html out.html     the bt-replay page as one offline file
  bt-record export out --mcap out.mcap     for Foxglove and other viewers
  bt-record export out --mp4 out.mp4       a video of the scene and the trees
  bt-record export out --webp out.webp     the same, small, for web pages
  bt-record export out --lerobot data      a demonstration for imitation learning (LeRobot v3.0)
  bt-record export run_* --lerobot data --only-successes
                                           many runs as one data set, one episode each
  bt-record export out --csv tables        a folder of tables: events, annotations,
                                           arms, states

exit code:
  0 written   2 no such record, or the target cannot be written
"""


def main(argv: Sequence[str] | None) -> int:
    """Export a record; returns the exit code."""
    parser = _command_line()
    arguments = parser.parse_args(argv)
    wanted = [(name, getattr(arguments, name)) for name in ("lerobot", *_FORMATS)]
    wanted = [(name, target) for name, target in wanted if target is not None]
    if not wanted:
        parser.error(
            f"choose a format: {', '.join(f'--{name}' for name in (*_FORMATS, 'lerobot'))}"
        )
    if arguments.lerobot is None and (arguments.only_successes or arguments.append):
        parser.error("--only-successes and --append require --lerobot")
    if len(arguments.folders) > 1 and [name for name, _ in wanted] != ["lerobot"]:
        parser.error("several records can only be exported to one data set, with --lerobot alone")
    from bt_dualarm.replay.record import Record

    record: Record | None = None
    _refuse_targets([target for _, target in wanted], arguments.folders)
    for name, target in wanted:
        try:
            if name == "lerobot":
                _lerobot(arguments)
                continue
            record = record or Record.read(arguments.folders[0])
            _FORMATS[name](record, target)
        except OSError as error:
            raise DualArmError(f"cannot write {target}: {error.strerror or error}") from error
        print(f"written: {target}")
    return SUCCEEDED


def _command_line() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="bt-record",
        description="Export the record of a run.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("action", choices=("export",), metavar="export", help="the action: export")
    add(
        "folders",
        metavar="DIR",
        nargs="+",
        type=given_path,
        help="a folder written by bt-run --record; several with --lerobot",
    )
    add("--html", metavar="FILE", type=given_path, help="the bt-replay page as one file")
    add("--mcap", metavar="FILE", type=given_path, help="time-stamped JSON messages")
    add("--mp4", metavar="FILE", type=_film, help="a video, 25 frames per simulated second")
    add("--webp", metavar="FILE", type=_animation, help="an animation of at most 3 MB")
    add("--lerobot", metavar="FOLDER", type=given_path, help="a data set, one episode per DIR")
    add("--only-successes", action="store_true", help="leave out runs that did not succeed")
    add("--append", action="store_true", help="add the runs to the data set in FOLDER")
    add("--csv", metavar="FOLDER", type=given_path, help="a folder of tables")
    return parser


def _refuse_targets(targets: Sequence[Path], folders: Sequence[Path]) -> None:
    """Refuse unusable targets, all of them before the first export, which may take minutes.

    Raises:
        DualArmError: A target cannot be reached, is given twice, or is a file of the record, which
            the export would destroy.
    """
    from bt_dualarm.runtime.recorder import FILES

    seen: set[Path] = set()
    for target in targets:
        try:
            with suppress(FileNotFoundError):
                target.lstat()
            place = target.parent.resolve() / target.name
        except OSError as error:
            raise DualArmError(f"cannot write {target}: {error.strerror or error}") from error
        if place in seen:
            raise DualArmError(f"cannot write {target}: two exports have this target")
        if place.name in FILES and place.parent in [folder.resolve() for folder in folders]:
            raise DualArmError(f"cannot write {target}: it is a file of the record")
        seen.add(place)


def _html(record: Record, target: Path) -> None:
    from bt_dualarm.core.share import write_text
    from bt_dualarm.viewer.past import html_of

    write_text(target, html_of(record))


def _mcap(record: Record, target: Path) -> None:
    from bt_dualarm.export.mcap import messages_of, write_mcap

    write_mcap(messages_of(record), target)


def _film(text: str) -> Path:
    if Path(text).suffix != ".mp4":
        raise argparse.ArgumentTypeError(f"{text!r} does not end with .mp4")
    return Path(text)


def _animation(text: str) -> Path:
    if Path(text).suffix != ".webp":
        raise argparse.ArgumentTypeError(f"{text!r} does not end with .webp")
    return Path(text)


def _webp(record: Record, target: Path) -> None:
    from bt_dualarm.export.video import write_animation

    write_animation(record, target)


def _mp4(record: Record, target: Path) -> None:
    from bt_dualarm.export.video import write_film

    write_film(record, target)


def _lerobot(arguments: argparse.Namespace) -> None:
    """Export all records as one data set, and report the progress."""
    from bt_dualarm.export.lerobot import write_dataset

    folders = arguments.folders
    target = arguments.lerobot

    def progress(number: int, folder: Path) -> None:
        if len(folders) > 1:  # one line each, because text from records must not move the cursor
            print(f"{number + 1} of {len(folders)}: {folder}", file=sys.stderr)

    done = write_dataset(
        folders,
        target,
        only_successes=arguments.only_successes,
        append=arguments.append,
        progress=progress,
    )
    print(f"written: {target} ({_counted(done)})")


def _counted(done: Demonstrations) -> str:
    """Numbers of episodes by kind."""
    from bt_dualarm.spec.node_types import counted

    parts = [counted(done.episodes, "episode")]
    parts += [f"{done.failed} failed (success is false)"] if done.failed else []
    parts += [f"{done.left_out} left out"] if done.left_out else []
    return f"{', '.join(parts)}, {counted(done.frames, 'frame')}"


def _csv(record: Record, target: Path) -> None:
    from bt_dualarm.export.tables import write_tables

    write_tables(record, target)


_FORMATS: dict[str, Callable[[Record, Path], None]] = {
    "html": _html,
    "mcap": _mcap,
    "mp4": _mp4,
    "webp": _webp,
    "csv": _csv,
}
