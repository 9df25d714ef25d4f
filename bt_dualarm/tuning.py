"""Interactive tuning of the color that a camera looks for.

`Shot` takes the image to tune on, `ColorView` shows what a color detects in it, `Save` writes the
new ranges into the tree file. `Tuning` and `page_server` are the web page for it: image, mask and
sliders, served to browsers on this machine only.
"""

from __future__ import annotations

import base64
import io
import json
import logging
import math
import stat
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from functools import cached_property, partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from socket import socket
from socketserver import BaseServer
from threading import Lock
from typing import Final, Protocol, TypeAlias

import cv2
import numpy as np
import PIL.Image
from pydantic import ValidationError

from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.core.share import share_dir, write_text
from bt_dualarm.perception.detection import ColorFilter, Detection, Mask, detect_all
from bt_dualarm.runtime.file_check import check
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.camera import Camera
from bt_dualarm.sim.frame import Frame, Image, RendererKind
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import ArmSpec, TreeFile
from bt_dualarm.spec.explain import explain
from bt_dualarm.spec.node_types import (
    NodeSpec,
    NodeType,
    is_dynamic,
    key_name,
    models_in,
    reference_of,
)
from bt_dualarm.spec.problems import SpecError, errors, suggestion
from bt_dualarm.spec.values import Color, HsvRange
from bt_dualarm.spec.yaml_reader import Data, DataPath, Source, with_tuples, with_value

# Reading of untrusted image files: too large, truncated, or not regular files.


IMAGE_SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".bmp", ".ppm", ".webp", ".tif", ".tiff")

_LARGEST_FILE: Final = 256 * 1024 * 1024
_LARGEST_IMAGE_PX: Final = 50_000_000
"""More than any robot camera has; reading an image takes about ten bytes per pixel."""


class ImageFileError(DualArmError):
    """A file is not a readable image; the message states why."""


def read_image(path: Path) -> Image:
    """Image in a file, RGB, of shape (height, width, 3).

    Raises:
        ImageFileError: It is not an image file, truncated, or larger than 50 million pixels.
    """
    content = _content(path)
    _refuse_huge(path, content)
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error as error:
        raise ImageFileError(f"{path}: is not an image that can be read") from error
    if image is None:
        raise ImageFileError(f"{path}: is not an image that can be read")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def _content(path: Path) -> bytes:
    """Content of a file; pipes and devices, which may be endless, are not opened."""
    try:
        status = path.stat()
        if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
            raise ImageFileError(f"{path}: is a pipe or a device, not an image file")
        if status.st_size > _LARGEST_FILE:
            limit = f"at most {_LARGEST_FILE >> 20} MiB are read"
            raise ImageFileError(f"{path}: has {status.st_size >> 20} MiB, {limit}")
        return path.read_bytes()
    except OSError as error:
        raise ImageFileError(f"{path}: cannot be read: {error.strerror or error}") from error


