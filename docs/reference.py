"""Write the reference of all nodes, ``reference.md``, from what the code declares."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from bt_dualarm.behaviors.language import LANGUAGE
from bt_dualarm.core.share import share_dir
from bt_dualarm.skill.registry import Registry
from bt_dualarm.skill.skill import STANDARD_FAILURES
from bt_dualarm.spec.reference import reference_page

PAGE: Final = Path(__file__).with_suffix(".md")


def shipped_reference() -> str:
    """The reference of the shipped skills, whatever else is installed on this machine."""
    kinds = Registry.load().kinds
    shipped = {n: k for n, k in kinds.items() if Path(k.origin).parent == share_dir("skills")}
    return reference_page(LANGUAGE, shipped, STANDARD_FAILURES)


def main() -> None:
    """Write the page."""
    PAGE.write_text(shipped_reference(), encoding="utf-8")


if __name__ == "__main__":
    main()
