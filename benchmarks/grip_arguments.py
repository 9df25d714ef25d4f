"""Command line of the gripper benchmarks."""

from __future__ import annotations

import argparse
from typing import Any

from benchmarks.campaign import add_options


def grip_parser(doc: str | None, runs: int) -> argparse.ArgumentParser:
    """A parser with options for runs, seed, robot, gripper and reality.

    Args:
        doc: Docstring of the benchmark; its first line describes it.
        runs: Default number of runs.
    """
    parser = argparse.ArgumentParser(description=(doc or "").partition("\n")[0])
    parser.add_argument("--runs", type=int, default=runs)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--robot", default="ur5")
    parser.add_argument("--gripper", default="robotiq_2f85")
    parser.add_argument("--reality", default="lab")
    add_options(parser)
    return parser


def grip_cases(options: argparse.Namespace, *others: str) -> list[dict[str, Any]]:
    """Arguments of each run: its seed, robot, gripper, reality and other options."""
    settings = {name: getattr(options, name) for name in ("robot", "gripper", "reality", *others)}
    seeds = range(options.seed, options.seed + options.runs)
    return [{"seed": seed, **settings} for seed in seeds]
