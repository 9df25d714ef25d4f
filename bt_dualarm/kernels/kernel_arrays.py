"""What the kernels of splines read."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Stack: TypeAlias = npt.NDArray[np.float64]
"""Matrices, one behind the other."""
