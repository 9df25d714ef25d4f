"""Terminal display, compared with golden texts; ``UPDATE_GOLDEN=1`` rewrites them."""

from __future__ import annotations

import io
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.console import Console

from bt_dualarm.behaviors.report import NodeView, StatusChange
from bt_dualarm.runtime.arm_runtime import ArmView, halted
from bt_dualarm.runtime.display import (
    Caption,
    LiveDisplay,
    LogDisplay,
    Mode,
    Picture,
    QuietDisplay,
    draw_tree,
    open_display,
    shared_heights,
    suited_mode,
    suited_symbols,
)
from bt_dualarm.runtime.outcome import Outcome
from bt_dualarm.runtime.report import ASCII, UNICODE, Symbols

GOLDEN = Path(__file__).parent / "golden"

CARRYING = NodeView(
    "pick and show",
    "sequence",
    "RUNNING",
    0.0,
    children=(
        NodeView("approach_and_attach", "approach_and_attach", "SUCCESS", 4.1),
        NodeView(
            "retry",
            "retry",
            "SUCCESS",
            8.0,
            children=(NodeView("transport", "transport", "SUCCESS", 8.0),),
        ),
        NodeView(
            "curves",
            "sequence",
            "RUNNING",
            8.0,
            children=(
                NodeView("circle", "circle", "RUNNING", 10.3, progress=0.54),
                NodeView("lissajous", "lissajous", "INVALID", 0.0),
            ),
        ),
        NodeView("detach", "detach", "INVALID", 0.0),
    ),
)
TRACKING = NodeView(
    "sequence",
    "sequence",
    "FAILURE",
    12.3,
    children=(
        NodeView("reach_to_pose", "reach_to_pose", "SUCCESS", 2.2),
        NodeView(
            "track",
            "track",
            "FAILURE",
            12.3,
            reason="TARGET_LOST: the yellow target was not seen for 2.0 s, "
            "and the search found nothing within 5.0 s",
        ),
    ),
)
ARMS = (
    ArmView("arm1", "ur5", None, CARRYING),
    ArmView("arm2", "panda", Outcome.FAILURE, TRACKING),
    ArmView("spare", "xarm7", None, None),
)


def check_golden(name: str, text: str) -> None:
    path = GOLDEN / name
    if os.environ.get("UPDATE_GOLDEN"):
        path.write_text(text, encoding="utf-8")
    assert text == path.read_text(encoding="utf-8")


def plain_console(width: int, height: int = 40) -> Console:
    return Console(
        file=io.StringIO(), width=width, height=height, color_system=None, legacy_windows=False
    )


def printed(console: Console) -> str:
    file = console.file
    assert isinstance(file, io.StringIO)
    return "".join(line.rstrip() + "\n" for line in file.getvalue().splitlines())


@pytest.mark.parametrize("width", [40, 80, 140])
@pytest.mark.parametrize("symbols", [UNICODE, ASCII], ids=["unicode", "ascii"])
def test_the_display_equals_its_golden_text(width: int, symbols: Symbols) -> None:
    console = plain_console(width)
    console.print(Picture("pick_and_track", 12.34, 5.63, "ray", ARMS, symbols))
    text = printed(console)
    alphabet = "ascii" if symbols is ASCII else "unicode"
    check_golden(f"picture_{width}_{alphabet}.txt", text)
    assert max(cell_len(line) for line in text.splitlines()) <= width
    assert symbols is UNICODE or text.isascii()


@pytest.mark.parametrize("height", [8, 12, 16])
def test_a_low_terminal_shows_the_running_nodes(height: int) -> None:
    console = plain_console(80, height)
    console.print(Picture("pick_and_track", 12.34, 5.63, "ray", ARMS[:1], UNICODE))
    lines = printed(console).splitlines()
    assert len(lines) < height
    assert any("circle" in line and "54%" in line for line in lines)


def test_finished_nodes_are_folded_first() -> None:
    lines = [line.plain.rstrip() for line in draw_tree(CARRYING, 12.34, 60, 7, UNICODE)]
    assert not [line for line in lines if "transport" in line]
    assert [line for line in lines if "lissajous" in line]


