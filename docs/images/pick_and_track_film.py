"""Make the animation of the README: the main job, recorded and exported as anybody would do it.

    .venv/bin/python docs/images/pick_and_track_film.py

The same as `bt-run pick_and_track --record out` and `bt-record export out --webp FILE`.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Final

import bt_dualarm
from bt_dualarm import cli

TARGET: Final = Path(__file__).with_name("pick_and_track.webp")


def main() -> int:
    """Record and export; returns the exit code."""
    with tempfile.TemporaryDirectory() as folder:
        bt_dualarm.run("pick_and_track", record=folder)
        return cli.record(["export", folder, "--webp", str(TARGET)])


if __name__ == "__main__":
    sys.exit(main())
