"""Which renderer this machine has.

The ray caster needs no system library, and its pictures are the same everywhere: it is what files
have that do not say otherwise. OpenGL, for those who ask for it, looks the same to a colour filter,
so that nothing else in the product has to know which of the two is at work.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, get_args

from bt_dualarm.errors import RendererError
from bt_dualarm.world.rendering.gl_context import GlContext, open_context
from bt_dualarm.world.rendering.opengl import GlRenderer
from bt_dualarm.world.rendering.raycast import RayRenderer
from bt_dualarm.world.rendering.renderer import Renderer, RendererKind

GL_PACKAGES = "libegl1 and libgl1 (or libosmesa6)"
"""Packages of Debian and Ubuntu that bring OpenGL without a screen."""


class RendererChoice(NamedTuple):
    """How to make the renderer, and one sentence for the user on which one it is."""

    create: Callable[[], Renderer]
    message: str


def choose_renderer(
    kind: RendererKind = "ray", find_context: Callable[[], GlContext] = open_context
) -> RendererChoice:
    """Choose the renderer for this machine.

    Args:
        kind: ``"gl"`` insists on OpenGL, ``"ray"`` never touches it, ``"auto"`` takes OpenGL
            where it works.
        find_context: Opener of an off-screen context, raises RendererError; for tests that play
            a machine without OpenGL.

    Raises:
        RendererError: OpenGL was asked for and does not work here, or the kind is unknown.
    """
    if kind not in get_args(RendererKind):
        raise RendererError(f"no renderer {kind!r}; there are 'auto', 'gl' and 'ray'")
    if kind == "ray":
        return RendererChoice(
            RayRenderer, "Camera images are made by ray casting, as on every machine."
        )
    try:
        context = find_context()
    except RendererError as error:
        advice = f"On Debian or Ubuntu the packages {GL_PACKAGES} bring OpenGL without a screen."
        if kind == "gl":
            raise RendererError(
                f"OpenGL does not work on this machine: {error}. {advice}"
            ) from None
        return RendererChoice(
            RayRenderer,
            f"Camera images are made by ray casting, because OpenGL is missing ({error}). "
            f"Everything works without it. {advice}",
        )
    return RendererChoice(
        lambda: GlRenderer(context), f"Camera images are drawn by OpenGL ({context.platform})."
    )
