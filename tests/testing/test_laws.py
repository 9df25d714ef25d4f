"""Laws of skills detect violations, and report them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import pytest

from bt_dualarm import Failure, PortModel, Skill, port
from bt_dualarm.skill.registry import Registry, kind_of, yaml_name
from bt_dualarm.testing import LAWS, BrokenLawError, Candidate, registry_with


class Idler(Skill):
    """Waits for some ticks."""

    class Ports(PortModel):
        share: float = port(0.5, "share of nothing", ge=0, le=1)

    example = "idler: {share: 0.1}"

    def run(self) -> Iterator[float | None]:
        for _ in range(20):
            yield None


class Mute(Idler):
    """Has no unit."""

    class Ports(PortModel):
        length: float = port(0.5, "how long")

    example = "wait: 1"


class Unlucky(Idler):
    """Fails."""

    example = "unlucky: {}"

    def run(self) -> Iterator[float | None]:
        yield None
        raise Failure("UNREACHABLE", "it is too far")


class Messy(Idler):
    """Raises during its cleanup."""

    example = "messy: {}"

    def run(self) -> Iterator[float | None]:
        try:
            yield from super().run()
        except GeneratorExit:
            raise ValueError("left in a mess") from None


class OnlyOnce(Idler):
    """Remembers in a class attribute that it has run."""

    example = "only_once: {}"
    starts: ClassVar[list[str]] = []

    def run(self) -> Iterator[float | None]:
        self.starts.append(self.context.name)
        if self.starts.count(self.context.name) > 1:
            raise Failure("UNREACHABLE", "once is enough")
        yield from super().run()


class Hasty(Idler):
    """Begins a motion at once, whether the arm is at rest or not."""

    example = "hasty: {}"

    def run(self) -> Iterator[float | None]:
        yield from self.arm.follow(self.arm.straight_to(self.arm.setpoint.q + 0.1, 0.5))


def candidate(skill: type[Skill]) -> Candidate:
    known = Registry.load()
    name = yaml_name(skill)
    kinds = {**known.kinds, name: kind_of(skill, "the test")}
    return Candidate(name, Registry({**known.skills, name: skill}, kinds))


@pytest.mark.parametrize("law", LAWS)
def test_correct_skill_obeys_every_law(law: str) -> None:
    LAWS[law](Candidate("idler", registry_with(Idler)))


@pytest.mark.parametrize(
    ("skill", "law", "message"),
    [
        (Mute, "declaration is complete", "its example does not begin with 'mute'"),
        (Mute, "numeric ports declare a unit", "ports without a unit: length"),
        (Unlucky, "example succeeds", "its example fails: UNREACHABLE: it is too far"),
        (Messy, "leaves the arm stopped when halted at 50%", "left in a mess"),
        (OnlyOnce, "starts again after success", "once is enough"),
        (OnlyOnce, "starts again after it was halted", "once is enough"),
        (Hasty, "starts while the arm brakes", "the arm moves at .* waits with arm.come_to_rest"),
    ],
    ids=lambda value: value if isinstance(value, str) else yaml_name(value),
)
def test_broken_law_is_reported(skill: type[Skill], law: str, message: str) -> None:
    OnlyOnce.starts.clear()
    with pytest.raises(BrokenLawError, match=message):
        LAWS[law](candidate(skill))