NAMES = st.text(st.characters(categories=["L", "N", "Z", "S"]), min_size=1, max_size=30)
NODES = st.recursive(
    st.builds(
        NodeView,
        name=NAMES,
        kind=st.just("skill"),
        status=st.sampled_from(["INVALID", "RUNNING", "SUCCESS", "FAILURE"]),
        since=st.floats(0, 10),
        progress=st.none() | st.floats(-1, 2),
        reason=st.just("") | NAMES,
    ),
    lambda inner: st.builds(
        NodeView,
        name=NAMES,
        kind=st.just("sequence"),
        status=st.sampled_from(["INVALID", "RUNNING", "SUCCESS", "FAILURE"]),
        since=st.floats(0, 10),
        children=st.lists(inner, min_size=1, max_size=3).map(tuple),
    ),
    max_leaves=12,
)


@given(root=NODES, width=st.integers(20, 150), height=st.integers(1, 30))
def test_every_tree_fits_its_lines(root: NodeView, width: int, height: int) -> None:
    lines = draw_tree(root, 10.0, width, height, UNICODE)
    assert 1 <= len(lines) <= height
    assert all("\n" not in line.plain for line in lines)


@given(st.lists(st.integers(1, 60), min_size=1, max_size=6), st.integers(1, 80))
def test_lines_are_shared_so_that_small_trees_are_complete(
    needs: list[int], available: int
) -> None:
    heights = shared_heights(needs, available)
    assert sum(heights) <= max(available, 3 * len(needs))
    assert all(height <= need for height, need in zip(heights, needs, strict=True))
    if sum(needs) <= available:
        assert heights == needs


def change(old: str, new: str, code: str = "", reason: str = "") -> StatusChange:
    return StatusChange(12.3456, "arm1", "main/circle", "circle", old, new, code, reason)  # type: ignore[arg-type]


def test_the_log_is_a_line_per_change() -> None:
    console = plain_console(40)
    display = LogDisplay(console, ASCII)
    display.on_event(change("INVALID", "RUNNING"))
    display.on_event(change("RUNNING", "INVALID", "HALTED"))
    display.on_event(change("RUNNING", "FAILURE", "UNREACHABLE", "0.31 m beyond [its] reach"))
    check_golden("log.txt", printed(console))


@pytest.mark.parametrize(("symbols", "sign"), [(UNICODE, "■"), (ASCII, "#")])
def test_halted_nodes_differ_from_nodes_that_never_ran(symbols: Symbols, sign: str) -> None:
    """Both are INVALID: after Ctrl-C all of them looked as if they had not begun."""
    leaves = (
        NodeView("circle", "circle", "INVALID", 10.0, halted=True),
        NodeView("lissajous", "lissajous", "INVALID", 0.0),
    )
    root = NodeView("main", "sequence", "INVALID", 10.0, children=leaves, halted=True)
    lines = [line.plain.rstrip() for line in draw_tree(root, 12.34, 60, 9, symbols)]
    assert lines[0].startswith(f"{sign} main")
    assert f"{sign} circle" in lines[1]
    assert lines[1].endswith("2.3 s ago")
    assert lines[2].endswith(f"{symbols.status['INVALID']} lissajous")


def test_an_interrupted_run_shows_the_nodes_that_it_halted() -> None:
    """Nodes that had ended stay unchanged."""
    view = halted(CARRYING, 12.0)
    assert (view.halted, view.status, view.since) == (True, "INVALID", 12.0)
    attach, _, curves, detach = view.children
    assert attach == CARRYING.children[0]
    assert [leaf.halted for leaf in curves.children] == [True, False]
    assert not detach.halted


class Run:
    """A run that does not advance."""

    time = 12.34

    def views(self) -> tuple[ArmView, ...]:
        return ARMS


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def live_terminal() -> Console:
    return Console(file=io.StringIO(), force_terminal=True, width=80, height=40)


def drawn(console: Console) -> str:
    file = console.file
    assert isinstance(file, io.StringIO)
    return file.getvalue()


