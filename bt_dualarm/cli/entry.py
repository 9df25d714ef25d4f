"""Around every command: what can happen to any of them becomes a sentence and an exit code.

Only what is small is imported here, so that Ctrl-C while a program starts gives no traceback.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from types import FrameType
from typing import TYPE_CHECKING, Final

from bt_dualarm.cli.outlet import outlets

if TYPE_CHECKING:
    from bt_dualarm.errors import DualArmError

SUCCEEDED: Final = 0
FAILED: Final = 1
UNUSABLE: Final = 2
INTERRUPTED: Final = 128 + signal.SIGINT
"""What a shell says of a program that Ctrl-C ended."""


def entered(program: str, argv: Sequence[str] | None) -> int:
    """Run a command; its exit code.

    Args:
        program: Name of the program; of ``bt-run`` it is ``main`` of the module `bt_run`.
        argv: Arguments without the program's name; those of the process by default.

    Raises:
        SystemExit: From argparse, for ``--help`` and for arguments that are wrong.
    """
    _occupy_standard_streams()
    prepare_imports()
    with _interrupts(leaving=argv is None) as interrupts, outlets(program) as output:
        try:
            code = _ended(program, argv)
        except SystemExit as ended:
            if output.failed() and not ended.code:
                raise SystemExit(FAILED) from None
            raise
        except BaseException:
            # Libraries make other errors of a KeyboardInterrupt that meets them in an import.
            if not interrupts:
                raise
            code = INTERRUPTED
        if interrupts and code == UNUSABLE:
            return INTERRUPTED  # what could not be used was what Ctrl-C met
        return FAILED if output.failed() and code == SUCCEEDED else code


def _ended(program: str, argv: Sequence[str] | None) -> int:
    """The exit code of the program's own ``main``; what it cannot use is said."""
    from bt_dualarm.errors import DualArmError

    module = import_module(f"bt_dualarm.cli.{program.replace('-', '_')}")
    try:
        return int(module.main(argv))
    except DualArmError as error:
        complain(program, error)
        return UNUSABLE


def complain(program: str, error: DualArmError) -> None:
    """Errors that name their place say it all; the others say who is talking."""
    from bt_dualarm.spec.problems import SpecError
    from bt_dualarm.world.urdf.xml_source import DescriptionError

    prefix = "" if isinstance(error, (SpecError, DescriptionError)) else f"{program}: error: "
    print(f"{prefix}{error}", file=sys.stderr)


def prepare_imports() -> None:
    """Before numpy and mujoco are imported: settings of what they import.

    One thread for numpy's sums: on matrices of 7 by 7 threads only wait for each other. And the
    GLFW that came with its package, without a search: that asks every library that it finds for
    its version, in processes of their own.
    """
    from importlib.util import find_spec

    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    display = "wayland" if os.environ.get("XDG_SESSION_TYPE") == "wayland" else "x11"
    package = find_spec("glfw")
    for folder in (package and package.submodule_search_locations) or ():
        library = os.path.join(folder, display, "libglfw.so")  # noqa: PTH118 - pathlib is not small
        if os.path.isfile(library):  # noqa: PTH113 - as above
            os.environ.setdefault("PYGLFW_LIBRARY", library)


def _occupy_standard_streams() -> None:
    """Keep files that are opened later from becoming standard input, output or error."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest that is free: this one


@contextmanager
def _interrupts(*, leaving: bool) -> Iterator[list[int]]:
    """Note Ctrl-C, beside raising KeyboardInterrupt; nothing where it is ignored or handled.

    Args:
        leaving: Whether the process ends with the command. Ctrl-C is ignored from then on: Python
            takes its handlers away long before it is gone, and the exit code would be lost.
    """
    noted: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        noted.append(number)
        sys.unraisablehook = lambda _: None  # a clean-up that it met has nothing to tell
        signal.default_int_handler(number, frame)

    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield noted
        return
    hook = sys.unraisablehook
    with suppress(ValueError):  # in a thread: there no signals come
        signal.signal(signal.SIGINT, note)
    try:
        yield noted
    finally:
        sys.unraisablehook = hook
        with suppress(ValueError):
            signal.signal(signal.SIGINT, signal.SIG_IGN if leaving else signal.default_int_handler)
