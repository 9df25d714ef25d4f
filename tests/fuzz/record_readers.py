# ruff: noqa: E501 - tables
"""All readers of records, and the rules for reading the record of a stranger."""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import signal
import stat
import unicodedata
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from bt_dualarm import cli
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.replay.data import load
from bt_dualarm.runtime.recorder import RecordFolder
from bt_dualarm.viewer.past import RecordView

LONGEST_S: Final = 120
"""Wall-clock limit for reading one small record, s: on an idle machine none needs ten."""

_CONTROLS: Final = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})


def _export(form: str, name: str) -> Callable[[Path, Path], int]:
    return lambda record, out: cli.record(["export", str(record), f"--{form}", str(out / name)])


def _view(record: Path, _: Path) -> int:
    """Requests of the viewer's page, by way of the server's functions; `DualArmError` is allowed."""
    view = RecordView(record)
    requests = [
        ("now", {}), ("log", {}), ("scene", {"generation": "0"}), ("series", {}), ("why", {}),
        ("at", {"t": "0.0"}), ("at", {"t": "0.3"}), ("at", {"t": "9"}), ("eye", {"arm": "arm1", "t": "0.2"}),
    ]  # fmt: skip
    for name, query in requests:
        with contextlib.suppress(DualArmError):
            view.questions[name](query)
    return 0


def _load(record: Path, _: Path) -> int:
    """All arrays, frames and the table of a record."""
    data = load(record)
    for arm in data.arms:
        data.blackboard(arm)
    for frame in data.frames():
        assert frame.image.ndim == 3
    data.table()
    repr(data)
    return 0


def _recorded_over(record: Path, out: Path) -> int:
    """Records a run over such a record, which may replace only the files of the record."""
    copy = out / "again"
    shutil.copytree(record, copy, symlinks=True, copy_function=_copied)
    with RecordFolder(copy, ["arm1"]):
        return 0


def _copied(source: str, target: str) -> None:
    found = os.lstat(source)
    if stat.S_ISLNK(found.st_mode) or (stat.S_ISREG(found.st_mode) and found.st_size < 1 << 28):
        shutil.copy2(source, target, follow_symlinks=False)


QUICK: Final[dict[str, Callable[[Path, Path], int]]] = {
    "bt-why": lambda record, _: cli.why([str(record)]),
    "bt-why --json": lambda record, _: cli.why([str(record), "--json"]),
    "bt-why TIME": lambda record, _: cli.why([str(record), "0.2"]),
    "--html": _export("html", "page.html"),
    "--csv": _export("csv", "tables"),
    "--mcap": _export("mcap", "run.mcap"),
    "view": _view,
    "bt.load": _load,
    "--record": _recorded_over,
}
SLOW: Final[dict[str, Callable[[Path, Path], int]]] = {
    "--lerobot": _export("lerobot", "data"),
    "--webp": _export("webp", "film.webp"),
    "--mp4": _export("mp4", "film.mp4"),
    "--check": lambda record, _: cli.replay([str(record), "--check"]),
    "--resume": lambda record, _: cli.run(["--resume", f"{record}@0.2", "--display", "quiet"]),
}
"""Readers that render videos or run the tree again."""


@contextlib.contextmanager
def _limited(seconds: int) -> Iterator[None]:
    def late(*_: object) -> None:
        raise TimeoutError(f"not done after {seconds} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def fault_of(reader: Callable[[Path, Path], int], sandbox: Path) -> tuple[bool, str]:
    """Reads ``sandbox/record``; returns whether it was refused, and the broken rule, if any.

    A reader may raise only errors that become messages, write only below ``sandbox/out``, and print
    no control characters.
    """
    out = sandbox / "out"
    here = sandbox / "here"
    for folder in (out, here):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
    before = _listed(sandbox)
    text = io.StringIO()
    errors = io.StringIO()
    cwd = Path.cwd()
    os.chdir(here)
    try:
        with (
            contextlib.redirect_stdout(text),
            contextlib.redirect_stderr(errors),
            _limited(LONGEST_S),
        ):
            code = reader(sandbox / "record", out)
    except DualArmError as error:
        code = 2
        errors.write(f"error: {error}")
    except SystemExit as ended:
        return False, f"left with {ended.code}"
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        return False, f"{type(error).__name__}: {error}"[:300]
    finally:
        os.chdir(cwd)
    printed = text.getvalue() + errors.getvalue()
    if code not in (0, 1, 2):
        return False, f"exit code {code}"
    if code == 2 and "error: " not in errors.getvalue() and ":" not in errors.getvalue():
        return True, f"no error, but exit code 2: {errors.getvalue()[:200]}"
    if "Traceback (most recent call last)" in printed:
        return code == 2, "a traceback is printed"
    raw = {
        letter for letter in printed if letter != "\n" and unicodedata.category(letter) in _CONTROLS
    }
    if raw:
        at = min(printed.index(letter) for letter in raw)
        return code == 2, f"printed {raw}: {printed[max(0, at - 60) : at + 20]!r}"
    after = {path for path in _listed(sandbox) if not path.startswith("out/")}
    if after != {path for path in before if not path.startswith("out/")}:
        return code == 2, f"written elsewhere: {sorted(after ^ before)[:3]}"
    return code == 2, ""


def _listed(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}
