"""What the benchmarks of grippers are told on the command line."""

from __future__ import annotations

import argparse


def grip_parser(doc: str | None, runs: int) -> argparse.ArgumentParser:
    """A parser that knows runs, seed, robot, gripper and reality.

    Args:
        doc: Docstring of the benchmark; its first line describes it.
        runs: How many runs there are unless told.
    """
    parser = argparse.ArgumentParser(description=(doc or "").partition("\n")[0])
    parser.add_argument("--runs", type=int, default=runs)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--robot", default="ur5")
    parser.add_argument("--gripper", default="robotiq_2f85")
    parser.add_argument("--reality", default="lab")
    return parser
