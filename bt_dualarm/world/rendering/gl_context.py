"""An OpenGL context without a screen: found by trying, never by setting ``MUJOCO_GL``.

A wrong ``MUJOCO_GL`` breaks ``import mujoco`` itself, and a missing library ends in an error deep
inside PyOpenGL. So ctypes asks the system first, and only then is MuJoCo's own module imported.
"""

from __future__ import annotations

import ctypes
import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from bt_dualarm.errors import RendererError

_EGL_PLATFORM_DEVICE = 0x313F
_MAX_DEVICES = 16


class OpenedContext(Protocol):
    """What ``mujoco.egl.GLContext`` and ``mujoco.osmesa.GLContext`` are used for here."""

    def make_current(self) -> None:
        """Direct the drawing of this thread to the context."""


@dataclass(frozen=True, eq=False)
class GlContext:
    """An open context and the platform's name."""

    platform: str
    context: OpenedContext

    def make_current(self) -> None:
        """Direct the drawing of this thread to the context."""
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
        # PyOpenGL reports a library that it cannot use by any of these.
        except (RendererError, ImportError, AttributeError, RuntimeError, OSError) as error:
            reasons.append(f"{platform}: {error}")
        else:
            return GlContext(platform, context)
    raise RendererError("; ".join(reasons))


def probe_egl() -> None:
    """Ask EGL for a device that can be initialised.

    Raises:
        RendererError: There is no EGL library, no OpenGL library, or no such device.
    """
    egl = _load(("libEGL.so.1",))
    _load(("libOpenGL.so.0", "libGL.so.1"))
    address = egl.eglGetProcAddress
    address.restype, address.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
    query, display_of = address(b"eglQueryDevicesEXT"), address(b"eglGetPlatformDisplayEXT")
    if not query or not display_of:
        raise RendererError("libEGL cannot list devices")
    if not _any_device_starts(egl, query, display_of):
        raise RendererError("no EGL device can be initialised")


def probe_osmesa() -> None:
    """Look for the off-screen Mesa library.

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
    devices, count = (pointer * _MAX_DEVICES)(), ctypes.c_int(0)
    query_devices = ctypes.CFUNCTYPE(
        ctypes.c_uint, ctypes.c_int, ctypes.POINTER(pointer), ctypes.POINTER(ctypes.c_int)
    )(query)
    get_display = ctypes.CFUNCTYPE(pointer, ctypes.c_uint, pointer, pointer)(display_of)
    egl.eglInitialize.argtypes = [pointer, pointer, pointer]
    if not query_devices(_MAX_DEVICES, devices, ctypes.byref(count)):
        return False
    # Not terminated again: the display belongs to the process, and a context may be open on it.
    return any(
        display and egl.eglInitialize(display, None, None)
        for display in (
            get_display(_EGL_PLATFORM_DEVICE, device, None) for device in devices[: count.value]
        )
    )
