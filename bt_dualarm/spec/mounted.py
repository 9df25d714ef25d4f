"""Which gripper a tree file mounts: by its name, or by what a parameter of the file is."""

from __future__ import annotations

from typing import Annotated, Final, TypeAlias

from pydantic import BeforeValidator, StringConstraints, WithJsonSchema

from bt_dualarm.spec.source import Data

_NONE: Final = "none"
_FORM: Final = 'as in gripper: {value: "{grasp}", cases: {fingers: robotiq_2f85, attach: none}}'
_PAGE: Final = {"type": "string", "minLength": 1, "maxLength": 200}


def _one_of(given: Data) -> Data:
    """The gripper of the case that equals the value; what is no mapping as it is."""
    if isinstance(given, dict):
        if given.keys() != {"value", "cases"} or not isinstance(given["cases"], dict):
            raise ValueError(f"expected a gripper, or a value and cases, {_FORM}")
        value, cases = given["value"], given["cases"]
        if not isinstance(value, str) or value not in cases:
            raise ValueError(f"no case for {value!r}; cases: {', '.join(cases)}")
        given = cases[value]
        if not isinstance(given, str):
            raise ValueError(f"case {value!r}: expected the name of a gripper or none, {_FORM}")
    return None if given == _NONE else given


Mounted: TypeAlias = Annotated[
    Annotated[str, StringConstraints(min_length=1, max_length=200)] | None,
    BeforeValidator(_one_of),
    WithJsonSchema(
        {
            "anyOf": [
                _PAGE,
                {
                    "type": "object",
                    "properties": {
                        "value": {"type": "string"},
                        "cases": {"type": "object", "additionalProperties": _PAGE},
                    },
                    "required": ["value", "cases"],
                    "additionalProperties": False,
                },
                {"type": "null"},
            ]
        }
    ),
]
"""Name or path of a gripper's page, None for no gripper; a file may choose it by a parameter."""
