"""Draw the picture of docs/objects.md: textures on boxes and round shapes.

    .venv/bin/python docs/images/textures.py

It needs no OpenGL: rays are cast, as in the loop.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from bt_dualarm.sim.frame import Image, Viewpoint
from bt_dualarm.sim.painter import StillRenderer
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ArmSpec, ObjectSpec, TreeFile, WorldSpec
from bt_dualarm.spec.node_types import NodeSpec
from bt_dualarm.spec.texture import Picture
from bt_dualarm.spec.values import PoseSpec

TARGET: Final = Path(__file__).with_suffix(".png")
SIZE: Final = (720, 260)
FINER: Final = 3
"""Pixels drawn for one of the picture, along each edge: rays have no smooth edges."""

VIEW: Final = Viewpoint(np.array((0.41, -1.15, 0.84)), np.array((0.41, -0.40, 0.435)), 17.0)
CARDBOARD: Final = (0.72, 0.52, 0.32)

THINGS: Final[tuple[dict[str, Any], ...]] = (
    {"shape": "box", "size": (0.08, 0.08, 0.08), "color": "yellow",
     "texture": {"pattern": "checker", "color": "blue"}},
    {"shape": "cylinder", "size": (0.04, 0.1), "color": "white",
     "texture": {"pattern": "stripes", "color": "red", "size": 0.01}},
    {"shape": "sphere", "size": (0.045,), "color": "green",
     "texture": {"pattern": "dots", "color": "white"}},
    {"shape": "box", "size": (0.12, 0.08, 0.07), "color": CARDBOARD,
     "texture": {"image": "label.png"}},
    {"shape": "cup", "size": (0.045, 0.08), "color": "orange",
     "texture": {"pattern": "checker", "color": "black", "size": 0.015}},
)  # fmt: skip


def label() -> Picture:
    """A white label with an inscription; its margin is transparent."""
    image = np.zeros((140, 240, 4), np.uint8)
    image[14:126, 20:220] = 255
    cv2.rectangle(image, (28, 22), (211, 117), (60, 60, 60, 255), 4)
    cv2.putText(
        image, "FRAGILE", (38, 83), cv2.FONT_HERSHEY_SIMPLEX, 1.25, (200, 30, 30, 255), 4,
        cv2.LINE_AA,
    )  # fmt: skip
    return Picture(image.shape[1], image.shape[0], image.tobytes())


def world() -> World:
    """The things in a row on a table."""
    objects = {}
    for number, fields in enumerate(THINGS):
        half = 0.5 * fields["size"][-1] if fields["shape"] != "sphere" else fields["size"][0]
        yaw = (25.0, 0.0, 20.0, -20.0, 0.0)[number]
        pose = PoseSpec(xyz=(0.17 + 0.12 * number, -0.40, 0.40 + half), rpy=(0.0, 0.0, yaw))
        obj = ObjectSpec.model_validate({**fields, "mass": 0.1, "pose": pose})
        if obj.texture is not None and obj.texture.image is not None:
            obj.texture.show(label())
        objects[f"thing{number}"] = obj
    tree = NodeSpec(kind="succeed", name="succeed", ports={})
    arm = ArmSpec(robot="ur5", base=PoseSpec(xyz=(0.0, 3.0, 0.0)), tree=tree)
    table = WorldSpec(scene="table")
    return World(TreeFile(name="textures", world=table, objects=objects, arms={"arm1": arm}))


def picture() -> Image:
    """What is drawn, of shape (height, width, 3)."""
    width, height = SIZE
    large = StillRenderer.of(world()).draw(VIEW, FINER * width, FINER * height)
    return np.asarray(cv2.resize(large, SIZE, interpolation=cv2.INTER_AREA), np.uint8)


if __name__ == "__main__":
    cv2.imwrite(str(TARGET), picture()[..., ::-1], (cv2.IMWRITE_PNG_COMPRESSION, 9))
