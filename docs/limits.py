"""Renew the table of limits and their sources in ``motion.md`` from the catalog."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import yaml

from bt_dualarm.core.share import share_dir

PAGE: Final = Path(__file__).with_name("motion.md")
UNITS: Final = {
    "position": "rad",
    "velocity": "rad/s",
    "acceleration": "rad/s²",
    "jerk": "rad/s³",
    "effort": "N m",
}
_TABLE = re.compile(r"(?<=<!-- limits -->\n).*?(?=<!-- end of limits -->)", re.DOTALL)


def limits_table() -> str:
    """One row for each limit that a robot's page gives; the others are the URDF's."""
    rows = ["| robot | limit | value | source |", "|---|---|---|---|"]
    for page in sorted(share_dir("assets").glob("robots/*.yaml")):
        limits = yaml.safe_load(page.read_text(encoding="utf-8"))["limits"]
        for name, entry in limits.items():
            if name == "position":
                ends = zip(entry["lower"], entry["upper"], strict=True)
                numbers = ", ".join(f"{lower} to {upper}" for lower, upper in ends)
            else:
                value = entry["value"]
                numbers = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
            rows.append(f"| `{page.stem}` | {name} | {numbers} {UNITS[name]} | {entry['source']} |")
    return "\n".join(rows) + "\n"


def renewed(text: str) -> str:
    """A page with the table as it ought to be."""
    return _TABLE.sub(limits_table().replace("\\", r"\\"), text)


def main() -> None:
    """Write the page."""
    PAGE.write_text(renewed(PAGE.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
