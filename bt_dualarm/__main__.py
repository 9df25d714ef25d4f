"""``python -m bt_dualarm``: ``bt-run``, for environments without it on the path."""

from __future__ import annotations

import sys

from bt_dualarm.cli import run

if __name__ == "__main__":
    sys.exit(run())
