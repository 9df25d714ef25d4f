"""A skill that uses its arm in a wrong way, of which there are many."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from bt_dualarm import Arm, PortModel, SetPoint, Skill, Trajectory, camera_now, port


def trajectory(arm: Arm, **changed: Any) -> Trajectory:
    """Half a second of rest, with some arrays or the period changed."""
    q = np.tile(arm.setpoint.q, (125, 1))
    parts: dict[str, Any] = {
        "dt": arm.period,
        "q": q,
        "v": np.zeros_like(q),
        "a": np.zeros_like(q),
    } | changed
    return Trajectory(**parts)


def following(**changed: Callable[[Arm], Any]) -> Callable[[Arm], Iterator[float | None]]:
    def act(arm: Arm) -> Iterator[float | None]:
        parts = {name: change(arm) for name, change in changed.items()}
        yield from arm.follow(trajectory(arm, **parts))

    return act


def streaming(make: Callable[[Arm], object]) -> Callable[[Arm], Iterator[float | None]]:
    def act(arm: Arm) -> Iterator[float | None]:
        given: Any = make(arm)
        arm.stream(lambda _: given)
        for _ in range(20):
            yield None

    return act


def traveling(goals: Callable[[Arm], Any], speed: float = 0.5) -> Callable[[Arm], Any]:
    return lambda arm: arm.travel(goals(arm), speed)


def jumped(arm: Arm) -> Any:
    q = np.tile(arm.setpoint.q, (125, 1))
    q[60:] += 1.0
    return q


def bending(arm: Arm) -> Iterator[float | None]:
    start = arm.setpoint.q
    share = np.linspace(0.0, 1.0, 2000)[:, None]
    smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    step = np.zeros_like(start)
    step[0] = 4.0
    q = start + smooth * step
    v = np.gradient(q, arm.period, axis=0)
    yield from arm.follow(Trajectory(arm.period, q, v, np.gradient(v, arm.period, axis=0)))


def calling(act: Callable[[Arm], object]) -> Callable[[Arm], Iterator[float | None]]:
    def run(arm: Arm) -> Iterator[float | None]:
        act(arm)
        yield None

    return run


MISTAKES: dict[str, Callable[[Arm], Iterator[float | None]]] = {
    "no goal": traveling(lambda _: []),
    "a goal without a list": traveling(lambda arm: arm.q),
    "a goal of two joints": traveling(lambda _: [np.zeros(2)]),
    "speed 0": traveling(lambda arm: [arm.q], 0.0),
    "speed 2": traveling(lambda arm: [arm.q], 2.0),
    "a configuration of two joints": calling(lambda arm: arm.refuse_collision(np.zeros(2))),
    "no camera": calling(camera_now),
    "a stream of arrays": streaming(lambda arm: arm.q),
    "a stream of lists": streaming(lambda arm: SetPoint(arm.q.tolist(), [0], [0])),  # type: ignore[arg-type]
    "a stream of two joints": streaming(lambda _: SetPoint(*np.zeros((3, 2)))),
    "another period": following(dt=lambda _: 0.1),
    "two joints": following(**dict.fromkeys("qva", lambda _: np.zeros((9, 2)))),
    "no numbers": following(v=lambda arm: np.full((125, arm.robot.dof), np.nan)),
    "a jump": following(q=jumped),
    "no rest": following(v=lambda arm: np.full((125, arm.robot.dof), 0.1)),
    "beyond a limit": bending,
    "too fast": following(a=lambda arm: np.full((125, arm.robot.dof), 1e4)),
}


class Mistaken(Skill):
    """Make a mistake."""

    class Ports(PortModel):
        mistake: str = port(..., "the mistake")

    example = "mistaken: {mistake: no goal}"
    ports: Ports

    def run(self) -> Iterator[float | None]:
        yield from MISTAKES[self.ports.mistake](self.arm)


class Writing(Skill):
    """Change what the arm returns, and move there: it is the skill's own copy."""

    class Ports(PortModel):
        what: str = port(..., "q or setpoint")

    example = "writing: {what: q}"
    ports: Ports

    def run(self) -> Iterator[float | None]:
        q = self.arm.q if self.ports.what == "q" else self.arm.setpoint.q
        q[0] += 0.3
        self.metrics["kept"] = bool(abs(self.arm.setpoint.q[0] - q[0]) > 0.2)
        yield from self.arm.travel([q], 0.5)
        self.metrics["error_rad"] = float(np.abs(self.arm.q - q).max())
