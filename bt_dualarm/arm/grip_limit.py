"""The pace at which a gripper's friction holds on to what is carried."""

from __future__ import annotations

from typing import Final

import numpy as np

from bt_dualarm.arm.measured_gripper import cup_measures, jaw_measures
from bt_dualarm.motion.grasping.holding_force import SHAKEN_WAYS, pinching_forces, suction_forces
from bt_dualarm.motion.setpoints.time_scaling import at_scale
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.attachments import Attachment
from bt_dualarm.world.grippers.gripper import Gripper
from bt_dualarm.world.nominal.nominal_load import NominalLoad
from bt_dualarm.world.world import World

IN_HAND: Final = 1.2
"""Factor by which the grip has to be firmer than what a motion asks of it."""

SLOWEST: Final = 0.1
"""Least time scale to which a grip slows a motion."""

UNKNOWN_KG: Final = 1.0
"""Mass in kg that is reckoned with where nobody knows it yet."""

_GRAVITY: Final = np.array([0.0, 0.0, -9.81])
_LOOK_S: Final = 0.012  # between looks, over which the tool's acceleration is differenced
_LEVER_M: Final = 0.005  # of a pad's friction about its normal
_HALVINGS: Final = 8


def grip_pace(motion: Trajectory, world: World, arm: str) -> float:
    """Largest even time scale of a motion, up to 1, at which friction holds what fingers carry.

    What the grip has to bear is the mass times gravity less the acceleration of its centre, which
    grows with the square of the scale; pads and cup bear it as `pinching_forces` and
    `suction_forces` say.

    Args:
        motion: Motion from rest to rest.
        world: World that the arm is in.
        arm: Name of the arm; with its gripper it holds something, or not.
    """
    held = world.attachments.gripped_by(arm)
    paces = [_pace(motion, world, one, load) for one in held for load in _loads(world, one)]
    return min(paces, default=1.0)


def force_for(world: World, held: Attachment, load: NominalLoad, shake: float) -> float:
    """Force that holds what was weighed as the tool is turned now, with some in hand, N.

    Args:
        world: World that the arm is in.
        held: What is held by whom.
        load: The same as the arm has weighed it: of its mass as much as it may well be.
        shake: Acceleration that it is to bear in any direction, m/s².

    Returns:
        Force of each pad, or of a cup; 0 where no mass is known, infinite where none holds it.
    """
    if load.mass is None:
        return 0.0
    nominal = world.nominal[held.arm]
    turn = nominal.tool_link_pose_at(world.hardware[held.arm].q).rotation_matrix
    mass = load.mass + load.mass_doubt
    ways = shake * SHAKEN_WAYS
    return _Grip(world, held, load).needs(mass, np.broadcast_to(turn, (len(ways), 3, 3)), ways)


def least_force(page: Gripper, friction: float, load: NominalLoad) -> float:
    """Least force of each pad, or of a cup, that holds a load at rest, with some in hand, N.

    Its mass counts alone: where its centre is, nobody knows well who has weighed it.

    Args:
        page: Page of the gripper.
        friction: Coefficient of friction.
        load: What is held; 0 is the answer where no mass is known.
    """
    weight = -_GRAVITY[2] * (load.mass or 0.0)
    share = 2.0 * friction if page.fingers else 1.0
    return float(IN_HAND * weight / max(share, 1e-9))


def at_pace(motion: Trajectory, pace: float) -> Trajectory:
    """The motion at an even time scale, itself at a scale of 1."""
    return motion if pace >= 1.0 else at_scale(motion, pace)


def _loads(world: World, held: Attachment) -> list[NominalLoad]:
    """What the arm reckons with of something that it holds."""
    return [load for load in world.nominal[held.arm].loads if load.object == held.object]


def _pace(motion: Trajectory, world: World, held: Attachment, load: NominalLoad) -> float:
    mass = UNKNOWN_KG if load.mass is None else load.mass + load.mass_doubt
    moved, turns = _accelerations(motion, world, held.arm, load)
    least, most = SLOWEST, 1.0
    grip = _Grip(world, held, load)
    if grip.bears(mass, turns, moved):
        return 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (least + most)
        if grip.bears(mass, turns, middle**2 * moved):
            least = middle
        else:
            most = middle
    return least


def _accelerations(
    motion: Trajectory, world: World, arm: str, load: NominalLoad
) -> tuple[Matrix, np.ndarray]:
    """Accelerations of the load's centre in the world, (n, 3), m/s²; the link's axes, (n, 3, 3)."""
    nominal, stride = world.nominal[arm], max(1, round(_LOOK_S / motion.dt))
    count = max(2, (len(motion) - 1) // stride + 1)
    rows = np.minimum(np.arange(-1, count + 1) * stride, len(motion) - 1).clip(0)
    places, turns = nominal.tool_link_frames_at(motion.rows(rows)[0])
    moved = np.diff(places + turns @ load.pose.position, 2, axis=0) / (stride * motion.dt) ** 2
    return moved, turns[1:-1]


class _Grip:
    """What a gripper holds, as it was told to hold it.

    Args:
        world: World that the arm is in.
        held: What is held by whom.
        load: Mass and centre of it.
    """

    def __init__(self, world: World, held: Attachment, load: NominalLoad) -> None:
        hardware = world.grippers[held.arm]
        page, thing = hardware.gripper, world.objects[held.object]
        self._tool = world.robots[held.arm].tool
        self._force = hardware.commanded.force
        self._offset = (self._tool.inverse @ load.pose).position
        self._width = hardware.width
        self._cup = None if page.fingers else cup_measures(page, thing.friction)
        self._friction = max(page.friction, thing.friction)
        if page.fingers:
            jaw = jaw_measures(page, thing.friction)
            self._offset = self._offset - np.array((0.0, 0.0, jaw.pad_center))

    def bears(self, mass: float, turns: np.ndarray, moved: Matrix) -> bool:
        """Whether it holds a mass in kg that is moved so, with some force in hand.

        Args:
            mass: Mass in kg.
            turns: Axes of the tool's link in the world at each look, of shape (n, 3, 3).
            moved: Accelerations of its centre in the world then, of shape (n, 3), m/s².
        """
        return self.needs(mass, turns, moved) <= self._force

    def needs(self, mass: float, turns: np.ndarray, moved: Matrix) -> float:
        """Force in N that holds it, with some in hand; arguments as of `bears`."""
        in_link = np.einsum("nij,ni->nj", turns, mass * (_GRAVITY - moved))
        forces = in_link @ self._tool.rotation_matrix
        return float((IN_HAND * self._needed(forces)).max())

    def _needed(self, forces: Matrix) -> Vector:
        if self._cup is not None:
            return suction_forces(forces, self._offset, np.array((0.0, 0.0, -1.0)), self._cup)
        closing = np.array((0.0, 1.0, 0.0))
        return pinching_forces(forces, self._offset, closing, self._width, _LEVER_M, self._friction)
