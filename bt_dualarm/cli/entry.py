"""The entry point of every command, and what the commands share.

Error messages, exit codes and signals; arguments, tables in the terminal, and the import of skills.
"""

from __future__ import annotations

import argparse
import ctypes
import faulthandler
import gc
import json
import math
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Final, NoReturn, Self, TypeAlias

from bt_dualarm.cli.safe_streams import safe_streams
from bt_dualarm.runtime.interruption import StopRequest, stop_on_signals

if TYPE_CHECKING:
    from rich.table import Table

    from bt_dualarm.core.errors import DualArmError
    from bt_dualarm.skill.registry import Registry

# Signals before a run has started end the command with an exit code and without a traceback. The
# handlers must be installed before any slow import, so this module imports little.

# The original, because `exit_refused` replaces it while skills are imported.
_leave_early = os._exit

_SignalHandler: TypeAlias = Callable[[int, FrameType | None], Any] | signal.Handlers | int | None

_DEFAULTS: Final[dict[signal.Signals, _SignalHandler]] = {
    signal.SIGINT: signal.default_int_handler,
    signal.SIGTERM: signal.SIG_DFL,
    signal.SIGHUP: signal.SIG_DFL,
}
"""The handled signals with their default handlers; other handlers, as from ``nohup``, are kept."""


class EarlySignals:
    """Signals received by a command before a run handles them.

    Attributes:
        numbers: Received signals in order; the first one determines the exit code.
    """

    def __init__(self) -> None:
        self.numbers: list[int] = []
        self._interrupts = False

    def __bool__(self) -> bool:
        """Whether a signal was received."""
        return bool(self.numbers)

    def exit_code(self, code: int) -> int:
        """Exit code of a program ended by the first signal; ``code`` without one."""
        return 128 + self.numbers[0] if self.numbers else code

    @contextmanager
    def interrupting(self) -> Iterator[None]:
        """Let a signal end the block.

        Raises:
            KeyboardInterrupt: A signal is received in the block, or was before.
        """
        self._interrupts = True
        try:
            if self.numbers:
                raise KeyboardInterrupt
            yield
        finally:
            self._interrupts = False

    def note(self, number: int, _frame: FrameType | None = None) -> None:
        """Handle a signal; the second one ends the process at once."""
        self.numbers.append(number)
        if len(self.numbers) > 1:
            _leave_early(self.exit_code(0))
        sys.unraisablehook = lambda _: None  # no message for interrupted cleanup code
        if self._interrupts:
            raise KeyboardInterrupt


early: Final = EarlySignals()
"""Signals of this process."""


@contextmanager
def early_signals(*, leaving: bool) -> Iterator[EarlySignals]:
    """Record signals within the block; ignored signals and other handlers are left alone.

    Args:
        leaving: Whether the process ends with the command. Signals are ignored from then on,
            because Python removes its handlers long before it exits, and a signal would change the
            exit code.
    """
    early.numbers.clear()
    handled = [number for number, usual in _DEFAULTS.items() if signal.getsignal(number) is usual]
    hook = sys.unraisablehook
    with suppress(ValueError):  # not the main thread, which alone handles signals
        for number in handled:
            signal.signal(number, early.note)
    try:
        yield early
    finally:
        sys.unraisablehook = hook
        with suppress(ValueError):
            for number in handled:
                signal.signal(number, signal.SIG_IGN if leaving else _DEFAULTS[number])


SUCCEEDED: Final = 0
FAILED: Final = 1
UNUSABLE: Final = 2
OVERRUN: Final = 128 + signal.SIGVTALRM
"""Exit code when skill code did not return, as if the process had ended by SIGVTALRM."""

_GC_THRESHOLD: Final = 500_000
"""New objects, about 50 MB, after which Python's garbage collector runs: more than the start of a
run creates. Imports and runs leave no cycles; the default of 700 took a tenth of the start-up time,
and 100,000 still took 0.09 s."""

