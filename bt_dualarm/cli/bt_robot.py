"""``bt-robot``: writes a first robot description from a URDF, to be edited."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bt_dualarm.cli.entry import SUCCEEDED, given_path
from bt_dualarm.core.errors import DualArmError

if TYPE_CHECKING:
    from bt_dualarm.robots.urdf import KinematicTree


_EPILOG = """\
examples:
  bt-robot my_arm.urdf                                   list the chains that could be arms
  bt-robot my_arm.urdf --base base_link --tool flange --out my_arm.yaml
  bt-robot tiago_description/robots/tiago.urdf --base torso_lift_link --tool arm_tool_link
                                                         a URDF of example-robot-data

Values that the URDF lacks are guessed, with a comment beside each. Then:
  bt-skills my_arm.yaml            shows the description: joints, postures, reach
  robot: my_arm.yaml               uses it in a tree file

exit code:
  0 the chains or a description were written   2 the URDF or the command line is invalid
"""


def main(argv: Sequence[str] | None) -> int:
    """Write a first description of an arm; returns the exit code."""
    return _robot(_command_line().parse_args(argv))


def _command_line() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="bt-robot",
        description="Write a first robot description from a URDF: joints, limits, a home posture.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("urdf", metavar="URDF", help="a file, or one of example-robot-data")
    parser.add_argument("--base", metavar="LINK", help="the fixed link")
    parser.add_argument("--tool", metavar="LINK", help="the link that carries the tool")
    parser.add_argument(
        "--out",
        metavar="FILE",
        type=given_path,
        help="the description file (default: the terminal)",
    )
    return parser


def _robot(arguments: argparse.Namespace) -> int:
    from bt_dualarm.robots.robot import find_urdf
    from bt_dualarm.robots.urdf import read_urdf

    folder = (arguments.out.parent if arguments.out else Path()).resolve()
    urdf = find_urdf(arguments.urdf, folder)
    tree = read_urdf(urdf.path)
    if arguments.base is None or arguments.tool is None:
        return _list(arguments, tree)
    _refuse_unknown(tree, arguments)
    from bt_dualarm.robots.description_template import template_of, template_text

    draft = template_of(urdf.path, folder, arguments.base, arguments.tool)
    text = template_text(draft, urdf.path.stem, urdf.name, urdf.srdf)
    if arguments.out is None:
        sys.stdout.write(text)
        return SUCCEEDED
    _write(arguments.out, text)
    return SUCCEEDED


def _list(arguments: argparse.Namespace, tree: KinematicTree) -> int:
    """The chains that could be arms, most likely ones first."""
    from bt_dualarm.robots.urdf_arm import arm_chains
    from bt_dualarm.spec.node_types import counted

    chains = arm_chains(tree)
    if not chains:
        raise DualArmError(f"{arguments.urdf}: it has no chain of two revolute joints")
    print(f"{arguments.urdf}: root link {tree.root}; chains that could be arms:")
    for chain in chains:
        print(f"\n  --base {chain.base} --tool {chain.tool}")
        print(f"    {counted(len(chain.joints), 'joint')}: {', '.join(chain.joints)}")
    print(f"\nThe whole robot stands on --base {tree.root}; any link between can also be the base.")
    return SUCCEEDED


def _refuse_unknown(tree: KinematicTree, arguments: argparse.Namespace) -> None:
    from bt_dualarm.spec.problems import suggestion

    for option, link in (("--base", arguments.base), ("--tool", arguments.tool)):
        if link not in tree.links:
            hint = suggestion(link, tree.links, "link")
            raise DualArmError(f"{option} {link}: {arguments.urdf} has no such link; {hint}")


def _write(target: Path, text: str) -> None:
    """Write the description, and load it as a run would."""
    from bt_dualarm.core.share import kind_at, write_text
    from bt_dualarm.robots.robot import is_description_path
    from bt_dualarm.robots.robot_description import load_robot

    if not is_description_path(target.name):
        raise DualArmError(f"--out {target}: the name of a description ends with .yaml")
    if kind_at(target):
        raise DualArmError(f"--out {target}: already exists; remove it, or choose another name")
    try:
        write_text(target, text)
    except OSError as error:
        raise DualArmError(f"cannot write {target}: {error.strerror or error}") from error
    load_robot(target.name, target.parent)
    print(f"written: {target}")