def _refuse_huge(path: Path, content: bytes) -> None:
    """Check the size in the header only: a few kilobytes may unpack to gigabytes."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the limit below is stricter than the one it warns of
            with PIL.Image.open(io.BytesIO(content)) as image:
                width, height = image.size
    except PIL.Image.DecompressionBombError as error:
        limit = f"images may have at most {_LARGEST_IMAGE_PX // 1_000_000} million pixels"
        raise ImageFileError(f"{path}: is too large: {limit}") from error
    except (OSError, ValueError, SyntaxError) as error:
        raise ImageFileError(f"{path}: is not an image that can be read") from error
    if width * height > _LARGEST_IMAGE_PX:
        limit = f"at most {_LARGEST_IMAGE_PX // 1_000_000} million pixels are read"
        raise ImageFileError(f"{path}: is {width} x {height} pixels, {limit}")


# Detections of a color in an image, and their visualization.


_LEAST_WIDTH_PX: Final = 480
_BAR_PX: Final = 26
_WHITE = (245, 245, 245)
_GREEN = (0, 230, 90)
_ORANGE = (255, 160, 0)


@dataclass(frozen=True, eq=False)
class ColorView:
    """Detections of a color in a frame.

    Attributes:
        frame: The frame.
        color: Color to detect.
    """

    frame: Frame
    color: Color

    @cached_property
    def mask(self) -> Mask:
        """Mask of the pixels that have the color."""
        return ColorFilter(self.color).mask(self.frame.image)

    @cached_property
    def found(self) -> tuple[Detection, ...]:
        """All candidates, the largest first, which a tracker selects initially."""
        found = detect_all(self.frame, ColorFilter(self.color))
        return tuple(sorted(found, key=lambda detection: -detection.area_px))

    @property
    def table(self) -> list[dict[str, Data]]:
        """The candidates as JSON-ready data."""
        return [
            {
                "centroid_px": [round(at, 2) for at in one.centroid_px],
                "area_px": round(one.area_px, 1),
                "bounds_px": list(one.bounds_px),
                "confidence": round(one.confidence, 3),
                "touches_border": one.touches_border,
            }
            for one in self.found
        ]

    def picture(self, title: str) -> Image:
        """Image, mask and overlay side by side, each at least 480 pixels wide, below a title."""
        zoom = max(1, -(-_LEAST_WIDTH_PX // self.frame.width))
        panels = [
            _titled(_zoomed(self.frame.image, zoom), title),
            _titled(_zoomed(np.dstack([self.mask] * 3), zoom), self.color.notation),
            _titled(self._overlay(zoom), self._summary()),
        ]
        gap = np.full((panels[0].shape[0], 4, 3), 128, np.uint8)
        return np.hstack([panels[0], gap, panels[1], gap, panels[2]])

    def _overlay(self, zoom: int) -> Image:
        """The image, dark where the color is not, with a box and a cross at each candidate."""
        share = np.where(self.mask > 0, 1.0, 0.35)[..., None]
        picture = np.ascontiguousarray(_zoomed((self.frame.image * share).astype(np.uint8), zoom))
        for number, one in reversed(list(enumerate(self.found, start=1))):
            color = _GREEN if number == 1 else _ORANGE
            left, top, right, bottom = (edge * zoom for edge in one.bounds_px)
            cv2.rectangle(picture, (left, top), (right - 1, bottom - 1), color, 1)
            at = tuple(round(coordinate * zoom) for coordinate in one.centroid_px)
            cv2.drawMarker(picture, at, color, cv2.MARKER_CROSS, 14, 1, cv2.LINE_AA)
            corner = (left, top - 6 if top > 20 else bottom + 16)
            _write_label(picture, f"{number}: {one.area_px:.0f} px2", corner, color)
        return picture

    def _summary(self) -> str:
        if not self.found:
            return "nothing of this color"
        x, y = self.found[0].centroid_px
        others = f", {len(self.found) - 1} more" if len(self.found) > 1 else ""
        return f"largest at {x:.1f}, {y:.1f}: {self.found[0].area_px:.0f} px2{others}"


def png(image: Image) -> bytes:
    """An image (RGB or one channel) as the content of a PNG file."""
    in_order = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    return bytes(cv2.imencode(".png", in_order)[1])


def _zoomed(image: Image, zoom: int) -> Image:
    return np.asarray(image.repeat(zoom, axis=0).repeat(zoom, axis=1), np.uint8)


def _titled(image: Image, title: str) -> Image:
    """The image with a title bar above it; a long title gets a smaller font."""
    bar = np.full((_BAR_PX, image.shape[1], 3), 40, np.uint8)
    (width, _), _ = cv2.getTextSize(title, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 1)
    _write_label(bar, title, (6, 18), _WHITE, min(0.5, 0.5 * (image.shape[1] - 12) / max(width, 1)))
    return np.vstack([bar, image])


def _write_label(
    image: Image, text: str, corner: tuple[int, int], color: tuple[int, int, int], size: float = 0.5
) -> None:
    cv2.putText(image, text, corner, cv2.FONT_HERSHEY_SIMPLEX, size, color, 1, cv2.LINE_AA)


# The image to tune on: from a camera of a tree file, or from an image file.


class ShotError(DualArmError):
    """There is no image; the message states why."""


@dataclass(frozen=True, eq=False)
class Shot:
    """An image and its origin.

    Attributes:
        frame: Frame with the whole image.
        what: Description of its origin, for display.
    """

    frame: Frame
    what: str


@dataclass(frozen=True)
class ShotTime:
    """Time and conditions at which a camera of a tree file takes the image.

    Attributes:
        seconds: Simulated time since the start of the run in s; 0: before anything moves.
        posture: Named posture in which the camera's arm starts; None for the file's.
        seed: Random seed; None for the file's.
        renderer: Kind of renderer; None for the file's.
    """

    seconds: float = 0.0
    posture: str | None = None
    seed: int | None = None
    renderer: RendererKind | None = None


def image_shot(path: Path) -> Shot:
    """Image of a file.

    Raises:
        ImageFileError: It is not a readable image.
    """
    return Shot(still(read_image(path)), str(path))


_FOV_RAD: Final = 1.0
"""Field of view that an image file is assumed to have; colors do not depend on it."""


def still(image: Image) -> Frame:
    """An image as the frame of a camera at the world's origin."""
    height, width = image.shape[:2]
    return Frame(0.0, image, Pose.identity(), _FOV_RAD, (0, 0, width, height))


