"""The commands: the only place that reads arguments, prints, and decides an exit code."""

from bt_dualarm.cli.bt_check import check
from bt_dualarm.cli.bt_run import run
from bt_dualarm.cli.bt_skills import skills
from bt_dualarm.cli.bt_tune_color import tune_color

__all__ = ["check", "run", "skills", "tune_color"]
