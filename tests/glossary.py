"""The names that docs/metrics.md explains."""

from __future__ import annotations

import re
from pathlib import Path

METRICS = frozenset(
    re.findall(r"`(\w+)`", (Path(__file__).parent.parent / "docs" / "metrics.md").read_text())
)
