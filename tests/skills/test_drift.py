"""A repeated curve returns to its start, or the check reports by how much it drifts."""

from __future__ import annotations

from typing import Any

import pytest

import bt_dualarm as bt
from bt_dualarm.core.errors import Failure
from bt_dualarm.runtime.api import registry_of
from bt_dualarm.trajectory.paths import CartesianPath

TREE = """\
bt_dualarm: 1
world: {scene: empty}
arms:
  arm1:
    robot: ur5
    posture: present
    tree: {%s}
"""

TRIANGLE = "points: [[0.08, 0.0], [0.0, 0.06], [-0.05, 0.01]]"
CURVES = [
    "circle: {radius: 0.05}",
    "circle: {radius: 0.05, begin: 30, turns: 2, plane: xy}",
    "circle: {radius: 0.05, end: center, turns: 0.3}",
    "circle: {radius: 0.05, start: from, turns: 2}",
    "circle: {radius: 0.05, start: from, turns: 0.3, direction: clockwise}",
    "circle: {radius: 0.05, start: from, end: center}",
    "lissajous: {amplitudes: [0.05, 0.02]}",
    "lissajous: {amplitudes: [0.05, 0.02], phase: 40, repeats: 2}",
    "lissajous: {amplitudes: [0.05, 0.02], phase: 40, end: center, repeats: 0.4}",
    "lissajous: {amplitudes: [0.05, 0.02], phase: 40, start: from}",
    "lissajous: {amplitudes: [0.05, 0.02], phase: 40, start: from, end: center}",
    f"draw: {{{TRIANGLE}}}",
    f"draw: {{{TRIANGLE}, end: center}}",
    f"draw: {{{TRIANGLE}, closed: false}}",
    f"draw: {{{TRIANGLE}, start: from}}",
    f"draw: {{{TRIANGLE}, start: from, closed: false}}",
    f"draw: {{{TRIANGLE}, start: from, end: center}}",
    "follow_path: {points: [[0, 0], [80, 0], [80, 50]]}",
    "follow_path: {points: [[9, 0], [80, 0], [80, 50]], start: around, scale: 0.0005}",
    "follow_path: {points: [[9, 0], [80, 0], [80, 50]], start: around, closed: true}",
    "follow_path: {points: [[9, 0], [80, 0], [80, 50]], closed: true}",
]


@pytest.mark.parametrize("curve", CURVES)
def test_declared_shift_of_a_curve_matches_its_path(
    curve: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The declaration is what the check reads; the path is what the skill would follow."""
    found: list[float] = []

    def along(skill: Any, path: CartesianPath, *, to_center: bool = False, **_: Any) -> Any:
        end = path.center if to_center else path.end
        assert end is not None
        found.append(end.distance(skill.arm.commanded_tool_pose))
        declared = skill.shift(skill.ports)
        assert declared is not None
        found.append(declared[0])
        raise Failure("BUSY", "seen")
        yield

    monkeypatch.setattr(bt.PathSkill, "along", along)
    bt.run(TREE % curve)
    moved, declared = found
    assert moved == pytest.approx(declared, abs=1e-9)


@pytest.mark.parametrize(
    ("tree", "message"),
    [
        ("repeat: {times: 3, child: {circle: {radius: 0.05}}}", "50 mm"),
        ("repeat: {times: 3, child: {sequence: [{wait: 1}, {circle: {radius: 0.05}}]}}", "50 mm"),
        ("while: {condition: {compare: {value: 1, to: 1}}, child: circle}", "100 mm"),
        ("repeat: {times: forever, child: {repeat: {times: 2, child: circle}}}", "100 mm"),
        ("repeat: {times: 2, child: {circle: {start: from, turns: 0.25}}}", "141 mm"),
        # It returns, something else moves the arm, or the shift is not known statically.
        ("repeat: {times: 3, child: {circle: {end: center}}}", ""),
        ("repeat: {times: 3, child: {circle: {start: from}}}", ""),
        ("repeat: {times: 3, child: {sequence: [circle, go_home]}}", ""),
        ("repeat: {times: 3, child: {selector: [circle, {wait: 1}]}}", ""),
        ("retry: {times: 3, child: circle}", ""),
        ("repeat: {times: 3, child: {lissajous: {repeats: 0.3}}}", ""),
        (
            "sequence: [{set: {key: r, value: 0.1}}, "
            '{repeat: {times: 3, child: {circle: {radius: "{r}"}}}}]',
            "",
        ),
    ],
)
def test_check_warns_of_drift(tree: str, message: str) -> None:
    warnings = [problem for problem in bt.check(TREE % tree) if "repetition" in problem.message]
    assert [problem.severity for problem in warnings] == ["warning"] * bool(message)
    for problem in warnings:
        assert f"each repetition moves the tool by {message}" in problem.message
        assert "the tool back" in problem.hint


def test_repeated_circle_that_ends_at_its_center_does_not_drift() -> None:
    """Executed, not only declared; a circle that ends on its rim drifts by the declared shift."""
    for end, moved in (("center", 0.0), ("rim", 0.06)):
        circle = f"circle: {{radius: 0.03, speed: 1.0, end: {end}}}"
        tree = f"repeat: {{times: 2, child: {{{circle}}}}}"
        with bt.open(TREE % tree) as run:
            start = run.arms["arm1"].tool_pose
            assert run.finish().outcome is bt.Outcome.SUCCESS
            drift = run.arms["arm1"].tool_pose.distance(start)
        assert drift == pytest.approx(moved, abs=1e-3)


def test_check_does_not_warn_of_skills_without_a_declared_shift() -> None:
    """Only the curves declare one; a user's skill may, too."""

    class Creep(bt.Skill):
        """Move a little to one side."""

        example = "creep"

        def run(self) -> bt.Ticks:
            yield

        @classmethod
        def shift(cls, ports: Any) -> tuple[float, str] | None:
            return 0.02, "creep back"

    repeated = TREE % "repeat: {times: 2, child: creep}"
    (problem,) = bt.check(repeated, skills=[Creep])
    assert "20 mm" in problem.message
    known = {
        name
        for name, skill in registry_of().skills.items()
        if skill.shift.__func__ is not bt.Skill.shift.__func__  # type: ignore[attr-defined]  # class methods
    }
    assert known == {"circle", "lissajous", "draw", "follow_path"}