def test_live_draws_ten_times_a_second_at_most() -> None:
    console = live_terminal()
    clock = Clock()
    with LiveDisplay(console, UNICODE, Caption("task"), clock) as display:
        for tick in range(1000):  # ten seconds of wall clock, a tick each 10 ms
            clock.now = tick * 0.01
            display.after_ticks(Run())
    assert 95 <= drawn(console).count("pick and show") <= 102


def test_live_restores_the_cursor_even_if_the_run_raises() -> None:
    console = live_terminal()

    def break_while_drawing() -> None:
        with LiveDisplay(console, UNICODE, Caption("task"), Clock()) as display:
            display.after_ticks(Run())
            raise RuntimeError

    with pytest.raises(RuntimeError):
        break_while_drawing()
    assert drawn(console).rindex("\x1b[?25h") > drawn(console).rindex("\x1b[?25l")


def test_live_keeps_the_last_state_on_screen() -> None:
    console = live_terminal()
    clock = Clock()
    with LiveDisplay(console, UNICODE, Caption("task"), clock) as display:
        display.after_ticks(Run())
        late = Run()
        late.time = 99.9
        display.after_ticks(late)  # too early to be drawn
    assert "99.9 s" in drawn(console)


def test_the_last_frame_leaves_the_real_time_factor_to_the_report() -> None:
    """Both once showed it, two lines apart, with values that differed by the time to stop arms."""
    console = live_terminal()
    clock = Clock()
    with LiveDisplay(console, UNICODE, Caption("task"), clock) as display:
        for clock.now in (0.0, 10.0):
            display.after_ticks(Run())
    assert "1.2× real time" in drawn(console)  # noqa: RUF001 - as it is shown
    last = drawn(console).rpartition("task")[2]
    assert "real time" not in last


@pytest.mark.parametrize(
    ("terminal", "term", "wish", "mode"),
    [
        (True, "xterm", None, "live"),
        (True, "xterm", "log", "log"),
        (True, "dumb", None, "log"),
        (True, "dumb", "live", "log"),
        (False, "xterm", None, "log"),
        (False, "xterm", "live", "log"),
        (False, "xterm", "quiet", "quiet"),
    ],
)
def test_the_mode_suits_the_terminal(
    terminal: bool, term: str, wish: Mode | None, mode: Mode
) -> None:
    console = Console(file=io.StringIO(), force_terminal=terminal, _environ={"TERM": term})
    assert suited_mode(console, wish) == mode


def test_no_color_removes_only_the_colors() -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=80, _environ={"NO_COLOR": "1"})
    console.print(Picture("task", 1.0, None, "", ARMS, UNICODE))
    assert "\x1b[31m" not in drawn(console)
    assert "\x1b[36m" not in drawn(console)


def test_an_encoding_without_the_symbols_gets_ascii() -> None:
    latin = Console(file=io.TextIOWrapper(io.BytesIO(), encoding="latin-1"))
    assert suited_symbols(latin, ascii_only=False) is ASCII
    utf8 = Console(file=io.TextIOWrapper(io.BytesIO(), encoding="utf-8"))
    assert suited_symbols(utf8, ascii_only=False) is UNICODE
    assert suited_symbols(utf8, ascii_only=True) is ASCII


def test_every_mode_has_its_display() -> None:
    console = plain_console(80)
    modes: tuple[Mode, ...] = ("live", "log", "quiet")
    types = [type(open_display(m, console, ASCII, Caption("t"), Clock())) for m in modes]
    assert types == [LiveDisplay, LogDisplay, QuietDisplay]


def test_quiet_shows_nothing(
    capfd: pytest.CaptureFixture[str],
) -> None:
    shown = {}
    modes: tuple[Mode, ...] = ("quiet", "log", "live")
    for mode in modes:
        console = live_terminal()
        with open_display(mode, console, ASCII, Caption("task"), Clock()) as display:
            display.on_event(change("INVALID", "RUNNING"))
            display.after_ticks(Run())
            display.after_step(0.0)
        shown[mode] = drawn(console)
    assert shown["quiet"] == ""
    assert "RUNNING" in shown["log"]
    assert "task" in shown["live"]
    assert capfd.readouterr() == ("", ""), "nothing bypasses the console"