_READERS: Final = frozenset({"bt-why", "bt-replay", "bt-record"})
"""Programs that print content of a record, which may come from an untrusted source."""

_ADDRESS_SPACE: Final = 1_500_000_000
"""Bytes of address space below which mapping libraries may fail; one arm takes 1.0 to 1.2 GB."""

_LEAVING_S: Final = 1.0
"""Seconds granted to non-daemon threads, which would keep Python from exiting."""


def entered(program: str, argv: Sequence[str] | None) -> int:
    """Run a command and return its exit code.

    Args:
        program: Name of the program; for ``bt-run``, ``main`` of the module `bt_run` is called.
        argv: Arguments without the program's name; those of the process by default.

    Raises:
        SystemExit: From argparse, for ``--help`` and for invalid arguments.
    """
    _occupy_standard_streams()
    prepare_imports()
    if argv is None:  # the process runs only this command
        gc.set_threshold(_GC_THRESHOLD)
    with (
        early_signals(leaving=argv is None) as signals,
        safe_streams(program, is_plain=program in _READERS) as output,
    ):
        try:
            with signals.interrupting():
                code = _ended(program, argv)
        except SystemExit as ended:
            if output.failed() and not ended.code:
                raise SystemExit(FAILED) from None
            raise
        except BaseException:
            # Libraries convert a KeyboardInterrupt during their import into other errors.
            if not signals:
                raise
            code = UNUSABLE
        if signals and (code == UNUSABLE or signals.numbers[0] != signal.SIGINT):
            code = signals.exit_code(code)  # the error was a consequence of the signal
        if output.failed() and code == SUCCEEDED:
            code = FAILED
    if argv is None:
        _leave_threads(program, code)
    return code


def _ended(program: str, argv: Sequence[str] | None) -> int:
    """Call the ``main`` of a program and return its exit code; print expected errors."""
    from bt_dualarm.core.errors import DualArmError, Overrun

    try:
        module = import_module(f"bt_dualarm.cli.{program.replace('-', '_')}")
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
    """Exit the process if Python would wait forever for a thread."""
    me = threading.current_thread()
    latest = time.monotonic() + _LEAVING_S
    others = [one for one in threading.enumerate() if one is not me and not one.daemon]
    for thread in others:
        thread.join(max(0.0, latest - time.monotonic()))
    names = ", ".join(repr(thread.name) for thread in others if thread.is_alive())
    if names:
        with suppress(OSError):
            print(f"{program}: abandoned threads that are still running: {names}", file=sys.stderr)
            sys.stdout.flush()
        os._exit(code)


def _spare_modules() -> None:
    """Exclude the objects of imported modules from garbage collection.

    At its end, a process collects garbage several times, and frees one by one what is in reference
    cycles with modules: together a sixth of the CPU time of a check.
    """
    if gc.get_threshold()[0] == _GC_THRESHOLD:  # this process runs only one command
        gc.freeze()


def complain(program: str, error: DualArmError) -> None:
    """Print an error, prefixed with the program unless the message names its own location."""
    from bt_dualarm.robots.urdf_xml import DescriptionError
    from bt_dualarm.spec.node_types import escaped
    from bt_dualarm.spec.problems import SpecError

    prefix = "" if isinstance(error, (SpecError, DescriptionError)) else f"{program}: error: "
    print(f"{prefix}{escaped(str(error))}", file=sys.stderr)


def prepare_imports() -> None:
    """Set environment variables that numpy and mujoco read on import.

    OpenBLAS gets one thread, because threads do not pay off for matrices of 7 by 7. The GLFW of the
    Python package is named, because searching for it starts a process per library found.
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
    """Open closed standard descriptors, so that later files do not get their numbers."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free number, which is this one


# Skill code that cannot be interrupted, or that exits the process itself.

_leave: Final = os._exit  # the original, because `exit_refused` replaces it

