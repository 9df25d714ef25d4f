"""Rendering by OpenGL, an option, and the choice between the two renderers.

The ray caster needs no system library and makes the same images on every machine, so it is the
default. Images by OpenGL are equivalent for a color filter; nothing else in the package depends on
the choice.
"""

from __future__ import annotations

import ctypes
import importlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, Protocol, get_args

import mujoco
import numpy as np

from bt_dualarm.core.errors import RendererError
from bt_dualarm.sim.ray_renderer import RayRenderer
from bt_dualarm.sim.renderer import Blocks, Exposure, Image, Renderer, RendererKind

# Headless contexts
#
# The context is found by trying, never by setting ``MUJOCO_GL``: a wrong value breaks
# ``import mujoco`` itself, and a missing library raises errors deep inside PyOpenGL. Therefore
# ctypes looks for the libraries before MuJoCo's module is imported.


_EGL_PLATFORM_DEVICE = 0x313F
_MAX_DEVICES = 16


class OpenedContext(Protocol):
    """The common part of ``mujoco.egl.GLContext`` and ``mujoco.osmesa.GLContext``."""

    def make_current(self) -> None:
        """Make the context current in this thread."""


@dataclass(frozen=True, eq=False)
class GlContext:
    """An open context and the name of its platform."""

    platform: str
    context: OpenedContext

    def make_current(self) -> None:
        """Make the context current in this thread."""
        self.context.make_current()


def open_context(width: int = 640, height: int = 480) -> GlContext:
    """Open the first context that works: EGL, else OSMesa.

    Args:
        width: Largest image width in pixels (OSMesa only).
        height: Largest image height in pixels (OSMesa only).

    Raises:
        RendererError: Neither works; the message says why, for each.
    """
    reasons = []
    for platform, module, probe in (
        ("EGL", "mujoco.egl", probe_egl),
        ("OSMesa", "mujoco.osmesa", probe_osmesa),
    ):
        try:
            probe()
            context = importlib.import_module(module).GLContext(width, height)
            context.make_current()
        # PyOpenGL raises any of these for a library that it cannot use.
        except (RendererError, ImportError, AttributeError, RuntimeError, OSError) as error:
            reasons.append(f"{platform}: {error}")
        else:
            return GlContext(platform, context)
    raise RendererError("; ".join(reasons))


def probe_egl() -> None:
    """Check that EGL has a device that can be initialized.

    Raises:
        RendererError: There is no EGL library, no OpenGL library, or no such device.
    """
    egl = _load(("libEGL.so.1",))
    _load(("libOpenGL.so.0", "libGL.so.1"))
    address = egl.eglGetProcAddress
    address.restype = ctypes.c_void_p
    address.argtypes = [ctypes.c_char_p]
    query = address(b"eglQueryDevicesEXT")
    display_of = address(b"eglGetPlatformDisplayEXT")
    if not query or not display_of:
        raise RendererError("libEGL cannot list devices")
    if not _any_device_starts(egl, query, display_of):
        raise RendererError("no EGL device can be initialized")


def probe_osmesa() -> None:
    """Check that the off-screen Mesa library is installed.

    Raises:
        RendererError: It is not installed.
    """
    _load(("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"))


def _load(names: Sequence[str]) -> ctypes.CDLL:
    for name in names:
        try:
            return ctypes.CDLL(name)
        except OSError:
            continue
    raise RendererError(f"{' and '.join(names)} not found")


def _any_device_starts(egl: ctypes.CDLL, query: int, display_of: int) -> bool:
    pointer = ctypes.c_void_p
    devices = (pointer * _MAX_DEVICES)()
    count = ctypes.c_int(0)
    query_devices = ctypes.CFUNCTYPE(
        ctypes.c_uint, ctypes.c_int, ctypes.POINTER(pointer), ctypes.POINTER(ctypes.c_int)
    )(query)
    get_display = ctypes.CFUNCTYPE(pointer, ctypes.c_uint, pointer, pointer)(display_of)
    egl.eglInitialize.argtypes = [pointer, pointer, pointer]
    if not query_devices(_MAX_DEVICES, devices, ctypes.byref(count)):
        return False
    # No eglTerminate: the display belongs to the process, and a context may be open on it.
    return any(
        display and egl.eglInitialize(display, None, None)
        for display in (
            get_display(_EGL_PLATFORM_DEVICE, device, None) for device in devices[: count.value]
        )
    )


_SPARE_GEOMS = 100


