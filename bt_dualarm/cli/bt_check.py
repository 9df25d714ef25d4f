"""``bt-check``: reports all errors and warnings of tree files without running them."""

from __future__ import annotations

import argparse
import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bt_dualarm.cli.entry import (
    FAILED,
    SUCCEEDED,
    add_params,
    add_skills,
    given_path,
    imported_skills,
)
from bt_dualarm.core.errors import DualArmError

if TYPE_CHECKING:
    from rich.text import Text

    from bt_dualarm.spec.document import TreeFile
    from bt_dualarm.spec.node_types import NodeType
    from bt_dualarm.spec.problems import Problem


_EPILOG = """\
examples:
  bt-check my_tree.yaml            every error and warning, with its location
  bt-check trees/*.yaml --json     machine-readable output
  bt-check my_tree.yaml --graph my_tree.mmd

exit code:
  0 no errors (possibly warnings)   1 a file has errors
  2 invalid command line, or a file does not exist (the others are checked)
  154 a skill file could not be imported within 30 s
"""


def main(argv: Sequence[str] | None) -> int:
    """Check tree files; returns the exit code.

    Raises:
        NoSuchTree: Some files do not exist; all others are checked before.
    """
    return _check(_command_line().parse_args(argv))


def _command_line() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="bt-check",
        description="Check tree files as bt-run does, and report all problems.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "files", metavar="FILE", nargs="+", help="a tree file, or the name of a shipped tree"
    )
    parser.add_argument(
        "--graph",
        metavar="OUT",
        type=given_path,
        help="write a diagram of the trees to OUT.dot (Graphviz) or OUT.mmd (Mermaid)",
    )
    parser.add_argument("--json", action="store_true", help="print the problems as a JSON array")
    add_skills(parser)
    add_params(parser)
    return parser


def _check(arguments: argparse.Namespace) -> int:
    from bt_dualarm.runtime.file_check import check as check_file
    from bt_dualarm.runtime.options import NoSuchTree, find_tree
    from bt_dualarm.spec.problems import errors

    _refuse_graph(arguments)
    paths: list[Path] = []
    missing: list[str] = []
    for given in arguments.files:
        try:
            paths.append(find_tree(given))
        except NoSuchTree as error:
            missing.append(str(error))
    if not paths:
        raise NoSuchTree("\n".join(missing))
    kinds = imported_skills("bt-check", arguments.skills).kinds
    params = dict(arguments.param)
    checked = [check_file(path, kinds, params) for path in paths]
    found = [(path, one.problems) for path, one in zip(paths, checked, strict=True)]
    problems = [problem for _, some in found for problem in some]
    if arguments.graph is not None and checked[0].file is not None:
        _draw(checked[0].file, kinds, arguments.graph)
        if not arguments.json:
            print(f"written: {arguments.graph}")
    if arguments.json:
        print(json.dumps([problem.as_dict() for problem in problems], indent=2))
    else:
        _print(found)
    if missing:
        raise NoSuchTree("\n".join(missing))
    return FAILED if errors(problems) else SUCCEEDED


def _refuse_graph(arguments: argparse.Namespace) -> None:
    """Check the arguments of ``--graph``.

    Raises:
        DualArmError: The format is unknown, or there are several files.
    """
    from bt_dualarm.behaviors.graph import FORMATS

    target: Path | None = arguments.graph
    if target is None:
        return
    if target.suffix.removeprefix(".") not in FORMATS:
        endings = ", ".join(f".{name}" for name in FORMATS)
        source = shlex.quote(str(target.with_suffix(".dot")))
        hint = f"to get an image, use Graphviz: dot -Tsvg -O {source}"
        message = f"--graph {target}: the file name must end with one of {endings}"
        raise DualArmError(f"{message}\n  = {hint}")
    if len(arguments.files) > 1:
        raise DualArmError("--graph takes a single tree file")


def _draw(file: TreeFile, kinds: Mapping[str, NodeType], target: Path) -> None:
    """Write the graph atomically.

    Raises:
        DualArmError: The file cannot be written.
    """
    from bt_dualarm.behaviors.graph import FORMATS, items
    from bt_dualarm.core.share import write_text

    draw = FORMATS[target.suffix.removeprefix(".")]
    try:
        write_text(target, draw(items(file, kinds)))
    except OSError as error:
        raise DualArmError(f"cannot write {target}: {error.strerror or error}") from error


def _print(found: Sequence[tuple[Path, Sequence[Problem]]]) -> None:
    """Print problems, colored in a terminal, and a summary line per file."""
    from rich.console import Console
    from rich.text import Text

    from bt_dualarm.spec.problems import errors

    console = Console(highlight=False, soft_wrap=True)
    for path, problems in found:
        for problem in problems:
            console.print(_colored(Text(str(problem)), problem.severity))
        wrong = len(errors(problems))
        words = (_count(wrong, "error"), _count(len(problems) - wrong, "warning"))
        verdict = ", ".join(word for word in words if word) or "fine"
        console.print(Text.assemble((f"{path}: ", "bold"), verdict))


def _colored(text: Text, severity: str) -> Text:
    """Color the severity, the underlining and the hint."""
    color = "red" if severity == "error" else "yellow"
    text.highlight_regex(rf"(?<=: ){severity}(?=: )", f"bold {color}")
    text.highlight_regex(r"(?m)^ +\| +\^+$", color)
    text.highlight_regex(r"(?m)^ += .*$", "cyan")
    return text


def _count(number: int, noun: str) -> str:
    if not number:
        return ""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