def camera_arm(file: TreeFile, name: str | None) -> str:
    """Name of the arm whose camera is used: the given one, or the only one with a camera.

    Raises:
        ShotError: There is none, or there are several and no name is given.
    """
    seeing = [arm for arm, spec in file.arms.items() if spec.camera is not None]
    if name is not None and name not in file.arms:
        raise ShotError(f"there is no arm '{name}': {suggestion(name, file.arms, 'arm')}")
    if name is not None and name not in seeing:
        raise ShotError(f"{name} has no camera (with one: {', '.join(seeing) or 'no arm'})")
    if name is None and len(seeing) != 1:
        found = f"several arms have one ({', '.join(seeing)})" if seeing else "no arm has one"
        raise ShotError(f"which camera? {found}" + "; give --arm NAME" * bool(seeing))
    return name or seeing[0]


def camera_shot(file: TreeFile, registry: Registry, arm: str, moment: ShotTime) -> Shot:
    """Compose the world of a file, run it to the requested time, and take an image.

    Latency, lost frames and shake of the camera are left out: they do not affect colors.

    Args:
        file: Tree file, checked with the skills of ``registry``.
        registry: Installed skills.
        arm: Name of the arm with the camera; see `camera_arm`.
        moment: Time and conditions of the exposure.

    Raises:
        ShotError: The arm is not in the world at that time, or the run failed before.
        DualArmError: The world cannot be composed, or the renderer does not work here.
    """
    spec = file.arms[arm]
    if moment.posture is not None:
        spec = spec.model_copy(update={"posture": moment.posture})
        file = file.model_copy(update={"arms": {**file.arms, arm: spec}})
    with Run(file, registry, RunOptions(moment.seed, None, moment.renderer)) as run:
        if moment.seconds > 0.0:
            run.step(moment.seconds)
        if run.done and run.result.error:
            raise ShotError(f"the run failed before the image was taken: {run.result.error}")
        early = ", where the run ended" if run.done else ""
        frame = _expose(run, arm, spec)
    what = f"camera of {arm} at {frame.stamp:.3f} s{early}, renderer {run.renderer}"
    return Shot(frame, f"{file.name}: {what}")


def _expose(run: Run, arm: str, spec: ArmSpec) -> Frame:
    world = run.world
    renderer = run.assembly.renderer
    if arm not in world.arms:
        raise ShotError(
            f"{arm} is not in the world at {world.time:g} s; use --at S with a later time"
        )
    if spec.camera is None or renderer is None:
        raise ShotError(f"{arm} has no camera")
    calm = spec.camera.model_copy(update={"noise": 0.0, "drop": 0.0})
    return Camera(f"{arm}/camera", calm, renderer).capture(world)


# The leaf that looks for a color, and the location of that color in the file.


class NoColorPortError(DualArmError):
    """No leaf looks for a color, or several do and none is selected."""


