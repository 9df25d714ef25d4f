"""Where an arm lies in the arrays of the plant, and its joints among those of all arms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import accumulate, pairwise
from typing import Protocol

import mujoco
import numpy as np
import numpy.typing as npt


class PlantArm(Protocol):
    """Where an arm lies in the arrays of the plant."""

    @property
    def model(self) -> mujoco.MjModel:
        """The plant."""

    @property
    def data(self) -> mujoco.MjData:
        """State of the plant."""

    @property
    def qpos_ids(self) -> npt.NDArray[np.int64]:
        """Addresses of the joints' positions, base to tip, of shape (dof,)."""

    @property
    def dof_ids(self) -> npt.NDArray[np.int64]:
        """Addresses of the joints' velocities, likewise."""

    @property
    def actuator_ids(self) -> npt.NDArray[np.int64]:
        """Addresses of the motors' torques, likewise."""


def parts_of(dofs: Mapping[str, int]) -> dict[str, slice]:
    """Which joints are whose where those of all arms lie side by side.

    Args:
        dofs: Number of joints of each arm, by name.
    """
    ends = accumulate(dofs.values(), initial=0)
    return {name: slice(*part) for name, part in zip(dofs, pairwise(ends), strict=True)}


def count_of(parts: Mapping[str, slice]) -> int:
    """Joints of all arms together."""
    return max((part.stop for part in parts.values()), default=0)


def joints_of(
    arms: Mapping[str, PlantArm],
    parts: Mapping[str, slice],
    *addresses: Callable[[PlantArm], npt.NDArray[np.int64]],
) -> npt.NDArray[np.int64]:
    """Joints of some arms: which they are among those of all, and where they lie in the plant.

    Args:
        arms: Arms of the plant, by name.
        parts: Which joints are whose among those of all arms.
        addresses: What is asked of where an arm lies.

    Returns:
        A row a joint, of shape (k, 1 + len(addresses)).
    """
    rows = [
        np.stack((np.arange(parts[name].start, parts[name].stop), *(of(arm) for of in addresses)))
        for name, arm in arms.items()
    ]
    none = np.zeros((1 + len(addresses), 0), dtype=np.int64)
    return np.ascontiguousarray(np.concatenate((none, *rows), axis=1).T, dtype=np.int64)
