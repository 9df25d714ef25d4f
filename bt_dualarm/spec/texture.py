"""Textures of objects: patterns in a second color, and images in files next to the tree.

Image files may come from strangers: their size and number of pixels are bounded before they are
decoded, only PNG and JPEG are read, and nothing outside the tree file's folder is opened. Their
content is part of the tree file's texts, in base64, and so of a run's record and of the identity of
its trial: a replay does not need the files.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import io
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Final, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, PrivateAttr, model_validator

from bt_dualarm.core.later import Later
from bt_dualarm.spec.colors import ObjectColor, rgba_of
from bt_dualarm.spec.node_types import port
from bt_dualarm.spec.values import RelativePath, Value, below_tree

if TYPE_CHECKING:
    import PIL.Image
else:
    PIL = SimpleNamespace(Image=Later("PIL.Image"))

Pixels: TypeAlias = npt.NDArray[np.uint8]

Pattern: TypeAlias = Literal["checker", "stripes", "dots"]

ImageFile: TypeAlias = Annotated[
    RelativePath, AfterValidator(below_tree("a PNG or JPEG file", ".png", ".jpg", ".jpeg"))
]
"""Path of an image relative to the tree file."""

MOST_BYTES: Final = 2_000_000
"""Largest image file, bytes."""

MOST_PIXELS: Final = 1 << 20
"""Largest number of pixels of an image: 1024 x 1024. Every state of a world that is compiled anew
keeps a copy of it."""

MOST_PIXELS_IN_ALL: Final = 8 * MOST_PIXELS
"""Largest number of pixels of all different images of a tree file."""

_SIZE_M: Final = 0.02
"""Size of a pattern that is not given, m."""

_SECOND_COLOR: Final = "black"

_DOT_CELLS: Final = 48
"""Texels along the edge of a tile with one dot, whose diameter is 5/8 of it."""

_MODES: Final = ("1", "L", "LA", "P", "RGB", "RGBA", "CMYK", "YCbCr")
"""Kinds of pixels, as the image library names them, with at most 8 bits per channel."""

_ENCODED: Final = "data:image;base64,"
"""Begin of the text that stands for the content of an image file."""


class ImageError(ValueError):
    """An image file cannot be used; the message is a predicate of the file."""


@dataclass(frozen=True)
class Picture:
    """A decoded image.

    Attributes:
        width: Width, px.
        height: Height, px.
        content: Red, green, blue and opacity of its pixels, row by row from the top left.
    """

    width: int
    height: int
    content: bytes

    @property
    def pixels(self) -> Pixels:
        """Its pixels, of shape (height, width, 4)."""
        return np.frombuffer(self.content, np.uint8).reshape(self.height, self.width, 4)

    def over(self, color: Sequence[float]) -> Pixels:
        """Pixels of shape (height, width, 3) with a color, each channel from 0 to 1, below it."""
        levels = self.pixels.astype(np.int64)
        below = _levels(color)
        opacity = levels[..., 3:]
        mixed = (levels[..., :3] * opacity + below * (255 - opacity) + 127) // 255
        return mixed.astype(np.uint8)


NO_PICTURE: Final = Picture(1, 1, bytes(4))
"""A transparent image."""


@dataclass(frozen=True, eq=False)
class Tile:
    """An image that repeats over a surface.

    Attributes:
        pixels: Red, green and blue, of shape (rows, columns, 3), from the top left.
        size: Width and height on the surface, m; None if it is stretched over each side.
    """

    pixels: Pixels
    size: tuple[float, float] | None

    @cached_property
    def name(self) -> str:
        """Name that equal pixels share."""
        shape = "x".join(map(str, self.pixels.shape))
        return hashlib.sha256(shape.encode() + self.pixels.tobytes()).hexdigest()[:16]


class TextureSpec(Value):
    """A pattern over the color of an object, or an image."""

    pattern: Pattern | None = port(
        None, "Pattern of squares, of upright stripes, or of dots, over the object's color"
    )
    color: ObjectColor | None = port(None, "Second color of the pattern; by default black")
    image: ImageFile | None = port(
        None,
        "PNG or JPEG file below the folder of the tree file; where it is transparent, the color of "
        "the object shows",
    )
    size: float | None = port(
        None,
        "Edge of a square, width of a stripe, distance of dots, by default 2 cm; of an image the "
        "width of one copy, by default that of each side of the shape",
        unit="m",
        ge=1e-3,
        le=10.0,
    )

    _picture: Picture | None = PrivateAttr(default=None)
    _folder: Path = PrivateAttr(default=Path())

    @model_validator(mode="after")
    def _is_one_of_both(self) -> TextureSpec:
        if (self.pattern is None) == (self.image is None):
            raise ValueError(
                "a texture has either 'pattern' (checker, stripes or dots) or 'image' (a file)"
            )
        if self.image is not None and self.color is not None:
            raise ValueError("only a pattern has a second color, not an image")
        return self

    def look_in(self, folder: Path) -> None:
        """Sets the folder from which the path of an image starts."""
        self._folder = folder

    @property
    def image_path(self) -> Path:
        """Path of the file of an image."""
        return self._folder / (self.image or "")

    def show(self, picture: Picture) -> None:
        """Sets the image, which was read before."""
        self._picture = picture

    def tile(self, rgba: Sequence[float]) -> Tile:
        """The tile that repeats over an object of a color.

        Args:
            rgba: Red, green, blue (and opacity, which is ignored) of the object, from 0 to 1.

        Raises:
            ImageError: The image has not been read, and cannot be read now.
        """
        if self.image is not None:
            picture = self._picture or picture_in(content_of(self.image_path, self._folder))
            pixels = picture.over(rgba[:3])
            if self.size is None:
                return Tile(pixels, None)
            return Tile(pixels, (self.size, self.size * picture.height / picture.width))
        edge = self.size or _SIZE_M
        first = _levels(rgba[:3])
        second = _levels(rgba_of(self.color or _SECOND_COLOR)[:3])
        pattern = self.pattern or "checker"
        pixels = np.where(_MASKS[pattern]()[..., None], second, first).astype(np.uint8)
        across, down = {"checker": (2, 2), "stripes": (2, 1), "dots": (1, 1)}[pattern]
        return Tile(pixels, (across * edge, down * edge))


def _levels(color: Sequence[float]) -> npt.NDArray[np.int64]:
    """A color from 0 to 1 as integers up to 255, of shape (3,)."""
    levels: npt.NDArray[np.int64] = np.rint(255.0 * np.array(color[:3], float)).astype(np.int64)
    return levels


def _dot() -> npt.NDArray[np.bool_]:
    middle = 0.5 * (_DOT_CELLS - 1)
    y, x = np.indices((_DOT_CELLS, _DOT_CELLS)) - middle
    return np.asarray(np.hypot(x, y) < 0.3125 * _DOT_CELLS)


_MASKS: Final = {
    "checker": lambda: np.array(((True, False), (False, True))),
    "stripes": lambda: np.array(((False, True),)),
    "dots": _dot,
}
"""Functions that give where a tile has the second color, of shape (rows, columns)."""


# Image files


def content_of(path: Path, folder: Path) -> bytes:
    """Content of an image file.

    Args:
        path: The file.
        folder: Folder that it must be in, or below, wherever a symlink leads.

    Raises:
        ImageError: It is missing, outside of the folder, or too large.
    """
    try:
        if not path.resolve().is_relative_to(folder.resolve()):
            raise ImageError(f"is a link to a place outside of {folder}")
        if not path.is_file():
            raise ImageError("does not exist" if not path.exists() else "is not a regular file")
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
    except (OSError, RuntimeError) as error:
        raise ImageError(f"cannot be read: {error}") from error
    if len(content) > MOST_BYTES:
        raise ImageError(
            f"has {path.stat().st_size / 1e6:.1f} MB; the maximum is {MOST_BYTES / 1e6:g} MB"
        )
    return content


@lru_cache(maxsize=32)
def picture_in(content: bytes) -> Picture:
    """The image in the content of a PNG or JPEG file.

    Raises:
        ImageError: It is no such file, broken, or has too many pixels.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the limit below is stricter than the one it warns of
            # The header only: a few kilobytes may unpack to gigabytes.
            with PIL.Image.open(io.BytesIO(content), formats=("PNG", "JPEG")) as image:
                width, height = image.size
                if width * height > MOST_PIXELS:
                    raise ImageError(
                        f"has {width} x {height} pixels; at most {MOST_PIXELS} (1024 x 1024) "
                        "are allowed"
                    )
                if image.mode not in _MODES:
                    raise ImageError("has more than 8 bits per channel")
                return Picture(width, height, image.convert("RGBA").tobytes())
    except ImageError:
        raise
    except PIL.Image.DecompressionBombError as error:
        message = f"has too many pixels; at most {MOST_PIXELS} (1024 x 1024) are allowed"
        raise ImageError(message) from error
    # What the image library raises for broken files, those of a hostile author among them.
    except (OSError, ValueError, SyntaxError, EOFError) as error:
        raise ImageError("is not a PNG or JPEG image that can be read") from error


