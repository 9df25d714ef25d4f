"""Which group every geom of a world is in: what a renderer shows, it chooses by group.

The numbers are MuJoCo's, 0 to 5 (``mjNGROUP``); the meaning is ours.
"""

from __future__ import annotations

from typing import Final

SCENE_GROUP: Final = 0
"""The ground, tables, pedestals."""

OBJECT_GROUP: Final = 1
"""The objects of a tree file."""

VISUAL_GROUP: Final = 2
"""Full visual meshes of the arms, for pictures only."""

COLLISION_GROUP: Final = 3
"""Low-polygon shapes of the arms, one a mesh: for cameras, and for contacts where it is convex."""

PARTS_GROUP: Final = 4
"""Convex parts of the other meshes, for contacts only: cameras see the hull around them."""

LOOP_GROUPS: Final = (SCENE_GROUP, OBJECT_GROUP, COLLISION_GROUP)
"""What the camera in the loop sees."""