@dataclass(frozen=True, eq=False)
class ColorPort:
    """A port with the color that a camera looks for.

    Attributes:
        node: Leaf of a tree.
        port: Name of the port.
        color: Color in the port, None if it comes from a blackboard key.
    """

    node: NodeSpec
    port: str
    color: Color | None

    @property
    def path(self) -> DataPath:
        """Path of the port in the file of the node."""
        return (*self.node.path, self.node.kind, self.port)

    def home(self) -> tuple[Source, DataPath]:
        """File and path at which the color is written, or would be.

        Raises:
            SpecError: Its source is not a single color.
        """
        source = self.node.source
        reference = reference_of(self.node.source.get(self.path))
        if reference is None:
            return source, self.path
        name = key_name(reference)
        problem = self.node.port_problem
        hint = "write a literal color here, or declare a parameter of type color"
        declared = source.get(("params", name)) if self.node.user is None else None
        if not isinstance(declared, dict):
            what = "a parameter of the subtree or a blackboard key"
            message = f"{self.node.kind}: this color is '{{{name}}}', {what}"
            raise SpecError([problem((self.port,), message, hint)])
        if declared.get("type") != "color":
            message = f"this color is the parameter '{name}', which is not a color but a "
            words = f"{message}{declared.get('type')}: it cannot hold ranges"
            raise SpecError([source.problem(("params", name), words, hint, key=True)])
        return source, ("params", name, "default")


def color_ports(file: TreeFile, arm: str, kinds: Mapping[str, NodeType]) -> Iterator[ColorPort]:
    """Ports of an arm's tree with a color, each once, in the order of the file."""
    seen = set()
    for node in file.arms[arm].tree.walk():
        fields = kinds[node.kind].ports.model_fields if node.kind in kinds else {}
        for name, field in fields.items():
            if Color not in models_in(field.annotation):
                continue
            value = node.ports.get(name, field.default)
            known = not is_dynamic(value) and value is not None
            color = Color.model_validate(with_tuples(value)) if known else None
            found = ColorPort(node, name, color)
            if (node.source.file, found.path) not in seen:
                seen.add((node.source.file, found.path))
                yield found


def choose(ports: Sequence[ColorPort], arm: str, line: int | None = None) -> ColorPort:
    """The selected port: the only one, or that of the node in a line of the file.

    Raises:
        NoColorPortError: There is none, or there are several and no line is given.
    """
    fitting = [one for one in ports if line in (None, one.node.location.line)]
    if len(fitting) == 1:
        return fitting[0]
    if not ports:
        raise NoColorPortError(f"no leaf of {arm} looks for a color")
    places = "\n".join(f"  {one.node.location}  {one.node.name}" for one in ports)
    if not fitting:
        raise NoColorPortError(f"no leaf on line {line} looks for a color; these do:\n{places}")
    raise NoColorPortError(f"{len(fitting)} leaves look for a color; give --line N:\n{places}")


# Color ranges from selected pixels.


Pixel: TypeAlias = tuple[int, int]
"""Column and row, from the top left corner."""

_AROUND: Final = 1
"""Neighboring pixels on each side that are included with a selected one."""

_HUE_MARGIN_DEG: Final = 6.0
_SHARE_MARGIN: Final = 0.15
_COLORLESS: Final = 0.08
"""Saturation times value below which 8 bits do not resolve the hue (black, white, gray)."""


class PixelError(DualArmError):
    """A pixel is outside the image."""


def range_of(image: Image, pixels: Sequence[Pixel], begin: HsvRange | None = None) -> HsvRange:
    """Smallest range around pixels and their neighbors, with a margin for other lighting.

    Args:
        image: RGB, of shape (height, width, 3).
        pixels: Columns and rows of the selected pixels, at least one.
        begin: Range to widen so that it contains the pixels; None for a new range.

    Raises:
        PixelError: A pixel is outside the image.
    """
    hsv = np.vstack([_patch(image, pixel) for pixel in pixels])
    colored = hsv[hsv[:, 1] * hsv[:, 2] >= _COLORLESS, 0]
    return HsvRange(
        hue=_arc(colored, begin.hue if begin else None),
        saturation=_span(hsv[:, 1], begin.saturation if begin else None),
        value=_span(hsv[:, 2], begin.value if begin else None),
    )


def _patch(image: Image, pixel: Pixel) -> Matrix:
    """Hue in degrees, saturation and value from 0 to 1 around a pixel, of shape (n, 3)."""
    x, y = pixel
    height, width = image.shape[:2]
    if not (0 <= x < width and 0 <= y < height):
        raise PixelError(f"pixel {x},{y} is outside the image, which is {width}x{height}")
    part = image[max(y - _AROUND, 0) : y + _AROUND + 1, max(x - _AROUND, 0) : x + _AROUND + 1]
    hsv = cv2.cvtColor(np.ascontiguousarray(part), cv2.COLOR_RGB2HSV).reshape(-1, 3)
    return np.asarray(hsv * (2.0, 1 / 255, 1 / 255))


