"""Write the table of all grippers in ``grippers.md`` from the catalog."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from bt_dualarm.robots.gripper import Gripper, gripper_names, load_gripper

PAGE: Final = Path(__file__).with_suffix(".md")
_TABLE: Final = re.compile(r"(?<=<!-- table -->\n).*?(?=<!-- end -->)", re.DOTALL)
_HEAD: Final = (
    "| gripper |  | takes hold by | stroke | force | speed | payload | mass | tool beyond |\n"
    "| --- | --- | --- | --- | --- | --- | --- | --- | --- |\n"
)


def grippers_page() -> str:
    """The whole page, its table again."""
    rows = "".join(map(_row, map(load_gripper, gripper_names())))
    return _TABLE.sub(lambda _: _HEAD + rows, PAGE.read_text(encoding="utf-8"))


def _row(gripper: Gripper) -> str:
    fingered = bool(gripper.fingers)
    speed = f"{1e3 * gripper.speed.least:g} to {1e3 * gripper.speed.most:g} mm/s"
    cells = (
        f"`{gripper.name}`",
        gripper.title,
        "two fingers" if fingered else "vacuum",
        f"{1e3 * gripper.stroke:g} mm" if fingered else "",
        f"{gripper.force.least:g} to {gripper.force.most:g} N",
        speed if fingered else "",
        f"{gripper.payload:g} kg",
        f"{gripper.mass:.3g} kg",
        f"{1e3 * (gripper.mount @ gripper.tool).position[2]:.0f} mm",
    )
    return f"| {' | '.join(cells)} |\n"


if __name__ == "__main__":
    PAGE.write_text(grippers_page(), encoding="utf-8")
