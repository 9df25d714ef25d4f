"""What pages may ask for, and the numbers and names in their questions."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Protocol, TypeAlias

from bt_dualarm.errors import DualArmError
from bt_dualarm.runtime.summary import json_ready
from bt_dualarm.share import share_dir
from bt_dualarm.spec.source import Data, Json

Query: TypeAlias = Mapping[str, str]
"""What follows the question mark of an address."""

_LONGEST: Final = 500
_MOST: Final = 10**9
_PAGE: Final = "live.html"
_PARTS: Final = {
    "STYLE_OF_THE_VIEW": "live.css",
    "SCRIPT_OF_THE_SCENE": "scene.js",
    "SCRIPT_OF_THE_SOURCE": "source.js",
    "SCRIPT_OF_THE_PANELS": "live_panels.js",
    "SCRIPT_OF_THE_VIEW": "live.js",
}


class ViewError(DualArmError):
    """The page cannot be served, or was asked for something that it does not understand."""


@dataclass(frozen=True)
class Answer:
    """What a browser gets.

    Attributes:
        kind: Media type.
        content: The content.
    """

    kind: str
    content: bytes

    @classmethod
    def of(cls, said: Data) -> Answer:
        """An answer in JSON; numbers that are not finite, as of a run that diverged, are null."""
        try:
            text = json.dumps(said, allow_nan=False)
        except ValueError:
            text = json.dumps(json_ready(said), allow_nan=False)
        return cls("application/json", text.encode())

    @classmethod
    def page(cls) -> Answer:
        """The page itself, which every view shares."""
        return cls("text/html; charset=utf-8", whole_page().encode())

    @classmethod
    def jpeg(cls, content: bytes | None) -> Answer:
        """A picture.

        Raises:
            ViewError: There is none.
        """
        return cls("image/jpeg", _there(content, "picture"))

    @classmethod
    def numbers(cls, content: bytes | None) -> Answer:
        """A mesh.

        Raises:
            ViewError: There is none.
        """
        return cls("application/octet-stream", _there(content, "such mesh"))


def _there(content: bytes | None, what: str) -> bytes:
    if content is None:
        raise ViewError(f"there is no {what}")
    return content


Asked: TypeAlias = Callable[[Query], Answer]


class Answers(Protocol):
    """What is behind the page."""

    @property
    def questions(self) -> Mapping[str, Asked]:
        """What may be asked, by name; each raises `DualArmError` where it makes no sense."""

    def do(self, asked: Json) -> Json:
        """Press a button.

        Raises:
            DualArmError: There is no such button.
        """


def whole_page(record: str = "") -> str:
    """The page with its style and its scripts in it.

    Args:
        record: A record in base64 that the page shows by itself; it then may ask nobody. Without
            one it asks the server that it came from, and nobody else.
    """
    pages = share_dir("assets") / "pages"
    page = (pages / _PAGE).read_text(encoding="utf-8")
    for place, name in _PARTS.items():
        page = page.replace(place, (pages / name).read_text(encoding="utf-8"))
    kept = f'<script type="text/plain" id="record">{record}</script>' if record else ""
    source = "'none'" if record else "'self'"
    return page.replace("SOURCE_OF_THE_DATA", source).replace("RECORD_OF_THE_RUN", kept)


def number_in(query: Query, name: str, otherwise: float | None = None) -> float:
    """A number of a question.

    Raises:
        ViewError: It is missing, or none that could be a time or a count.
    """
    text = query.get(name)
    if text is None and otherwise is not None:
        return otherwise
    try:
        number = float(text or "")
    except ValueError:
        number = math.nan
    if not 0 <= number <= _MOST:
        raise ViewError(f"{name}: a number from 0 on is missing")
    return number


def text_in(query: Query, name: str) -> str:
    """A name of a question.

    Raises:
        ViewError: It is missing, or too long.
    """
    text = query.get(name, "")
    if not text or len(text) > _LONGEST:
        raise ViewError(f"{name}: a name is missing")
    return text