def _arc(hues: Vector, begin: tuple[float, float] | None) -> tuple[float, float]:
    """Arc of the color wheel that contains all hues, extended at the nearer end; degrees."""
    if begin is None and not len(hues):
        return 0.0, 360.0
    low, high = begin or (float(hues[0]), float(hues[0]))
    length = high - low if high >= low else high - low + 360.0
    for hue in hues:
        from_low = (float(hue) - _HUE_MARGIN_DEG - low) % 360.0
        upwards = from_low + 2 * _HUE_MARGIN_DEG - length
        downwards = 360.0 - from_low
        if 0.0 < downwards < upwards:
            low = low - downwards
            length = length + downwards
        elif upwards > 0.0:
            length += upwards
    if length >= 360.0:
        return 0.0, 360.0
    return float(math.floor(low) % 360), float(math.ceil(low + length) % 360)


def _span(shares: Vector, begin: tuple[float, float] | None) -> tuple[float, float]:
    """Interval that contains all values, within 0 to 1, in hundredths."""
    low, high = begin or (1.0, 0.0)
    low = min(low, max(0.0, float(shares.min()) - _SHARE_MARGIN))
    high = max(high, min(1.0, float(shares.max()) + _SHARE_MARGIN))
    return math.floor(100 * low) / 100, math.ceil(100 * high) / 100


# Requested colors: parsing, validation, changes.


class ColorError(DualArmError):
    """The input is not a color; the message states why."""


def color_of(data: Data) -> Color:
    """A color from its notation: a name, or a list of ranges.

    Raises:
        ColorError: It is none.
    """
    try:
        return Color.model_validate(with_tuples(data))
    except ValidationError as error:
        found = explain(error, Color, data, "field")
        words = (f"{one.message} {one.hint}".strip() for one in found)
        raise ColorError("; ".join(words)) from None
    except UnicodeEncodeError:
        raise ColorError("a color needs complete characters") from None


def adjusted(
    color: Color,
    image: Image,
    *,
    pick: Sequence[Pixel] = (),
    widen: Sequence[Pixel] = (),
    bounds: Mapping[str, Sequence[float]] | None = None,
) -> Color:
    """A color with changes applied in this order; without changes, the color itself.

    Args:
        color: Initial color.
        image: Image of the pixels.
        pick: Pixels around which a new range is created.
        widen: Pixels that the first range is widened to contain.
        bounds: Bounds of hue, saturation or value, for every range; a hue leaves the first
            range only.

    Raises:
        ColorError: A lower bound is above its upper one.
        PixelError: A pixel is outside the image.
    """
    if not (pick or widen or bounds):
        return color
    ranges = [range_of(image, pick)] if pick else list(color.ranges)
    if widen:
        ranges[0] = range_of(image, widen, ranges[0])
    given = {name: list(pair) for name, pair in (bounds or {}).items()}
    kept = ranges[:1] if "hue" in given else ranges
    return color_of([{**item.data, **given} for item in kept])


# Writing of a tuned color: to its tree file, or as a YAML snippet.


class SavingError(DualArmError):
    """A file cannot be written; it is unchanged."""


class Save(Protocol):
    """Destination of a tuned color."""

    def __call__(self, color: Color) -> str:
        """Write the color; returns a sentence on the result.

        Raises:
            DualArmError: Nothing was written; the message states why.
        """


@dataclass(frozen=True)
class IntoTree:
    """Writes to a tree file without changing anything else in it.

    Attributes:
        path: File to write to.
        arm: Name of the arm with the tree.
        line: Line of the leaf, if several look for a color.
        registry: The installed skills.
        params: Parameters of the file as given on the command line.
    """

    path: Path
    arm: str
    line: int | None
    registry: Registry
    params: Mapping[str, str] = dataclass_field(default_factory=dict)

    def __call__(self, color: Color) -> str:
        """Find the location again: the file may have changed since it was read."""
        kinds = self.registry.kinds
        file = load_tree_file(self.path, kinds, self.params)
        port = choose(list(color_ports(file, self.arm, kinds)), self.arm, self.line)
        source, place = port.home()
        path = Path(source.file)
        text = path.read_bytes().decode("utf-8")
        edited = with_value(text, source.file, place, _like(source.get(place), color.data))
        _write(path, edited)
        self._prove(path, text)
        return f"written: {source.key_location(place)}"

    def _prove(self, path: Path, before: str) -> None:
        """Check the file as bt-check does; restore it if it has errors."""
        wrong = errors(check(self.path, self.registry.kinds, self.params).problems)
        if wrong:
            _write(path, before)
            raise SpecError(wrong)


