"""What a camera draws with: one interface, two renderers, and which of them this machine has.

OpenGL is used where it works. The ray caster needs no system library and looks the same to a
colour filter, so that nothing else in the product has to know which of the two is at work.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.errors import RendererError

Image: TypeAlias = npt.NDArray[np.uint8]
"""Red, green, blue, of shape (height, width, 3)."""

Region: TypeAlias = tuple[int, int, int, int]
"""Part of an image in pixels: left, top, right, bottom; right and bottom are outside."""

RendererKind: TypeAlias = Literal["auto", "gl", "ray"]

LOOP_GROUPS = (0, 1, 3)
"""Geom groups that the camera in the loop sees: scene, objects, low-polygon shapes of the arms."""

PICTURE_GROUPS = (0, 1, 2)
"""Geom groups for people to look at: scene, objects, full visual meshes of the arms."""

GL_PACKAGES = "libegl1 and libgl1 (or libosmesa6)"


class Renderer(Protocol):
    """Draws what a camera of the model sees."""

    @property
    def name(self) -> str:
        """``"gl"`` or ``"ray"``."""

    def render(
        self,
        model: Any,
        data: Any,
        camera_id: int,
        width: int,
        height: int,
        region: Region | None = None,
        *,
        groups: Sequence[int] = LOOP_GROUPS,
        stride: int = 1,
    ) -> Image:
        """The image, of shape (height, width, 3), black outside ``region``.

        Needs kinematics and camera poses of ``data`` to be up to date (``mj_kinematics``,
        ``mj_camlight``). A ``stride`` above 1 allows blocks of so many pixels to share a colour.
        """

    def close(self) -> None:
        """Give back what the renderer holds; harmless when repeated."""


class RendererChoice(NamedTuple):
    """How to make the renderer, and one sentence for the user on which one it is."""

    create: Callable[[], Renderer]
    message: str


def choose_renderer(
    kind: RendererKind = "auto", find_context: Callable[[], Any] | None = None
) -> RendererChoice:
    """Choose the renderer for this machine.

    Args:
        kind: ``"gl"`` insists on OpenGL, ``"ray"`` never touches it, ``"auto"`` takes OpenGL
            where it works.
        find_context: Opens an off-screen context, or raises RendererError; for tests that play a
            machine without OpenGL.

    Raises:
        RendererError: OpenGL was asked for and does not work here, or the kind is unknown.
    """
    if kind not in ("auto", "gl", "ray"):
        raise RendererError(f"no renderer {kind!r}; there are 'auto', 'gl' and 'ray'")
    if kind == "ray":
        return _ray("Camera images are made by ray casting, as asked.")
    from bt_dualarm.world import gl_context

    try:
        context = (find_context or gl_context.open_context)()
    except RendererError as error:
        advice = f"On Debian or Ubuntu the packages {GL_PACKAGES} bring OpenGL without a screen."
        if kind == "gl":
            raise RendererError(
                f"OpenGL does not work on this machine: {error}. {advice}"
            ) from None
        return _ray(
            f"Camera images are made by ray casting, because OpenGL is missing ({error}). "
            f"Everything works without it. {advice}"
        )
    return _gl(context)


def clip_region(region: Region | None, width: int, height: int) -> Region:
    """The part of ``region`` inside the image; the whole image for ``None``; may be empty."""
    if region is None:
        return 0, 0, width, height
    left, top = min(max(region[0], 0), width), min(max(region[1], 0), height)
    return left, top, max(left, min(region[2], width)), max(top, min(region[3], height))


def blocks_of(start: int, stop: int, stride: int) -> slice:
    """Indices of the blocks of ``stride`` pixels that cover the pixels from start to stop."""
    return slice(start // stride, -(-stop // stride))


def fill(image: Image, region: Region, blocks: Image, stride: int) -> None:
    """Paint the region of an image with the blocks that ``blocks_of`` counts for it."""
    left, top, right, bottom = region
    if stride > 1:
        blocks = blocks.repeat(stride, axis=0).repeat(stride, axis=1)
    y, x = top % stride, left % stride
    image[top:bottom, left:right] = blocks[y : y + bottom - top, x : x + right - left]


def _ray(message: str) -> RendererChoice:
    from bt_dualarm.world.render_ray import RayRenderer

    return RendererChoice(RayRenderer, message)


def _gl(context: Any) -> RendererChoice:
    from bt_dualarm.world.render_gl import GlRenderer

    return RendererChoice(
        lambda: GlRenderer(context), f"Camera images are drawn by OpenGL ({context.platform})."
    )
