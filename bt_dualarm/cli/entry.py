"""Around every command: what can happen to any of them becomes a sentence and an exit code.

Only what is small is imported here, so that Ctrl-C while a program starts gives no traceback.
"""

from __future__ import annotations

import gc
import os
import resource
import signal
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from typing import TYPE_CHECKING, Final

from bt_dualarm.cli.early_signals import early_signals
from bt_dualarm.cli.outlet import outlets

if TYPE_CHECKING:
    from bt_dualarm.errors import DualArmError

SUCCEEDED: Final = 0
FAILED: Final = 1
UNUSABLE: Final = 2
OVERRUN: Final = 128 + signal.SIGVTALRM
"""What a shell says of a program that the alarm of its virtual time ended: code did not return."""

_OBJECTS: Final = 500_000
"""New objects, about 50 MB, after which Python looks for circles that nobody refers to: more than a
run makes until it moves. What is imported stays, and a run leaves none: to look after every 700
took a tenth of the start, after every 100,000 still 0.09 s."""

_READERS: Final = frozenset({"bt-why", "bt-replay", "bt-record"})
"""Programs that print what stands in a record, which may come from a stranger."""

_ADDRESS_SPACE: Final = 1_500_000_000
"""Bytes of address space below which libraries may not be mapped: an arm takes 1.0 to 1.2 GB."""

_LEAVING_S: Final = 1.0
"""Seconds that threads get which somebody has started and which keep Python from ending."""


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
    if argv is None:  # the process is ours
        gc.set_threshold(_OBJECTS)
    with (
        early_signals(leaving=argv is None) as signals,
        outlets(program, is_plain=program in _READERS) as output,
    ):
        try:
            with signals.interrupting():
                code = _ended(program, argv)
        except SystemExit as ended:
            if output.failed() and not ended.code:
                raise SystemExit(FAILED) from None
            raise
        except BaseException:
            # Libraries make other errors of a KeyboardInterrupt that meets them in an import.
            if not signals:
                raise
            code = UNUSABLE
        if signals and (code == UNUSABLE or signals.numbers[0] != signal.SIGINT):
            code = signals.exit_code(code)  # what could not be used was what the signal met
        if output.failed() and code == SUCCEEDED:
            code = FAILED
    if argv is None:
        _leave_threads(program, code)
    return code


def _ended(program: str, argv: Sequence[str] | None) -> int:
    """The exit code of the program's own ``main``; what it cannot use is said."""
    from bt_dualarm.errors import DualArmError, Overrun

    module = import_module(f"bt_dualarm.cli.{program.replace('-', '_')}")
    try:
        return int(module.main(argv))
    except DualArmError as error:
        complain(program, error)
        return UNUSABLE
    except Overrun as overrun:
        print(f"{program}: error: {overrun}", file=sys.stderr)
        return OVERRUN
    except Exception as error:  # libraries call it ImportError, OSError, ValueError …
        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit == resource.RLIM_INFINITY or limit >= _ADDRESS_SPACE:
            raise
        print(
            f"{program}: error: the address space is limited to {limit / 1e6:.0f} MB "
            f"(ulimit -v), and {_ADDRESS_SPACE / 1e6:.0f} MB are needed: "
            f"{' '.join(f'{type(error).__name__}: {error}'.split())[:200]}",
            file=sys.stderr,
        )
        return UNUSABLE


def _leave_threads(program: str, code: int) -> None:
    """End the process where Python would wait for a thread that does not end."""
    me, latest = threading.current_thread(), time.monotonic() + _LEAVING_S
    others = [one for one in threading.enumerate() if one is not me and not one.daemon]
    for thread in others:
        thread.join(max(0.0, latest - time.monotonic()))
    names = ", ".join(repr(thread.name) for thread in others if thread.is_alive())
    if names:
        with suppress(OSError):
            print(f"{program}: still running, and left behind: {names}", file=sys.stderr)
            sys.stdout.flush()
        os._exit(code)


def complain(program: str, error: DualArmError) -> None:
    """Errors that name their place say it all; the others say who is talking."""
    from bt_dualarm.spec.problems import SpecError
    from bt_dualarm.spec.wording import escaped
    from bt_dualarm.world.urdf.xml_source import DescriptionError

    prefix = "" if isinstance(error, (SpecError, DescriptionError)) else f"{program}: error: "
    print(f"{prefix}{escaped(str(error))}", file=sys.stderr)


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
