"""The unit of a number in YAML, and the units that a text may give instead."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from pydantic import GetJsonSchemaHandler

_DIGITS: Final = r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?"


@dataclass(frozen=True, eq=False)
class Unit:
    """Metadata of a number: how it is written in YAML.

    Attributes:
        yaml: Unit of a bare number.
        others: Units that text may give, in units of that one.
    """

    yaml: str
    others: Mapping[str, float]

    def __get_pydantic_json_schema__(
        self, core_schema: Any, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """A number, or text with one of the units."""
        pattern = rf"^\s*{_DIGITS}\s*({'|'.join(self.others)})\s*$"
        return {"anyOf": [handler(core_schema), {"type": "string", "pattern": pattern}]}
