"""``bt-run --view``: the page, and the record that it looks back in."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bt_dualarm.live.view import LiveView
    from bt_dualarm.runtime.run import Run
    from bt_dualarm.runtime.signals import StopRequest


@contextmanager
def record_folder(arguments: argparse.Namespace) -> Iterator[Path | None]:
    """Where the run is recorded; for a page alone a folder that is gone after the block."""
    if arguments.dry_run:
        yield None
    elif arguments.record is not None or not arguments.view:
        yield arguments.record
    else:
        from bt_dualarm.cli.view_folder import view_folder

        with view_folder() as folder:
            yield folder


@contextmanager
def viewed(
    arguments: argparse.Namespace, opened: Run, stop: StopRequest
) -> Iterator[LiveView | None]:
    """Serve the page in the block, and then for as long as somebody looks.

    Nothing of it is imported unless it is asked for.
    """
    if not arguments.view:
        yield None
        return
    from bt_dualarm.live.view import LiveView

    with LiveView(opened, stop, arguments.view_port, arguments.view_host) as view:
        print(f"held until you let it go: {view.url}", file=sys.stderr, flush=True)
        yield view


def linger(view: LiveView) -> None:
    """Once the run is over, leave its page up for as long as one is open."""
    if view.is_watched:
        message = "the run is over; it is shown until its page is closed, or Ctrl-C"
        print(message, file=sys.stderr, flush=True)
    view.linger()


@contextmanager
def watched(arguments: argparse.Namespace, opened: Run, view: LiveView | None) -> Iterator[None]:
    """Take up the trees of the file whenever it is saved in the block, if that is asked for.

    Raises:
        DualArmError: The file has errors, or is not there.
    """
    if not arguments.watch:
        yield
        return
    from bt_dualarm.runtime.api import registry_of
    from bt_dualarm.runtime.file_watch import FileWatch
    from bt_dualarm.runtime.shipped import find_tree

    path, registry = find_tree(arguments.file), registry_of(arguments.skills)
    with FileWatch(opened, path, registry, dict(arguments.param)) as watch:
        if view is not None:
            view.gate.chores.append(watch.take)
        yield


def drop_record(arguments: argparse.Namespace, opened: Run) -> None:
    """A record that was for the page alone is not written to its end."""
    if arguments.record is None and opened.kept is not None:
        opened.kept.recorder.close()
