"""Problems: how they are shown, and suggestions."""

from __future__ import annotations

from bt_dualarm.spec.problems import Location, Problem, SpecError, errors, suggestion


def test_text_of_a_problem() -> None:
    place = Location("t.yaml", 12, 12, 6, "  circle: {raduis: 0.1}")
    assert str(Problem(place, "unknown port 'raduis'", "did you mean 'radius'?")) == (
        "t.yaml:12:12: error: unknown port 'raduis'\n"
        "   12 |   circle: {raduis: 0.1}\n"
        "      |            ^^^^^^\n"
        "      = did you mean 'radius'?"
    )


def test_a_problem_of_the_whole_file_has_no_excerpt() -> None:
    assert str(Problem(Location("t.yaml"), "no such file")) == "t.yaml: error: no such file"


def test_long_lines_are_cut_around_the_position() -> None:
    line = "x" * 300 + "HERE" + "y" * 300
    excerpt = Location("t", 1, 301, 4, line).excerpt.splitlines()
    assert len(excerpt[0]) < 120
    start = excerpt[1].index("^")
    assert excerpt[0][start : start + 4] == "HERE"


def test_control_characters_are_not_shown() -> None:
    assert "\x1b" not in Location("t", 1, 1, 1, "\x1b[31mred").excerpt


def test_problems_are_in_the_order_of_the_file_and_each_once() -> None:
    late = Problem(Location("t", 9, 1), "late")
    early = Problem(Location("t", 2, 5), "early")
    assert SpecError([late, early, late]).problems == (early, late)


def test_warnings_are_no_errors() -> None:
    warning = Problem(Location("t", 1, 1), "hm", severity="warning")
    assert errors([warning]) == ()
    assert warning.as_dict()["severity"] == "warning"


def test_suggestion() -> None:
    assert suggestion("raduis", ["radius", "speed"], "port") == "did you mean 'radius'?"
    assert suggestion("zzz", ["radius", "speed"], "port") == "available: radius, speed"
    assert suggestion("zzz", [], "object") == "no object is available"


def test_a_name_in_another_case_is_the_nearest() -> None:
    assert suggestion("UR5", ["panda", "ur3", "ur5", "xarm7"], "robot") == "did you mean 'ur5'?"
    assert suggestion("Cube", ["ball", "CUBE"], "object") == "did you mean 'CUBE'?"
