"""Calls of a function with many arguments, run as a sweep runs its trials.

A campaign that generates another tree for each seed, or judges runs in its own way, is no sweep of
one tree. As calls of a function it runs on the same engines: a worker may die, what has finished is
kept and not run again, and results come in the order of the calls, whatever the number of workers.
"""

from __future__ import annotations

import json
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np

from bt_dualarm.runtime.summary import processor
from bt_dualarm.sweeps.dispatch import run_jobs
from bt_dualarm.sweeps.engine import Done, Engine
from bt_dualarm.sweeps.inputs import digest_of, inputs_of_module
from bt_dualarm.sweeps.job import (
    CRASHED,
    Cell,
    Costs,
    Job,
    Row,
    difference,
    flat,
    lost_columns,
    refused_columns,
    short,
)
from bt_dualarm.sweeps.manifest import SweepError
from bt_dualarm.sweeps.sweep import Progress
from bt_dualarm.sweeps.table import RowStore, read_rows

ERROR: Final = "ERROR"
"""Outcome of a call that raised an exception."""

SKIPPED: Final = "SKIPPED"
"""Outcome of a call whose result does not count."""

NO_RESULT: Final = (CRASHED, ERROR)
"""Outcomes without a result: such calls are run again."""


@dataclass(frozen=True)
class Call:
    """A call of a function: a `job.Job`.

    The result is whatever JSON can express. Of a mapping, ``outcome`` and ``code`` are columns of
    the row, by which progress counts; without an outcome it is SUCCESS, or SKIPPED of None.

    Attributes:
        index: Number of the call, from 0.
        function: Function as ``package.module:name``, which workers import.
        arguments: Its keyword arguments, which JSON can express.
        inputs: Digests of code and versions that the worker must find the same; empty for any.
    """

    index: int
    function: str
    arguments: Mapping[str, Any]  # Any: what JSON can express
    inputs: Mapping[str, str] = field(default_factory=dict)

    @property
    def identity(self) -> str:
        """Hash of everything that determines the result."""
        content = [self.function, self.arguments, self.inputs, processor()["arithmetic"]]
        return digest_of(_json(content).encode())

    @property
    def label(self) -> str:
        """The call as one would write it."""
        listed = ", ".join(f"{name}={value!r}" for name, value in self.arguments.items())
        return short(f"{self.function}({listed})")

    def run(self) -> Row:
        """Call the function; an exception becomes part of the row."""
        costs = Costs()
        row = self._columns()
        module, _, name = self.function.partition(":")
        differing = difference(inputs_of_module(module), self.inputs) if self.inputs else ""
        if differing:
            return {**row, **refused_columns(differing)}
        try:
            result = getattr(import_module(module), name)(**self.arguments)
            text = _json(result)
        except Exception as error:  # noqa: BLE001 - one call that fails must not end the others
            row |= {
                "outcome": ERROR,
                "code": type(error).__name__,
                "reason": short(str(error)),
                "traceback": traceback.format_exc(),
            }
        else:
            row |= {"outcome": SKIPPED if result is None else "SUCCESS", "result": text}
            if isinstance(result, Mapping):
                row |= {name: str(result[name]) for name in ("outcome", "code") if name in result}
        return {**row, **costs.columns()}

    def lost_row(self, reason: str, attempts: int) -> Row:
        """Row of the call if its worker died each time."""
        return {**self._columns(), **lost_columns(reason, attempts)}

    def _columns(self) -> dict[str, Cell]:
        return {
            "trial": self.index,
            "identity": self.identity,
            "function": self.function,
            **{f"argument.{name}": flat(value) for name, value in self.arguments.items()},
        }


def calls_of(
    function: str,
    cases: Iterable[Mapping[str, Any]],  # Any: what JSON can express
) -> Iterator[Call]:
    """Calls of a function, one for each mapping of arguments, in their order.

    Raises:
        SweepError: The function cannot be imported, or JSON cannot express an argument.
    """
    module, _, name = function.partition(":")
    try:
        callable(getattr(import_module(module), name))
    except (ImportError, AttributeError) as error:
        raise SweepError(f"workers cannot import the function {function}: {error}") from error
    inputs = inputs_of_module(module)
    for index, arguments in enumerate(cases):
        try:
            plain = json.loads(_json(arguments))
        except TypeError as error:
            raise SweepError(f"argument of case {index} of {function}: {error}") from error
        yield Call(index, function, plain, inputs)


def run_calls(
    calls: Iterable[Call],
    out: Path,
    engine: Callable[[], Engine],
    *,
    total: int | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Generator[tuple[Call, Row], None, None]:
    """Run the calls that have no result in a folder yet; yields calls and rows in their order.

    A row with a result has it in the column ``result``, as JSON text. Closing the iterator, or an
    exception such as Ctrl-C, keeps the results of all calls that have finished.

    Args:
        calls: The calls; there may be no end to them, if the caller stops asking.
        out: Output folder. Rows of other calls in it are kept.
        engine: Returns the engine; called only if something is left to run. The caller closes it,
            and uses it no further if the iterator is closed early: calls are started ahead.
        total: Number of calls that count, for the progress; None if unknown.
        progress: Called after each change.

    Raises:
        SweepError: The folder cannot be written to, or code has changed meanwhile.
    """
    store = RowStore(out)
    finished = _results_in(out)
    state = Progress(total or 0)
    tell = progress or (lambda _: None)
    coming = iter(calls)
    for call in coming:
        if call.identity not in finished:
            coming = chain([call], coming)
            break
        _count(finished[call.identity], state, total)
        state.known = state.done
        yield call, finished[call.identity]
    else:
        return
    order: deque[Call] = deque()
    rows: dict[int, Row] = {}

    def missing() -> Iterator[Job]:
        for call in coming:
            order.append(call)
            if call.identity not in finished:
                yield call
                continue
            rows[call.index] = finished[call.identity]
            _count(rows[call.index], state, total)
            state.known += 1

    def take(done: Done) -> Row:
        rows[done.task.job.index] = done.row
        _count(done.row, state, total)
        return done.row

    def ready() -> Iterator[tuple[Call, Row]]:
        while order and order[0].index in rows:
            first = order.popleft()
            yield first, rows.pop(first.index)

    started = engine()
    with closing(run_jobs(missing(), started, store, take)) as waits:
        for running_s in waits:
            state.running_s = running_s
            state.workers = started.slots
            tell(state)
            yield from ready()
    yield from ready()


def _count(row: Row, state: Progress, total: int | None) -> None:
    if row["outcome"] != SKIPPED:
        state.count(row)
    state.total = state.done if total is None else max(total, state.done)


def _results_in(out: Path) -> Mapping[str, Row]:
    """Rows with a result in a folder, by identity."""
    table = read_rows([out])
    if table is None:
        return {}
    rows = ({name: value for name, value in row.items() if value is not None}
            for row in table.to_pylist())  # fmt: skip
    return {row["identity"]: row for row in rows if row["outcome"] not in NO_RESULT}


def _json(value: object) -> str:
    return json.dumps(value, default=_plain)


def _plain(value: object) -> object:
    """What JSON can express of a value of numpy."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"a {type(value).__name__} is nothing that JSON can express")
