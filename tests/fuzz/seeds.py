"""Seeds of mutations: the same each time, or others for a longer run."""

from __future__ import annotations

import os
import random

SEED = int(os.environ.get("BT_DUALARM_FUZZ_SEED", "0"))
"""Of all mutations together; a longer run sets the variable to another one."""


def dice_of(chunk: int) -> random.Random:
    """Dice of a worker's share of the mutations."""
    return random.Random(1000 * SEED + chunk)  # noqa: S311 - no secret