_SAVING_S: Final = 5.0
"""Seconds granted to write the record."""

_SHOW_CURSOR: Final = b"\x1b[?25h"


_SignalCallback = ctypes.CFUNCTYPE(None, ctypes.c_int)

_MONITOR_PROGRAM: Final = """
import os, select, signal, sys, time
process, saving = int(sys.argv[1]), float(sys.argv[2])
limit = spent = 0.0
before = time.monotonic()
while os.getppid() == process:
    ready = select.select([0], [], [], 0.5)[0]
    now = time.monotonic()
    passed, before = min(now - before, 1.0), now
    if ready:
        message = os.read(0, 65536)
        if not message:
            break
        limit, spent = float(message.split()[-1]), 0.0
        continue
    with open(f"/proc/{process}/stat") as file:
        state = file.read().rpartition(")")[2].split()[0]
    spent += passed if state in "SD" else 0.0
    if limit and spent > limit:
        os.kill(process, signal.SIGVTALRM)
        limit, spent = 2.0 * saving, 0.0
"""
"""Monitor process: counts the time in which the command sleeps without sending a message.

A process that is stopped or waits for a CPU does not count as sleeping; one that computes is
covered by its own alarm. The second signal finds no handler any more and ends the process.
"""


class ProcessEnd:
    """Ends the process, as the last resort of a `Watchdog`.

    If code holds Python's interpreter lock, no other Python thread runs. Then a signal is sent: by
    the virtual-time alarm if that code computes, by a monitor process if it sleeps. Its handler is
    a C function, which the system calls in the thread that holds the lock, so that it may run
    Python: it prints the current line to standard error and writes the interim record. If that
    fails, because C code was interrupted at an arbitrary point, the next signal ends the process.
    The exit code is the same.

    Args:
        program: Name of the program.
        stop: Request to end; a received signal determines the exit code.
    """

    def __init__(self, program: str, stop: StopRequest) -> None:
        self._program = program
        self._stop = stop
        self.held_up: Callable[[FrameType | None], None] = lambda _: None
        self._handler = _SignalCallback(
            self._on_signal
        )  # referenced here, because C does not keep it alive
        self._before: int | None = None
        self._monitor: subprocess.Popen[bytes] | None = None
        self._is_installed = False
        # The watchdog's thread postpones the end, and so does the thread that it watches: without
        # a lock both may start a monitor, and nothing would end the first one.
        self._lock = threading.Lock()

    def __enter__(self) -> Self:
        """Install the handler; without `sysv_signal` in the C library, only the line is printed."""
        self._is_installed = True
        install = getattr(ctypes.CDLL(None), "sysv_signal", None)
        if install is None:
            faulthandler.register(signal.SIGVTALRM, file=2, all_threads=False, chain=True)
            return self
        install.argtypes = (ctypes.c_int, ctypes.c_void_p)
        install.restype = ctypes.c_void_p
        # System V handlers are called only once, and the signal is not blocked while they run.
        self._before = install(signal.SIGVTALRM, ctypes.cast(self._handler, ctypes.c_void_p)) or 0
        return self

    def __exit__(self, *error: object) -> None:
        """Turn the alarm off."""
        self.postpone(0.0)
        with self._lock:
            self._is_installed = False
        if self._monitor is not None and self._monitor.stdin is not None:
            with suppress(OSError):
                self._monitor.stdin.close()
            self._monitor.wait()
        if self._before is None:
            faulthandler.unregister(signal.SIGVTALRM)
        else:
            ctypes.CDLL(None).sysv_signal(signal.SIGVTALRM, ctypes.c_void_p(self._before))

    def postpone(self, seconds: float) -> None:
        """Set the alarm; 0 turns it off. Does nothing outside the ``with`` block.

        A run that is closed after the block still has a watchdog, which calls this. Without the
        handler the alarm would end the process at once, and nothing would end the monitor.
        """
        with self._lock:
            if not self._is_installed:
                return
            signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
            if self._monitor is None and seconds and self._before is not None:
                self._monitor = _started_monitor()
            if self._monitor is not None and self._monitor.stdin is not None:
                with suppress(OSError):  # it has ended; the alarm still covers code that computes
                    os.write(self._monitor.stdin.fileno(), f"{seconds}\n".encode())

    def _on_signal(self, _number: int) -> None:
        """Handle the signal, at an arbitrary point of C code in this thread."""
        signal.setitimer(signal.ITIMER_VIRTUAL, _SAVING_S)
        faulthandler.dump_traceback(file=2, all_threads=False)
        self.held_up(sys._getframe().f_back)

    def end(self, sentence: str, keep: Callable[[], object]) -> NoReturn:
        """Print the reason, write the interim record, and exit even if that fails."""
        code = self._stop.exit_code or OVERRUN
        too_late = threading.Timer(_SAVING_S, _leave, (code,))
        too_late.daemon = True
        too_late.start()
        with suppress(OSError):
            if os.isatty(1):
                os.write(1, _SHOW_CURSOR)
            os.write(2, f"{self._program}: error: {sentence}, and cannot be interrupted\n".encode())
        try:
            keep()
        except Exception as error:  # noqa: BLE001 - the process exits in any case
            with suppress(OSError):
                os.write(2, f"{self._program}: error: {error}\n".encode())
        _leave(code)


