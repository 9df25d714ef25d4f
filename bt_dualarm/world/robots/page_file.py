"""A page of the catalogue that was read: what it says, and where it says it."""

from __future__ import annotations

from pathlib import Path
from typing import Generic, TypeVar

from pydantic import ValidationError

from bt_dualarm.spec.explain import explain
from bt_dualarm.spec.problems import Problem, SpecError
from bt_dualarm.spec.reader import read_file
from bt_dualarm.spec.source import Path as Place
from bt_dualarm.spec.source import Source, with_tuples
from bt_dualarm.spec.values import Value
from bt_dualarm.world.urdf.xml_source import DescriptionError

Entry = TypeVar("Entry", bound=Value)
"""What a page of that kind may say."""


class PageFile(Generic[Entry]):
    """A page that was read, and the text that messages point into.

    Args:
        path: YAML file.
        kind: What the file may say.

    Attributes:
        path: YAML file.
        entry: What it says.

    Raises:
        DescriptionError: The file is no page; it carries every reason.
    """

    def __init__(self, path: Path, kind: type[Entry]) -> None:
        self.path = path
        try:
            self._source: Source = read_file(path)
            self.entry: Entry = kind.model_validate(with_tuples(self._source.data))
        except SpecError as error:
            raise DescriptionError(error.problems) from error
        except ValidationError as error:
            data = self._source.data
            found = [
                self._source.problem(f.path, f.message, f.hint, key=f.at_key)
                for f in explain(error, kind, data, "field")
            ]
            raise DescriptionError(found) from error

    def problem(self, place: Place, message: str, hint: str = "", *, key: bool = False) -> Problem:
        """What is wrong at the value of a place of the file, or at its key."""
        return self._source.problem(place, message, hint, key=key)
