"""The size of a thing by where it stands: in one picture, what is larger may also be nearer."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from bt_dualarm.motion.collision.support import bearing_ahead, half_extents
from bt_dualarm.vision.shape_fit import SIZE_ROOM, SIZE_SIGMAS
from bt_dualarm.vision.sighted import SightedThing, SightedThings
from bt_dualarm.world.world import World

_MOST: Final = 3.0
"""Factor of the size beyond which a thing is rather taken to hang, or to stand on something that
nobody has declared: then nothing is known of its size."""

_STACK_SIGMAS: Final = 2.0
"""Standard deviations by which it may be higher, if it could stand on another one like it then."""


def other_size_standing(
    world: World, seen: SightedThings, thing: SightedThing, height: float | None
) -> float | None:
    """The size that a thing has instead of the declared one if it stands on what is below it.

    Enlarged about the camera, a thing looks the same: so much larger it is as what bears it is
    farther away, along the line of sight through the middle of its lower side, than that side
    would be at the declared size. It may as well be of that size and stand on something else.

    Args:
        world: World that is looked at now; plans know the same of it.
        seen: What took the pictures in.
        thing: One of the things in it, which lies flat.
        height: Height in the world of what it stands on, m; by default by the shapes of the world,
            but for objects of the colour that is looked for.

    Returns:
        Its size as a multiple of the declared one; None where it may be as declared, or nothing
        is known of what it stands on.
    """
    shape, fit, eye = seen.shape, thing.best, thing.views[0].camera.position
    half = float(half_extents(shape.kind, shape.size, fit.scene.rotation)[2])
    line = fit.scene.position - np.array((0.0, 0.0, half)) - eye
    away = float(np.linalg.norm(line))
    downward = float(-line[2])
    if height is None:
        alike = [name for name, one in world.objects.items() if seen.has_color(one.rgba)]
        length = bearing_ahead(world, eye, line / away, alike)
        ratio = length / away if length is not None else math.inf
    else:
        ratio = (float(eye[2]) - height) / downward if downward > 0.0 else math.inf
    if downward <= 0.0 or not 1.0 / _MOST < ratio < _MOST:
        return None
    sigma = math.sqrt(float(fit.covariance[2, 2])) / downward
    room = SIZE_SIGMAS * sigma
    if ratio > 1.0:  # at half the height of another one below it, either is as likely
        room = min(room, max(_STACK_SIGMAS * sigma, half / downward))
    return ratio if abs(ratio - 1.0) > max(room, SIZE_ROOM) else None
