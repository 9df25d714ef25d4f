"""What every skill keeps to; each law raises `BrokenLawError` for a skill that does not."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Final, TypeAlias

from pydantic.fields import FieldInfo

from bt_dualarm.skill.registry import faults
from bt_dualarm.spec.annotations import metadata_of
from bt_dualarm.spec.unit import Unit
from bt_dualarm.testing.candidate import Candidate, Performance
from bt_dualarm.testing.scenario import Tree, after
from bt_dualarm.tree.report import LeafReport

Law: TypeAlias = Callable[[Candidate], None]

STOPPED: Final = 0.02
"""Joint speed in rad/s below which an arm stands."""

STOPPING_S: Final = 1.0
"""Simulated seconds that an arm has to come to rest."""

_PHASES: Final = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98)
_SHORTEST_S: Final = 0.01  # halts at the second tick
_UNITLESS: Final = ("share", "how often", "image error")


class BrokenLawError(AssertionError):
    """A skill does not keep to a law; a failed assertion to every test runner."""


def author_forgot_nothing(candidate: Candidate) -> None:
    """Descriptions, docstring, failure codes and an example are there."""
    found = list(faults(candidate.skill))
    _hold(not found, "; ".join(found))
    began = candidate.skill.example.startswith(candidate.name)
    _hold(began, f"its example does not begin with '{candidate.name}'")


def numbers_of_ports_say_their_unit(candidate: Candidate) -> None:
    """A number that is not a count or a share has a unit, its own or that of its type."""
    fields = candidate.skill.Ports.model_fields.items()
    lacking = [name for name, field in fields if _lacks_unit(field)]
    _hold(not lacking, f"ports without a unit: {', '.join(lacking)}")


def example_succeeds(candidate: Candidate) -> None:
    """In its scenario, within the limits of the arm."""
    leaf = candidate.example_run
    _hold(leaf.status == "SUCCESS", f"its example fails: {leaf.code}: {leaf.reason}")
    clipped = candidate.run_twice.clipped_setpoints
    _hold(clipped == 0, f"{clipped} set-points were beyond the limits of the arm")


def halted_skill_leaves_the_arm_stopped(candidate: Candidate, phase: float) -> None:
    """The arm stands within a simulated second, in whatever phase, and it stays so."""
    seconds = max(_SHORTEST_S, phase * candidate.duration)
    performance = candidate.perform(after(seconds, candidate.node), {"wait": {"seconds": 1.5}})
    (leaf,) = performance.leaves(candidate.name)
    if leaf.status == "INVALID":
        _hold(leaf.code == "HALTED", f"its code is {leaf.code}, not HALTED")
        _hold(leaf.reason == "", leaf.reason)
    speed = performance.speed_after((leaf.ended_s or 0.0) + STOPPING_S)
    _hold(speed < STOPPED, f"{STOPPING_S:g} s after the halt a joint moves by {speed:.3f} rad/s")
    _hold_outcome(performance)


def starts_again_after_success(candidate: Candidate) -> None:
    """The same leaf, run twice: it begins anew, with nothing left over."""
    first, *more = candidate.examples
    _hold(bool(more), f"the first run fails: {first.code}: {first.reason}")
    (second,) = more
    again = candidate.scenario.again
    _hold(second.status == again, f"the second is {second.status}, not {again}: {second.reason}")
    known = ("", *candidate.skill.failures)
    _hold(second.code in known, f"the second fails with {second.code}, which is not declared")


def starts_again_after_it_was_halted(candidate: Candidate) -> None:
    """Halted in its middle at first, given all its time then: it does its job."""
    timeout = {"timeout": {"seconds": "{limit}", "child": candidate.node}}
    forgiven: Tree = {"force_success": {"child": timeout}}
    lengthen: Tree = {"set": {"key": "limit", "value": 60.0}}
    half = max(_SHORTEST_S, 0.5 * candidate.duration)
    performance = candidate.perform(
        {"set": {"key": "limit", "value": half}},
        {"repeat": {"times": 2, "child": {"sequence": [forgiven, lengthen]}}},
    )
    first, second = _last_two(candidate, performance)
    begins = [("INVALID", "HALTED"), ("SUCCESS", "")]
    _hold((first.status, first.code) in begins, f"when halted: {first.code}: {first.reason}")
    if first.status == "INVALID" and candidate.scenario.again == "SUCCESS":
        _hold(second.status == "SUCCESS", f"after a halt: {second.code}: {second.reason}")


def never_started_and_never_heard_of(candidate: Candidate) -> None:
    """A leaf that its tree never reaches is halted with it, without a word."""
    performance = candidate.perform({"selector": [{"succeed": {}}, candidate.node]})
    found = [leaf for leaf in performance.leaves(candidate.name) if "selector" in leaf.path]
    _hold(not found, "it was started though its tree never came to it")
    _hold_outcome(performance)


def _lacks_unit(field: FieldInfo) -> bool:
    if field.annotation not in (float, float | None):
        return False
    extra = field.json_schema_extra
    if (isinstance(extra, dict) and extra.get("unit")) or metadata_of(field, Unit):
        return False
    return not any(word in (field.description or "") for word in _UNITLESS)


def _last_two(candidate: Candidate, performance: Performance) -> tuple[LeafReport, LeafReport]:
    """Runs of the leaf on trial: those of the scenario's own leaves come first."""
    runs = performance.leaves(candidate.name)
    _hold(len(runs) >= 2, f"it was run {len(runs)} times, not twice")
    return runs[-2], runs[-1]


def _hold_outcome(performance: Performance) -> None:
    outcome = performance.result.outcome
    _hold(outcome == "SUCCESS", f"its arm's tree ends as {outcome}")


def _hold(truth: bool, otherwise: str) -> None:
    if not truth:
        raise BrokenLawError(otherwise)


LAWS: Final[Mapping[str, Law]] = MappingProxyType(
    {
        "author forgot nothing": author_forgot_nothing,
        "numbers of ports say their unit": numbers_of_ports_say_their_unit,
        "example succeeds": example_succeeds,
        **{
            f"leaves the arm stopped when halted at {phase:.0%}": partial(
                halted_skill_leaves_the_arm_stopped, phase=phase
            )
            for phase in _PHASES
        },
        "starts again after success": starts_again_after_success,
        "starts again after it was halted": starts_again_after_it_was_halted,
        "never started and never heard of": never_started_and_never_heard_of,
    }
)
"""Every law by its name."""
