"""Where an arm is out of the way of others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bt_dualarm.motion.collision.checker import CollisionChecker
from bt_dualarm.pose import Vector
from bt_dualarm.world.robots.robot import JointLimits

_SAMPLES = 60
_CHOICES = 3
_TURN_COST = 0.05  # metres of distance that a turn of one radian must be worth


def places_out_of_the_way(
    checker: CollisionChecker,
    others: Sequence[Vector],
    postures: Sequence[Vector],
    limits: JointLimits,
    rng: np.random.Generator,
) -> list[Vector]:
    """Configurations in which the arm is far from other arms' bases, the best one first.

    What others want to reach is not known, but they reach for it from there.

    Args:
        checker: Arm in its world.
        others: Positions of the other arms' bases, of shape (3,) each, m.
        postures: Configurations of shape (dof,), rad, that are worth a try.
        limits: Limits of the arm's positions.
        rng: Generator that draws others.

    Returns:
        At most three, each of shape (dof,), free of collisions; none if none was found.
    """
    lower, upper = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
    drawn = rng.uniform(lower, upper, (_SAMPLES, len(lower)))
    # The wrist hardly matters, but turning it takes time.
    drawn[:, 4:] = checker.present[4:]
    worth: list[tuple[float, Vector]] = []
    for q in (*postures, *drawn):
        if checker.free(q):
            turn = float(np.abs(q - checker.present).max())
            worth.append((_distance(checker, others) - _TURN_COST * turn, q))
    worth.sort(key=lambda one: -one[0])
    return [q for _, q in worth[:_CHOICES]]


def _distance(checker: CollisionChecker, others: Sequence[Vector]) -> float:
    """From the arm's shapes, as the checker has placed them last, to the nearest base."""
    shapes = checker.data.geom_xpos[checker.moving]
    away = np.linalg.norm(shapes[:, None] - np.array(others), axis=2)
    return float((away - checker.model.geom_rbound[checker.moving, None]).min())