@dataclass(frozen=True)
class AsSnippet:
    """Writes a separate file to copy from.

    Attributes:
        path: File to write to.
        what: Description of the image from which the color was picked.
    """

    path: Path
    what: str

    def __call__(self, color: Color) -> str:
        """Write it."""
        _write(self.path, snippet(color, self.what))
        return f"written: {self.path}"


def snippet(color: Color, what: str) -> str:
    """A color as the YAML lines of a leaf's port."""
    origin = " ".join(what.split())
    return (
        f"# hue in degrees, saturation and value from 0 to 1; {origin}\ncolor: {color.notation}\n"
    )


def _like(old: Data, new: Data) -> Data:
    """The new ranges, without default fields that the old ones omitted as well."""
    if not isinstance(new, list):
        return new
    plain = Color(ranges=({"hue": (0.0, 0.0)},)).ranges[0].data  # type: ignore[arg-type]
    written = [set(item) for item in old] if isinstance(old, list) else []
    written += [set() for _ in range(len(new) - len(written))]
    return [
        {
            name: value
            for name, value in item.items()
            if name == "hue" or name in names or value != plain[name]
        }
        for item, names in zip(new, written, strict=False)
    ]


def _write(path: Path, text: str) -> None:
    """Write a file atomically; an existing file keeps its permissions."""
    target = path.resolve()
    try:
        mode = target.stat().st_mode if target.exists() else None
        write_text(target, text)
        if mode is not None:
            target.chmod(mode)
    except OSError as error:
        raise SavingError(f"cannot write {path}: {error.strerror or error}") from error


HOST: Final = "127.0.0.1"
_LARGEST_BODY: Final = 64 * 1024
_DIGITS: Final = len(str(_LARGEST_BODY))
_PATIENCE_S: Final = 10.0
"""Longest wait for an incomplete request, s."""

_log = logging.getLogger(__name__)


class PageError(DualArmError):
    """The page cannot be served, or a request is invalid."""


class Tuning:
    """Actions of the page, independent of the network; the page itself keeps the ranges.

    Args:
        shot: Image to tune on.
        color: Initial color.
        save: Writer that the button calls; None if there is no destination.
    """

    def __init__(self, shot: Shot, color: Color, save: Save | None) -> None:
        self._shot = shot
        self._color = color
        self._save = save
        self._saving = Lock()
        self.image = png(shot.frame.image)

    def begin(self, _: Data) -> dict[str, Data]:
        """Initial content of the page."""
        return {
            "what": self._shot.what,
            "can_save": self._save is not None,
            **self._seen(Color(ranges=self._color.ranges)),
        }

    def look(self, asked: Data) -> dict[str, Data]:
        """Detections of ``color``."""
        return self._seen(_color(asked))

    def click(self, asked: Data) -> dict[str, Data]:
        """Replace or ``widen`` range number ``range`` of ``color`` around pixel ``at``."""
        color = _color(asked)
        try:
            (x, y) = asked["at"]
            number = asked["range"]
            widen = asked["widen"]
            ranges = list(color.ranges)
            begin = ranges[number] if widen else None
            ranges[number] = range_of(self._shot.frame.image, [(int(x), int(y))], begin)
        except (KeyError, IndexError, TypeError, ValueError, OverflowError) as error:
            raise PageError(f"a click needs a pixel and a range: {error!r}") from None
        return self._seen(Color(ranges=tuple(ranges)))

    def save(self, asked: Data) -> dict[str, Data]:
        """Write ``color`` to its destination."""
        if self._save is None:
            raise PageError("there is no file to write to; start with --write or --snippet FILE")
        color = _color(asked)
        with (
            self._saving
        ):  # browsers send concurrent requests, and a save reads and writes the tree file
            return {"message": self._save(color)}

    def _seen(self, color: Color) -> dict[str, Data]:
        look = ColorView(self._shot.frame, color)
        mask = base64.b64encode(png(look.mask)).decode()
        return {
            "color": color.data,
            "notation": color.notation,
            "mask": f"data:image/png;base64,{mask}",
            "found": look.table,
        }


