"""Arguments that commands have in common."""

from __future__ import annotations

import argparse
from pathlib import Path


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


def add_view(parser: argparse.ArgumentParser) -> None:
    """``--view-port N`` and ``--view-host ADDRESS``."""
    add = parser.add_argument
    add("--view-port", metavar="N", type=_port, default=0, help="port of the page (default: any)")
    add(
        "--view-host",
        metavar="ADDRESS",
        default="127.0.0.1",
        help="IPv4 address of another interface of this machine to serve the page on; whoever "
        "knows the page's address can then press its buttons (default: 127.0.0.1)",
    )


def _port(text: str) -> int:
    if not text.isascii() or not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is not a port from 0 to 65535")
    return int(text)