def _started_monitor() -> subprocess.Popen[bytes] | None:
    """Start the monitor process; None without a /proc file system or if it cannot be started."""
    if not Path(f"/proc/{os.getpid()}/stat").exists():
        return None
    command = [sys.executable, "-I", "-S", "-c", _MONITOR_PROGRAM, str(os.getpid()), str(_SAVING_S)]
    nobody = subprocess.DEVNULL
    try:
        process = subprocess.Popen(  # noqa: S603 - this Python, with a program of our own
            command, stdin=subprocess.PIPE, stdout=nobody, stderr=nobody, start_new_session=True
        )
    except OSError:
        return None
    if process.stdin is not None:
        os.set_blocking(process.stdin.fileno(), False)
    return process


@contextmanager
def exit_refused() -> Iterator[None]:
    """Let `os._exit` raise SystemExit within the block, so that a skill cannot end the process.

    Affects this thread and process only: processes forked by libraries exit in this way.
    """
    leave = os._exit
    process = os.getpid()
    thread = threading.get_ident()

    def refuse(status: int) -> NoReturn:
        if (os.getpid(), threading.get_ident()) == (process, thread):
            raise SystemExit(f"os._exit({status})")
        leave(status)

    os._exit = refuse
    try:
        yield
    finally:
        os._exit = leave


def with_trials(program: str, run: Callable[[StopRequest], int]) -> int:
    """Run the trials of a command until a signal ends them; returns the exit code.

    Args:
        program: Name of the command.
        run: Runs them until a stop is requested, and returns the exit code without a signal.

    Raises:
        NoTrials: There are no results, although no signal was received.
    """
    from bt_dualarm.sweeps.manifest import NoTrials

    with stop_on_signals(StopRequest()) as stop:
        for number in early.numbers:  # signals received during the imports
            stop.receive(number)
        try:
            code = run(stop)
        except NoTrials as error:
            if not stop.asked:
                raise
            print(f"{program}: interrupted: {error}", file=sys.stderr)
            code = FAILED
        return stop.exit_code or code


def add_skills(parser: argparse.ArgumentParser) -> None:
    """Add ``--skills DIR``."""
    parser.add_argument(
        "--skills",
        metavar="DIR",
        type=given_path,
        action="append",
        default=[],
        help="folder with your own skills, in addition to the shipped ones (may be repeated)",
    )