def as_text(content: bytes) -> str:
    """The text that stands for the content of an image file."""
    return _ENCODED + base64.b64encode(content).decode("ascii")


def from_text(text: str) -> bytes:
    """The content for which `as_text` gives a text.

    Raises:
        ImageError: It gives this text for none.
    """
    try:
        return base64.b64decode(text.removeprefix(_ENCODED), validate=True)
    except (binascii.Error, ValueError) as error:
        raise ImageError("is not an image in base64") from error


def is_image_text(text: str) -> bool:
    """Whether a text stands for the content of an image file."""
    return text.startswith(_ENCODED)


def read_image(
    texture: TextureSpec, root: Path, texts: Mapping[str, str]
) -> tuple[str, str, Picture]:
    """Path and text of the file of a texture, and the image in it.

    Args:
        texture: Texture with an image.
        root: Folder outside which no file is read.
        texts: Texts of files by path, used instead of those on the disk.

    Raises:
        ImageError: The file cannot be used.
    """
    path = texture.image_path
    text = texts.get(str(path))
    content = content_of(path, root) if text is None else from_text(text)
    return str(path), as_text(content), picture_in(content)


def refuse_pixels(pictures: Iterable[Picture]) -> None:
    """Check that the images of a tree file are not too large together.

    Raises:
        ImageError: They have more than `MOST_PIXELS_IN_ALL` pixels.
    """
    count = sum(picture.width * picture.height for picture in pictures)
    if count > MOST_PIXELS_IN_ALL:
        most = MOST_PIXELS_IN_ALL // MOST_PIXELS
        raise ImageError(
            f"is too much: with it, the images have {count / MOST_PIXELS:.1f} million pixels; "
            f"at most {most} million are allowed"
        )
