"""The page in a real browser: it shows the run, its buttons work, it contacts no other server."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

import pytest

import bt_dualarm
from bt_dualarm.replay.record import Record
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.viewer.live_view import LiveView
from bt_dualarm.viewer.past import RecordView, html_of
from bt_dualarm.viewer.server import Served
from tests.replay.runs import recorded
from tests.viewer.chromium import Tab, chromium

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

# The shipped job until the camera has tracked the held object.
PICKED = """\
bt_dualarm: 1
name: picked
world: {scene: table, reality: lab, time_limit: 60}
objects:
  cube:
    shape: box
    size: [0.05, 0.05, 0.05]
    mass: 0.1
    color: yellow
    pose: {xyz: [0.4, -0.45, 0.425]}
arms:
  arm1:
    robot: ur5
    gripper: robotiq_2f85
    base: {xyz: [0, 0, 0.40]}
    tree:
      sequence:
        - grasp: {object: cube}
        - transport: {object: cube, to: {xyz: [0.68, 0.11, 0.70], rpy: [0, -90, 0]}}
        - wait: {seconds: 0.5}
        - fail: {reason: enough for a test}
  arm2:
    robot: panda
    base: {xyz: [1.60, 0.11, 0.28], rpy: [0, 0, 180]}
    camera: {mount: wrist, resolution: [320, 240], fov: 50, fps: 30}
    tree:
      sequence:
        - reach_to_pose: {posture: look_out}
        - track: {color: yellow, plane: yz, controller: predictive, duration: 5.0}
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


@contextmanager
def viewed(tree: str, folder: Path) -> Iterator[LiveView]:
    """A held run, which a thread advances."""
    stop = StopRequest()
    with bt_dualarm.open(tree, stop=stop, record=folder) as run, LiveView(run, stop) as view:

        def finish() -> None:
            view.gate.hold()
            run.finish()

        thread = Thread(target=finish)
        thread.start()
        yield view
        stop.ask()
        thread.join(60)
        assert run.open_record is not None
        run.open_record.recorder.close()


@pytest.fixture
def live(tmp_path: Path) -> Iterator[LiveView]:
    """A run of two arms."""
    with viewed(TWO, tmp_path / "out") as view:
        yield view


def test_page_shows_holds_rewinds_and_explains_a_run(live: LiveView, tmp_path: Path) -> None:
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
        tab.wait(f"{PIXELS} > 50")  # a scene, not one color
        click(tab, "#step")
        tab.wait(f"page.live.time > {held} && page.live.held")
        assert tab.value("page.live.time") == pytest.approx(held + 0.002, abs=1e-4)
        click(tab, ".node[title^='selector/reach_to_pose']")  # the other arm may fail later
        reported = tab.wait("document.querySelector('#why .cause')?.textContent")
        assert "reach" in reported
        click(tab, "[data-panel=boards]")
        assert "goal" in tab.wait("document.querySelector('#boards td + td')?.textContent")
        tab.value("goTo(0.1)")
        tab.wait("document.getElementById('chip').textContent === 'LOOKING BACK'")
        assert tab.value("page.shown.time") == pytest.approx(0.1, abs=0.02)
        click(tab, "#live")
        assert tab.value("document.getElementById('chip').textContent") == "HELD"
        assert tab.errors == []
        assert [url for url in tab.requests if not url.startswith((live.url, "data:"))] == []


GRIPPER = "document.querySelector('.gripper').textContent"
CAPTIONS = "#signals figure:not([hidden]) figcaption span:first-child"
SIGNALS = f"[...document.querySelectorAll('{CAPTIONS}')].map(x => x.textContent)"
ROWS = "page.tracks.get('arm1').length"
BRIGHT = """(() => { const image = document.querySelector('.eye img');
  if (!image.complete || !image.naturalWidth) return 0;
  const copy = document.createElement('canvas');
  copy.width = image.naturalWidth; copy.height = image.naturalHeight;
  const pen = copy.getContext('2d'); pen.drawImage(image, 0, 0);
  const all = pen.getImageData(0, 0, copy.width, copy.height).data;
  let lit = 0;
  for (let i = 0; i < all.length; i += 4) lit += all[i] + all[i + 1] + all[i + 2] > 60;
  return lit / (all.length / 4); })()"""


