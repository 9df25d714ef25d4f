"""Renews requirements.lock: every version of constraints.txt, with the hashes of its wheels.

    python docs/lock.py

pip is asked, for each Python that the project runs on, which wheel it would install on this kind of
machine (Linux, x86-64); nothing is installed.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parent.parent
LOCK: Final = ROOT / "requirements.lock"

_PYTHONS: Final = ("3.11", "3.12", "3.13")
_HEAD: Final = """\
# What `make setup` installs, with the hashes of the wheels for Python 3.11 to 3.13 on Linux x86-64.
# Made by `make constraints`, which runs docs/lock.py, from constraints.txt.
"""


def wheels(python: str, requirements: Path) -> dict[str, str]:
    """SHA-256 in hexadecimal of the wheel of each pinned version, for one Python.

    Args:
        python: Version of Python, such as ``3.12``.
        requirements: File with one pinned version a line.

    Raises:
        subprocess.CalledProcessError: There is no wheel of one of them.
    """
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        options = ["--dry-run", "--ignore-installed", "--no-deps", "--only-binary", ":all:"]
        options += ["--python-version", python, "--implementation", "cp", "--target", folder]
        options += ["--report", str(report), "--requirement", str(requirements)]
        command = [sys.executable, "-m", "pip", "install", "--quiet", *options]
        subprocess.run(command, check=True)  # noqa: S603 - pip, by its own interpreter
        found = json.loads(report.read_text(encoding="utf-8"))["install"]
    return {
        f"{one['metadata']['name']}=={one['metadata']['version']}": one["download_info"][
            "archive_info"
        ]["hashes"]["sha256"]
        for one in found
    }


def locked(found: list[dict[str, str]]) -> str:
    """The text of the lock.

    Args:
        found: Hashes by pinned version, for each Python.
    """
    lines = [_HEAD]
    for pin in sorted({pin for hashes in found for pin in hashes}, key=str.lower):
        of_pin = sorted({hashes[pin] for hashes in found if pin in hashes})
        lines.append(" \\\n    ".join([pin, *(f"--hash=sha256:{one}" for one in of_pin)]) + "\n")
    return "".join(lines)


def main(requirements: Path = ROOT / "constraints.txt", lock: Path = LOCK) -> None:
    """Write the lock of pinned versions."""
    found = [wheels(python, requirements) for python in _PYTHONS]
    lock.write_text(locked(found), encoding="utf-8")


if __name__ == "__main__":
    main()
