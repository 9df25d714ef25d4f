"""Whether a run repeats: made anew and held against its record."""

from __future__ import annotations

from dataclasses import dataclass

from bt_dualarm.replay.past import Difference, Past
from bt_dualarm.replay.record import Record, ReplayError
from bt_dualarm.replay.rerun import Changed, differences, made_anew
from bt_dualarm.runtime.outcome import Ending
from bt_dualarm.runtime.signals import StopRequest
from bt_dualarm.skill.registry import Registry

_REPEATABLE = {str(ending) for ending in (Ending.FINISHED, Ending.DURATION, Ending.TIME_LIMIT)}
"""Endings that come by themselves in a run that is made anew."""

_AT_A_TIME_S = 0.1
"""Simulated seconds between two looks at whether it still agrees."""


@dataclass(frozen=True)
class Agreement:
    """What came of it.

    Attributes:
        steps: Physics steps that were the same, from the first on.
        time_s: Simulated time of the last of them in s.
        until_s: Simulated time in s that was to be compared.
        difference: Where it first differs; None if it does not.
        hash_agrees: Whether the hash of all states is that of the record; None where the record
            has none, or not all of it was compared.
        changed: Sentences on what is not as it was when the record was made.
    """

    steps: int
    time_s: float
    until_s: float
    difference: Difference | None
    hash_agrees: bool | None
    changed: tuple[str, ...]

    @property
    def agrees(self) -> bool:
        """Whether all that was compared is the same."""
        return self.difference is None and self.hash_agrees is not False


def check_record(record: Record, registry: Registry, stop: StopRequest | None = None) -> Agreement:
    """Run a record's tree anew, with pictures, and compare every step.

    A run that was stopped, killed, or edited is compared as far as nobody interfered.

    Args:
        record: The record.
        registry: The skills.
        stop: Request to give up.

    Raises:
        ReplayError: The record has no step to compare.
        DualArmError: The run cannot be made again.
    """
    changed = tuple(differences(record, registry))
    whole = record.summary is not None and record.summary["ending"] in _REPEATABLE
    whole = whole and not any(note["kind"] == "edited" for note in record.notes)
    steps = record.steps if whole else _undisturbed(record)
    if not steps:
        raise ReplayError(f"{record.folder} holds no step to compare")
    timestep = float(record.start["timestep"])
    with made_anew(record, registry, Changed(), stop).run as run:
        past = Past(record, run.world, steps)
        run.watch(past)
        while not run.done and not past.differs and past.steps < steps:
            left = (steps - past.steps) * timestep
            run.step(min(_AT_A_TIME_S, left))
        if past.differs and not run.done and past.difference is not None:
            run.step(_AT_A_TIME_S)  # to the next state that is kept, whose numbers can be named
        if whole and not past.differs and not run.done:
            run.finish()
        same_hash = None
        if whole and run.done and record.end is not None:
            same_hash = run.result.state_sha256 == record.end["state_sha256"]
        same = past.steps
        difference = past.difference
    return Agreement(same, same * timestep, steps * timestep, difference, same_hash, changed)


def _undisturbed(record: Record) -> int:
    """Steps until something outside of the simulation ended the run.

    A signal or a page halts whole trees; the watchdog, which goes by the clock on the wall, ends a
    leaf. Made anew, that leaf would go on, or hang.
    """
    timestep = float(record.start["timestep"])
    roots = {name: str(arm["tree"]["name"]) for name, arm in record.arms.items()}
    halts = [
        float(event["time_s"])
        for event in record.events
        if event["path"] == roots.get(event["arm"])
        and event["code"] in ("", "HALTED")
        and event["new"] == "INVALID"
    ]
    overruns = [float(event["time_s"]) for event in record.events if event["code"] == "OVERRUN"]
    edits = [float(note["time_s"]) for note in record.notes if note["kind"] == "edited"]
    until = min([*halts, *overruns, *edits], default=record.steps * timestep)
    return min(record.steps, round(until / timestep))