def check_gripper_view(tab: Tab, time: float) -> None:
    """Check what every form of the page shows once the run has failed, holding the cube."""
    tab.wait(f"document.querySelector('.gripper') !== null && {GRIPPER}.includes('holds cube')")
    assert "mm open" in tab.value(GRIPPER)
    tab.wait(f"{SIGNALS}.length === 5")  # once the signals have arrived
    assert tab.value(SIGNALS)[-2:] == ["gripper opening (mm)", "gripper force (N)"]
    assert tab.value(ROWS) >= 24 * time
    tab.wait("document.querySelector('#marks button') !== null")
    assert "enough for a test" in tab.value("document.querySelector('#marks button').title")
    tab.wait(f"{BRIGHT} > 0.95")
    tab.wait("document.querySelector('.eye path[fill-rule=evenodd]') !== null")
    tab.wait(f"{PIXELS} > 50")  # a scene, not one color
    click(tab, "#help")
    legend = "document.getElementById('legend')"
    assert tab.value(f"{legend}.open && {legend}.innerText.includes('success, failure')")
    tab.value(f"{legend}.close()")
    click(tab, ".node.FAILURE:not(:first-child)")
    tab.wait("document.querySelector('#why .cause')?.textContent.includes('enough for a test')")


def test_grasping_run_is_shown_live_from_its_record_and_as_a_file(tmp_path: Path) -> None:
    """The page shows the same scene, gripper, signals, failures, images, reasons in each form."""
    folder = tmp_path / "out"
    with chromium(tmp_path / "profile") as tab:
        with viewed(PICKED, folder) as view:
            tab.open(view.url)
            tab.wait(SHOWN)
            tab.wait("document.getElementById('chip').textContent === 'HELD'")
            tab.hover("#go")
            paint = "getComputedStyle(document.getElementById('go'))"
            assert tab.value(f"{paint}.color") == "rgb(255, 255, 255)"
            assert tab.value(f"{paint}.backgroundColor") not in (
                "rgb(255, 255, 255)",
                "rgb(238, 242, 246)",
            )
            assert "physics" in tab.value("document.getElementById('step').title")
            assert "trees" in tab.value("document.getElementById('tick').title")
            tab.value("press('speed', null)")
            click(tab, "#go")
            tab.wait("page.kind === 'record' || page.live.over", 200.0)
            until = tab.wait("page.until")
            check_gripper_view(tab, until)
            own = (view.url, "data:")
        assert [url for url in tab.requests if not url.startswith(own)] == []
        record = Record.read(folder)
        served = Served(RecordView(folder))
        served.begin()
        try:
            tab.open(served.url)
            tab.wait(f"location.href.startsWith({served.url!r}) && {SHOWN}")
            tab.value(f"goTo({record.until})")
            check_gripper_view(tab, record.until)
            assert tab.errors == []
            tab.open("about:blank")  # before the server ends, which the page polls
            tab.wait("location.protocol === 'about:'")
        finally:
            served.end()
        tab.errors.clear()
        asked = len(tab.requests)
        file = tmp_path / "page.html"
        file.write_text(html_of(record), encoding="utf-8")
        tab.open(file.as_uri())
        tab.wait(f"location.protocol === 'file:' && {SHOWN}")
        tab.value(f"goTo({record.until})")
        check_gripper_view(tab, record.until)
        assert tab.errors == []
        loaded = {url for url in tab.requests[asked:] if not url.startswith("data:")}
        assert loaded == {file.as_uri()}


def test_record_is_played(tmp_path: Path) -> None:
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
            tab.wait(f"{PIXELS} > 50")  # a scene, not one color
            assert tab.errors == []
    finally:
        served.end()
