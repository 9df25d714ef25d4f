"""Seeds of mutations: the same each time, or different ones for a longer run."""

from __future__ import annotations

import os
import random

SEED = int(os.environ.get("BT_DUALARM_FUZZ_SEED", "0"))
"""Seed of all mutations together; a longer run sets the environment variable."""


def dice_of(chunk: int) -> random.Random:
    """Random generator of one chunk of the mutations."""
    return random.Random(1000 * SEED + chunk)  # noqa: S311 - no secret
