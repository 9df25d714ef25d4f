"""A frame whose picture is put together when somebody looks at it, as it was at the exposure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property

import mujoco
import numpy as np

from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.world.cameras.frame import Frame
from bt_dualarm.world.rendering.renderer import Image, enter_blocks

_KNOWN = tuple(field for field in fields(Frame) if field.name != "image")


class UndrawnFrame(Frame):
    """As `Frame`; what was exposed is drawn once, and not at all where nobody asks for it.

    Args:
        size: Width and height of the whole image in pixels.
        draw: Function that draws the blocks that were exposed, of shape (rows, columns, 3).
        known: All other attributes of a frame, in their order.
    """

    def __init__(self, size: tuple[int, int], draw: Callable[[], Image], *known: object) -> None:
        own = vars(self)
        own["_size"], own["_draw"] = size, draw
        for number, field in enumerate(_KNOWN):
            own[field.name] = known[number] if number < len(known) else field.default

    @classmethod
    def of(cls, frame: Frame, draw: Callable[[], Image], **changed: object) -> UndrawnFrame:
        """One as another frame is, of another picture."""
        known = {**vars(frame), **changed}
        return cls((frame.width, frame.height), draw, *(known[field.name] for field in _KNOWN))

    def posed(self, pose: Pose) -> Frame:
        """The same picture, by a camera that is believed to have been elsewhere."""
        return UndrawnFrame.of(self, lambda: self.blocks, pose=pose)

    @cached_property
    def blocks(self) -> Image:
        """Colours of the blocks of what was exposed, of shape (rows, columns, 3)."""
        draw: Callable[[], Image] = vars(self)["_draw"]
        return draw()

    @cached_property
    def image(self) -> Image:
        """Red, green, blue, of shape (height, width, 3), black outside ``region``."""
        image: Image = np.zeros((self.height, self.width, 3), np.uint8)
        if self.blocks.size:
            enter_blocks(image, self.region, self.stride, self.blocks)
        return image

    @property
    def width(self) -> int:
        """Width of the whole image in pixels."""
        return int(vars(self)["_size"][0])

    @property
    def height(self) -> int:
        """Height of the whole image in pixels."""
        return int(vars(self)["_size"][1])


@dataclass(frozen=True, eq=False)
class Scenery:
    """All that a picture hangs on, at one moment: copies, for who draws it later.

    Attributes:
        model: Compiled world, which nobody changes.
        qpos: Positions in MuJoCo's order, of shape (nq,).
        qvel: Velocities in MuJoCo's order, of shape (nv,).
        mocap_pos: Places of bodies that are moved from outside, of shape (nmocap, 3), m.
        mocap_quat: Their turns, of shape (nmocap, 4).
        cvel: Velocities of bodies, of shape (nbody, 6).
        subtree_com: Centres of mass that these are about, of shape (nbody, 3), m.
    """

    model: mujoco.MjModel
    qpos: Vector
    qvel: Vector
    mocap_pos: Matrix
    mocap_quat: Matrix
    cvel: Matrix
    subtree_com: Matrix

    @classmethod
    def of(cls, model: mujoco.MjModel, data: mujoco.MjData) -> Scenery:
        """The world as it is now."""
        names = [field.name for field in fields(cls) if field.name != "model"]
        return cls(model, *(getattr(data, name).copy() for name in names))

    def data(self) -> mujoco.MjData:
        """A state of its own, its kinematics up to date."""
        data = mujoco.MjData(self.model)
        for field in fields(self):
            if field.name != "model":
                getattr(data, field.name)[:] = getattr(self, field.name)
        cvel, subtree_com = data.cvel.copy(), data.subtree_com.copy()
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_camlight(self.model, data)
        data.cvel[:], data.subtree_com[:] = cvel, subtree_com
        return data
