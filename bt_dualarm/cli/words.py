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
