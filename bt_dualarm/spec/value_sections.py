"""Values with a notation of their own, explained for the reference."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, get_args

from pydantic import BaseModel

from bt_dualarm.spec.color import Color, HsvRange
from bt_dualarm.spec.describe import summary_of
from bt_dualarm.spec.notation import model_name, names_of, notation_of, range_of
from bt_dualarm.spec.offset import Offset
from bt_dualarm.spec.plane import Plane
from bt_dualarm.spec.ports import unit_of
from bt_dualarm.spec.spread import Spread
from bt_dualarm.spec.unit import Unit
from bt_dualarm.spec.values import Angle, Duration, PoseSpec

_MODELS: Final[tuple[type[BaseModel], ...]] = (
    PoseSpec,
    Offset,
    Plane,
    Color,
    HsvRange,
    Spread,
)
_QUANTITIES: Final = {
    "duration": ("Simulated time", Duration, "500 ms"),
    "angle": ("A turn", Angle, "90 deg"),
}
VALUE_NAMES: Final = (*_QUANTITIES, *map(model_name, _MODELS))
"""What the reference explains, as types are called there."""


def value_sections() -> Iterator[str]:
    """A section of Markdown for each."""
    for name, (title, annotation, example) in _QUANTITIES.items():
        unit = next(item for item in get_args(annotation) if isinstance(item, Unit))
        others = ", ".join(f"`{other}`" for other in unit.others)
        yield f"### {name}\n"
        yield f"{title}: a number in {unit.yaml}, or text with a unit ({others}): `{example}`.\n"
    for model in _MODELS:
        yield from _section(model)


def _section(model: type[BaseModel]) -> Iterator[str]:
    yield f"### {model_name(model)}\n"
    yield f"{summary_of(model)}\n"
    names = names_of(model)
    if names:
        yield f"Names: {', '.join(f'`{name}`' for name in names)}.\n"
    yield "| field | type | unit | range | |\n|---|---|---|---|---|"
    for name, field in model.model_fields.items():
        words = field.description or ""
        cells = (f"`{name}`", notation_of(field), unit_of(field), range_of(field), words)
        yield f"| {' | '.join(cells)} |"
    yield ""
