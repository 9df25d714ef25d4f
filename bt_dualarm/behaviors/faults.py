"""Injects the faults of a file into leaves, by wrapping the generators of their skills.

A leaf without faults is not wrapped, so that its run does not change at all.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from bt_dualarm.core.errors import InjectedFailure
from bt_dualarm.skill.skill import Skill
from bt_dualarm.spec.faults import FaultEvent, LeafFault


class InjectedError(RuntimeError):
    """Exception that a fault of the file raises in the code of a skill."""


@dataclass
class _Active:
    """One fault of a leaf, and in how many of its runs it was injected."""

    name: str
    spec: LeafFault
    used: int = 0


class FaultInjector:
    """Faults of one arm's leaves.

    Args:
        faults: Faults of the arm, by name.
        clock: Simulated time in seconds.
        seed: Seed of the run.
        report: Receives each fault that is injected; by default nothing does.
    """

    def __init__(
        self,
        faults: Mapping[str, LeafFault],
        clock: Callable[[], float],
        seed: int,
        report: Callable[[FaultEvent], None] = lambda _: None,
    ) -> None:
        self._report = report
        self._faults = faults
        self._clock = clock
        self._seed = seed

    def of_leaf(self, path: str) -> Callable[[Skill], Skill] | None:
        """Function that wraps each new run of a leaf; None if the leaf has no faults."""
        name = path.rpartition("/")[2]
        found = [
            _Active(key, spec) for key, spec in self._faults.items() if spec.leaf in (path, name)
        ]
        if not found:
            return None
        digest = hashlib.sha256(path.encode()).digest()
        rng = np.random.default_rng([self._seed, int.from_bytes(digest[:8], "little")])

        def wrapped(skill: Skill) -> Skill:
            active = [
                one
                for one in found
                if one.used < one.spec.times
                and one.spec.begin <= self._clock() < one.spec.until
                and rng.random() < one.spec.probability
            ]
            if active:
                fault = active[0]
                fault.used += 1
                steps = skill.run
                # An attribute of this one object hides the method of its class.
                skill.run = lambda: self._steps(steps(), fault, path)  # type: ignore[method-assign]
            return skill

        return wrapped

    def _steps(
        self, steps: Iterator[float | None], fault: _Active, path: str
    ) -> Generator[float | None, None, None]:
        """The steps of a skill with a fault."""
        spec = fault.spec
        began = self._clock()
        pending: BaseException | None = None
        while spec.phase != "start" and (
            spec.phase == "end" or pending or self._clock() - began < spec.after - 1e-9
        ):
            try:
                value = next(steps) if pending is None else _thrown(steps, pending)
            except StopIteration:
                if spec.phase == "during":
                    return  # it ended before the fault was due
                break
            pending = None
            try:
                yield value
            except GeneratorExit:
                _close(steps)
                raise
            except BaseException as error:  # noqa: BLE001 - the skill decides what to do about it
                pending = error
        event = FaultEvent(self._clock(), fault.name, spec.kind, spec.arm, spec.sentence, leaf=path)
        self._report(event)
        yield from _injected(steps, fault)


def _injected(steps: Iterator[float | None], fault: _Active) -> Generator[float | None, None, None]:
    """The rest of a run after its fault."""
    spec = fault.spec
    sentence = f"injected by the fault '{fault.name}' of the file"
    try:
        if spec.effect == "raise":
            if spec.phase != "during":
                raise InjectedError(sentence)
            # The skill may handle it, as any exception at the `yield` where it waits.
            try:
                yield _thrown(steps, InjectedError(sentence))
            except StopIteration:
                return
            yield from steps
        elif spec.effect == "hang":
            while True:
                yield None
        else:
            raise InjectedFailure(spec.code, sentence)
    finally:
        _close(steps)


def _thrown(steps: Iterator[float | None], error: BaseException) -> float | None:
    if isinstance(steps, Generator):
        value: float | None = steps.throw(error)
        return value
    raise error


def _close(steps: Iterator[float | None]) -> None:
    if isinstance(steps, Generator):
        steps.close()