def _color(asked: Data) -> Color:
    if not isinstance(asked, dict) or "color" not in asked:
        raise PageError("a request names a color")
    return color_of(asked["color"])


def page_server(tuning: Tuning, port: int = 0) -> ThreadingHTTPServer:
    """A server on the loopback address; ``serve_forever`` runs it, ``server_address`` names it.

    Args:
        tuning: Actions of the page.
        port: Number of the port; 0 for any free port.

    Raises:
        PageError: The port is taken, or not allowed.
    """
    try:
        return _Server((HOST, port), partial(_Handler, tuning))
    except (OSError, OverflowError) as error:
        raise PageError(f"cannot serve on port {port}: {error}") from error


class _Server(ThreadingHTTPServer):
    """Server that reports errors of requests to the log instead of the terminal."""

    def handle_error(self, request: object, client_address: object) -> None:  # noqa: ARG002 - its parent's
        """Log an error; a closed connection is normal, anything else is a bug."""
        level = logging.DEBUG if isinstance(sys.exception(), ConnectionError) else logging.ERROR
        _log.log(level, "a request for the page failed", exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    """One request.

    A page of another site in the same browser can reach this address as well. Requests are
    therefore refused if they name another host (whose name may resolve to this address) or if
    they are not JSON (which a browser lets any site send).
    """

    timeout = _PATIENCE_S  # applied to the socket by the base class

    def __init__(
        self, tuning: Tuning, request: socket, client_address: tuple[str, int], server: BaseServer
    ) -> None:
        self._tuning = tuning
        super().__init__(request, client_address, server)

    def do_GET(self) -> None:
        """Serve the page and its image."""
        if not self._is_meant():
            self._refuse(HTTPStatus.FORBIDDEN, "this address is served to this machine only")
        elif self.path == "/":
            page = share_dir("assets") / "pages" / "tune_color.html"
            self._answer("text/html; charset=utf-8", page.read_bytes())
        elif self.path == "/image.png":
            self._answer("image/png", self._tuning.image)
        else:
            self._refuse(HTTPStatus.NOT_FOUND, f"nothing is at {self.path}")

    def do_POST(self) -> None:
        """Answer a request of the page; both are JSON."""
        act = self._actions.get(self.path)
        if not self._is_meant() or self.headers.get_content_type() != "application/json":
            self._refuse(HTTPStatus.FORBIDDEN, "only the page itself may send requests")
            return
        if act is None:
            self._refuse(HTTPStatus.NOT_FOUND, f"nothing is at {self.path}")
            return
        try:
            content = json.dumps(act(self._asked())).encode()
        except DualArmError as error:
            self._refuse(HTTPStatus.BAD_REQUEST, str(error))
            return
        self._answer("application/json", content)

    @property
    def _actions(self) -> Mapping[str, Callable[[Data], dict[str, Data]]]:
        tuning = self._tuning
        return {
            "/begin": tuning.begin,
            "/look": tuning.look,
            "/click": tuning.click,
            "/save": tuning.save,
        }

    def _is_meant(self) -> bool:
        name = self.headers.get("Host", "").rpartition(":")[0]
        return name in (HOST, "localhost")

    def _asked(self) -> Data:
        """Parsed content of the request.

        Raises:
            PageError: The content is missing, not JSON, or has invalid numbers or text.
        """
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or len(length) > _DIGITS or int(length) > _LARGEST_BODY:
            raise PageError("a request needs a length within the limit")
        try:
            asked = json.loads(self.rfile.read(int(length)))
            json.dumps(asked, ensure_ascii=False, allow_nan=False).encode()
        except (ValueError, RecursionError):
            raise PageError("a request must be JSON with finite numbers and valid text") from None
        return asked

    def _refuse(self, status: HTTPStatus, why: str) -> None:
        self._answer("application/json", json.dumps({"error": why}).encode(), status)

    def _answer(self, kind: str, content: bytes, status: HTTPStatus = HTTPStatus.OK) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *arguments: object) -> None:  # noqa: A002 - http.server's
        """Write to the log instead of the terminal."""
        _log.debug(format, *arguments)