class GlRenderer:
    """Renders with MuJoCo's classic renderer in its own context.

    By default without shadows and reflections, at the quality that a color filter needs and a CPU
    can afford. It changes ``model.vis`` (image buffer, samples), which has no effect on physics.

    Args:
        context: Result of `open_context`.
        samples: Samples per pixel; 0 is the fastest, 4 give three times finer centroids.
        effects: Render shadows and reflections: 10 times slower without a GPU.
    """

    name = "gl"

    def __init__(self, context: GlContext, samples: int = 4, effects: bool = False) -> None:
        self._context = context
        self._samples = samples
        self._effects = effects
        self._upload: _Upload | None = None
        self._option = mujoco.MjvOption()
        self._option.sitegroup[:] = 0
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED

    def render(self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure) -> Image:
        """See `Renderer`."""
        return exposure.paint(partial(self._samples_of, model, data, exposure))

    def _samples_of(
        self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure, blocks: Blocks
    ) -> Image:
        """Colors of some blocks of the image, of shape (rows, columns, 3)."""
        self._context.make_current()
        upload = self._uploaded(model, exposure.width, exposure.height)
        self._update(upload.scene, model, data, exposure)
        _narrow(upload.scene, exposure, blocks, float(model.cam_fovy[exposure.camera_id]))
        rows, columns = (part.stop - part.start for part in blocks)
        part = np.empty((rows, columns, 3), dtype=np.uint8)
        rectangle = mujoco.MjrRect(0, 0, columns, rows)
        mujoco.mjr_render(rectangle, upload.scene, upload.buffers)
        mujoco.mjr_readPixels(part, None, rectangle, upload.buffers)
        return np.ascontiguousarray(part[::-1])

    def close(self) -> None:
        """Free the scene's buffers; the context itself lives as long as the process."""
        if self._upload is not None:
            self._context.make_current()
            self._upload.buffers.free()
        self._upload = None

    def _uploaded(self, model: mujoco.MjModel, width: int, height: int) -> _Upload:
        """Meshes on the GPU, uploaded once per model, and again if a larger image is requested."""
        if self._upload is None or not self._upload.serves(model, width, height):
            self.close()
            visual = model.vis
            visual.quality.offsamples = self._samples
            visual.global_.offwidth = max(width, visual.global_.offwidth)
            visual.global_.offheight = max(height, visual.global_.offheight)
            self._upload = _upload(model, effects=self._effects)
        return self._upload

    def _update(
        self,
        scene: mujoco.MjvScene,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        exposure: Exposure,
    ) -> None:
        """Update the scene to the current state and the camera of the exposure."""
        self._option.geomgroup[:] = 0
        self._option.geomgroup[list(exposure.groups)] = 1
        self._camera.fixedcamid = exposure.camera_id
        visible = mujoco.mjtCatBit.mjCAT_STATIC.value | mujoco.mjtCatBit.mjCAT_DYNAMIC.value
        mujoco.mjv_updateScene(model, data, self._option, None, self._camera, visible, scene)


@dataclass(frozen=True, eq=False)
class _Upload:
    """The resources of one model in OpenGL.

    Attributes:
        model: Compiled model; its buffer size is that of ``buffers``.
        scene: Geoms, lights and cameras, for MuJoCo's renderer.
        buffers: Meshes, textures and the offscreen image.
    """

    model: mujoco.MjModel
    scene: mujoco.MjvScene
    buffers: mujoco.MjrContext

    def serves(self, model: mujoco.MjModel, width: int, height: int) -> bool:
        """Whether an image of this size of a model can be rendered."""
        wide = self.buffers.offWidth
        high = self.buffers.offHeight
        return model is self.model and width <= wide and height <= high


def _upload(model: mujoco.MjModel, *, effects: bool) -> _Upload:
    scene = mujoco.MjvScene(model, maxgeom=model.ngeom + _SPARE_GEOMS)
    if not effects:
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
    buffers = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, buffers)
    return _Upload(model, scene, buffers)


def _narrow(scene: mujoco.MjvScene, exposure: Exposure, blocks: Blocks, fovy_deg: float) -> None:
    """Narrow the view frustum to some blocks, so that the rest costs nothing."""
    (top, bottom), (left, right) = (
        (part.start * exposure.stride, part.stop * exposure.stride) for part in blocks
    )
    for camera in scene.camera:
        slope = math.tan(math.radians(fovy_deg) / 2.0)
        pixel = 2.0 * camera.frustum_near * slope / exposure.height
        camera.frustum_top = (exposure.height / 2.0 - top) * pixel
        camera.frustum_bottom = (exposure.height / 2.0 - bottom) * pixel
        camera.frustum_center = ((left + right) / 2.0 - exposure.width / 2.0) * pixel
        camera.frustum_width = 0.5 * (right - left) * pixel


# Choice

GL_PACKAGES = "libegl1 and libgl1 (or libosmesa6)"
"""Packages of Debian and Ubuntu that provide OpenGL without a screen."""


class RendererChoice(NamedTuple):
    """Factory of the chosen renderer, and one sentence about it for the user."""

    create: Callable[[], Renderer]
    message: str


def choose_renderer(
    kind: RendererKind = "ray", find_context: Callable[[], GlContext] = open_context
) -> RendererChoice:
    """Choose the renderer for this machine.

    Args:
        kind: ``"gl"`` insists on OpenGL, ``"ray"`` never touches it, ``"auto"`` takes OpenGL
            where it works.
        find_context: Function that opens an off-screen context or raises RendererError; tests
            replace it.

    Raises:
        RendererError: OpenGL was requested and does not work here, or the kind is unknown.
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
