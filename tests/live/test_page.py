"""The page in a real browser: it shows what goes on, its buttons work, it asks nobody else."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from threading import Thread

import pytest

import bt_dualarm
from bt_dualarm.live.past_answers import RecordView
from bt_dualarm.live.served import Served
from bt_dualarm.live.view import LiveView
from bt_dualarm.runtime.signals import StopRequest
from tests.live.chromium import Tab, chromium
from tests.replay.runs import recorded

pytestmark = pytest.mark.slow

TWO = """\
bt_dualarm: 1
name: two
world: {scene: empty, time_limit: 60}
objects:
  ball: {shape: sphere, size: [0.05], mass: 1, pose: {xyz: [1, 1, 0.05]}}
arms:
  left:
    robot: ur3
    base: {xyz: [0, 0.8, 0]}
    tree:
      sequence:
        - set: {key: goal, value: 1}
        - repeat:
            times: 20
            child: {circle: {plane: yz, radius: 0.05}}
  right:
    robot: xarm7
    base: {xyz: [0, -0.8, 0]}
    camera: {mount: wrist}
    tree:
      selector:
        - reach_to_pose: {to: {xyz: [4, 0, 0.3], rpy: [180, 0, 0]}}
        - wait: {seconds: 30}
"""

SHOWN = "document.querySelectorAll('.node').length"
PIXELS = """(() => { show(); const canvas = document.getElementById('canvas');
  const copy = document.createElement('canvas');
  copy.width = canvas.width; copy.height = canvas.height;
  const pen = copy.getContext('2d'); pen.drawImage(canvas, 0, 0);
  const found = new Set(), all = pen.getImageData(0, 0, copy.width, copy.height).data;
  for (let i = 0; i < all.length; i += 400) found.add(all[i] + 256 * all[i + 1]);
  return found.size; })()"""


def click(tab: Tab, what: str) -> None:
    tab.value(f"document.querySelector({what!r}).click()")


@pytest.fixture
def live(tmp_path: Path) -> Iterator[LiveView]:
    """A run of two arms that is held, and advanced in a thread."""
    stop = StopRequest()
    with (
        bt_dualarm.open(TWO, stop=stop, record=tmp_path / "out") as run,
        LiveView(run, stop) as view,
    ):

        def finish() -> None:
            view.gate.hold()
            run.finish()

        thread = Thread(target=finish)
        thread.start()
        yield view
        stop.ask()
        thread.join(60)
        assert run.kept is not None
        run.kept.recorder.close()


def test_a_run_is_shown_held_looked_back_at_and_explained(live: LiveView, tmp_path: Path) -> None:
    with chromium(tmp_path / "profile") as tab:
        tab.open(live.url)
        assert tab.wait(SHOWN) == 7
        titles = tab.value("[...document.querySelectorAll('#trees h2')].map(x => x.innerText)")
        assert [title.split() for title in titles] == [["left", "ur3"], ["right", "xarm7"]]
        assert tab.wait("document.getElementById('chip').textContent") == "HELD"
        click(tab, "#go")
        tab.wait("page.live.time > 0.5 && document.querySelector('.node.FAILURE') !== null")
        assert tab.value("document.getElementById('chip').textContent") == "RUNNING"
        click(tab, "#go")
        tab.wait("document.getElementById('chip').textContent === 'HELD'")
        held = tab.value("page.live.time")
        assert tab.value(PIXELS) > 50, "a scene, not one colour"
        click(tab, "#step")
        tab.wait(f"page.live.time > {held} && page.live.held")
        assert tab.value("page.live.time") == pytest.approx(held + 0.002, abs=1e-4)
        click(tab, ".node.FAILURE:not(:first-child)")
        told = tab.wait("document.querySelector('#why .cause')?.textContent")
        assert "reach" in told
        click(tab, "[data-panel=boards]")
        assert "goal" in tab.wait("document.querySelector('#boards td + td')?.textContent")
        tab.value("goTo(0.1)")
        tab.wait("document.getElementById('chip').textContent === 'LOOKING BACK'")
        assert tab.value("page.shown.time") == pytest.approx(0.1, abs=0.02)
        click(tab, "#live")
        assert tab.value("document.getElementById('chip').textContent") == "HELD"
        assert tab.errors == []
        assert [url for url in tab.requests if not url.startswith((live.url, "data:"))] == []


def test_a_record_is_played(tmp_path: Path) -> None:
    record = recorded(tmp_path)
    served = Served(RecordView(record.folder))
    served.begin()
    try:
        with chromium(tmp_path / "profile") as tab:
            tab.open(served.url)
            tab.wait(SHOWN)
            assert tab.value("document.getElementById('tick').hidden")
            click(tab, "#go")
            tab.wait("page.shown.time > 0.5")
            tab.value(f"goTo({record.until})")
            tab.wait("document.querySelectorAll('.node.SUCCESS').length === 5")
            tab.wait(f"{PIXELS} > 50")  # a scene, not one colour
            assert tab.errors == []
    finally:
        served.end()