def add_params(parser: argparse.ArgumentParser) -> None:
    """Add ``--param NAME=VALUE``."""
    parser.add_argument(
        "--param",
        metavar="NAME=VALUE",
        type=_assignment,
        action="append",
        default=[],
        help="set a parameter that the file declares (may be repeated)",
    )


def _assignment(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not name or not equals:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form NAME=VALUE")
    return name, value


def add_view(parser: argparse.ArgumentParser) -> None:
    """Add ``--view-port N`` and ``--view-host ADDRESS``."""
    add = parser.add_argument
    add(
        "--view-port",
        metavar="N",
        type=_port,
        default=0,
        help="port of the page (default: any free port)",
    )
    add(
        "--view-host",
        metavar="ADDRESS",
        default="127.0.0.1",
        help="IPv4 address of another interface of this machine on which to serve the page; anyone "
        "who knows the page's address can then press its buttons (default: 127.0.0.1)",
    )


def seed(text: str) -> int:
    """The value of ``--seed``."""
    if not text.isascii() or not text.isdecimal() or int(text) >= 2**32:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 to 4294967295")
    return int(text)


def given_path(text: str) -> Path:
    """The value of an argument that is a path.

    An empty one, as of a variable of the shell that is not set, would be the current folder.
    """
    if not text.strip():
        raise argparse.ArgumentTypeError("empty path; '.' is the current folder")
    return Path(text)


def positive(text: str) -> float:
    """The value of an argument that is a finite number above 0."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return number


def _port(text: str) -> int:
    if not text.isascii() or not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is not a port from 0 to 65535")
    return int(text)


def print_parts(*parts: str | Table) -> None:
    """Print lines and tables one below the other."""
    from rich.console import Console

    console = Console(highlight=False)
    for part in parts:
        console.print(part)


def print_json(content: object) -> None:
    """Print JSON for programs."""
    print(json.dumps(content, indent=2, ensure_ascii=False))


def table(titles: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """Table with titles and without a frame; the first column is never wrapped."""
    from rich.table import Table

    rows_of = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    first, *others = titles
    rows_of.add_column(f"  {first}", no_wrap=True)
    for title in others:
        rows_of.add_column(title)
    for name, *cells in rows:
        rows_of.add_row(f"  {escape(name)}", *map(escape, cells))
    return rows_of


def escape(text: str) -> str:
    """The text with rich's markup escaped."""
    from rich.markup import escape as escaped

    return escaped(text)


IMPORT_S: Final = 30.0
"""Default wall-clock budget in s for the import of all skills."""


def imported_skills(
    program: str, folders: Sequence[Path], seconds: float | None = None
) -> Registry:
    """Registry of the installed skills and those in folders, each file imported once per process.

    Module-level code of skills is user code, so it runs under a watchdog.

    Args:
        program: Name of the program, for the error message of the last resort.
        folders: Folders of the user.
        seconds: Wall-clock budget in s; infinity for no limit, by default `IMPORT_S`.

    Raises:
        Overrun: A file was not imported in time; the message names the line.
        RegistryError: A skill is invalid.
        DualArmError: A file raises KeyboardInterrupt.
    """
    from bt_dualarm.core.errors import DualArmError, Interruption
    from bt_dualarm.runtime.interruption import StopRequest, Watchdog
    from bt_dualarm.skill.registry import Registry, is_shipped_only

    _spare_modules()
    if is_shipped_only(folders):
        return Registry.load()
    stop = StopRequest()
    watchdog = Watchdog(
        IMPORT_S if seconds is None else seconds, stop, owner="the import of skills"
    )
    last_resort = ProcessEnd(program, stop)
    with last_resort as watchdog.last_resort, closing(watchdog), watchdog.awake(), exit_refused():
        try:
            with watchdog:
                return Registry.load(folders)
        except (KeyboardInterrupt, Interruption) as error:
            if early:  # a signal was received
                raise
            raise DualArmError(" ".join(error.__notes__)) from error
