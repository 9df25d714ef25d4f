"""What the commands have in common: exit codes, complaints, arguments."""

from __future__ import annotations

import argparse
import importlib.util
import os
import sys
from pathlib import Path
from typing import Final

from bt_dualarm.errors import DualArmError

SUCCEEDED: Final = 0
FAILED: Final = 1
UNUSABLE: Final = 2


def complain(program: str, error: DualArmError) -> None:
    """Errors that name their place say it all; the others say who is talking."""
    from bt_dualarm.spec.problems import SpecError

    prefix = "" if isinstance(error, SpecError) else f"{program}: error: "
    print(f"{prefix}{error}", file=sys.stderr)


def prepare_imports() -> None:
    """Before numpy and mujoco are imported: settings of what they import.

    One thread for numpy's sums: they depend on how many threads there are, and on matrices of 7 by
    7 threads only wait for each other. And the GLFW that came with its package, without a search:
    that asks every library that it finds for its version, in processes of their own.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    display = "wayland" if os.environ.get("XDG_SESSION_TYPE") == "wayland" else "x11"
    package = importlib.util.find_spec("glfw")
    for folder in (package and package.submodule_search_locations) or ():
        library = Path(folder, display, "libglfw.so")
        if library.is_file():
            os.environ.setdefault("PYGLFW_LIBRARY", str(library))


def nobody_reads() -> int:
    """Whoever read our output has gone; what Python flushes at its exit must go somewhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return FAILED


def add_skills(parser: argparse.ArgumentParser) -> None:
    """``--skills DIR``."""
    parser.add_argument(
        "--skills",
        metavar="DIR",
        type=Path,
        action="append",
        default=[],
        help="a folder with skills of your own, besides the shipped ones (may be repeated)",
    )


def add_params(parser: argparse.ArgumentParser) -> None:
    """``--param NAME=VALUE``."""
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
