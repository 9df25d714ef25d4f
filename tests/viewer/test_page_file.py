"""A record exported as one file is the page of `bt-replay`, and gives the same answers."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import zlib
from itertools import pairwise
from pathlib import Path

import pytest

from bt_dualarm.core.share import share_dir
from bt_dualarm.replay.record import Record
from bt_dualarm.runtime.summary import json_ready
from bt_dualarm.spec.yaml_reader import Json
from bt_dualarm.viewer.past import RecordView, html_of, page_data
from bt_dualarm.viewer.server import whole_page
from tests.replay.runs import SHORT, WATCHING, recorded
from tests.viewer.test_past import FAILING

RECORD = re.compile(r'<script type="text/plain" id="record">([A-Za-z0-9+/=]+)</script>')

ASK = """\
const fs = require("fs");
const [page, scene, ...asked] = process.argv.slice(2);
const text = /id="record">([^<]+)</.exec(fs.readFileSync(page, "utf8"))[1];
const script = fs.readFileSync(scene, "utf8").split("\\n// ----")[0] + SOURCE;
const run = new Function("text", "asked", script + `
  return (async () => {
    const source = keptSource(await inflated(text)), found = [];
    for (const what of asked) found.push(await source.ask(what).catch(error => error.message));
    const [mesh] = Object.keys((await inflated(text)).meshes);
    return { found, eye: source.eye("arm1", 0.2), mesh: (await source.mesh(mesh)).byteLength };
  })();`);
run(text, asked).then(said => console.log(JSON.stringify(said)));
"""


def kept(page: str) -> Json:
    """Record embedded in a page."""
    [text] = RECORD.findall(page)
    found: Json = json.loads(zlib.decompress(base64.b64decode(text)))
    return found


@pytest.fixture(scope="module")
def failed(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return recorded(tmp_path_factory.mktemp("failed"), FAILING)


def answers(record: Record, page: Path, *questions: str) -> Json:
    """Answers of the page's own script."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("there is no node to run the page's script")
    pages = share_dir("assets") / "pages"
    page.write_text(html_of(record), encoding="utf-8")
    script = page.with_suffix(".js")
    source = json.dumps((pages / "source.js").read_text(encoding="utf-8"))
    script.write_text(ASK.replace("SOURCE", source), encoding="utf-8")
    command = [node, str(script), str(page), str(pages / "scene.js"), *questions]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    reply: Json = json.loads(done.stdout)
    return reply


def test_file_is_the_replay_page_and_connects_nowhere(failed: Record) -> None:
    """Only its content policy and the embedded record differ."""
    page = html_of(failed)
    served = whole_page()
    assert "connect-src 'none'" in page
    assert "connect-src 'self'" in served
    alone = RECORD.sub("", page).replace("connect-src 'none'", "connect-src 'self'")
    assert alone == served
    assert page.count("</script>") == served.count("</script>") + 1
    assert kept(page) == json.loads(json.dumps(json_ready(page_data(failed))))


def test_file_gives_the_same_answers_as_the_server(failed: Record, tmp_path: Path) -> None:
    """At every state, and for every node."""
    view = RecordView(failed.folder)
    times = [moment["time"] for moment in page_data(failed)["moments"]]
    assert {round(float(event["time_s"]), 4) for event in failed.events} <= {*times}
    assert max(later - time for time, later in pairwise(times)) < 0.0401
    nodes = ["arm1:sequence", "arm1:sequence/reach_to_pose", "arm1:sequence/aside/reach_to_pose"]
    questions = [f"at?t={time}" for time in times]
    questions += [
        "now",
        "log?after=0",
        "series?after=0",
        "why",
        *(f"why?of={node}" for node in nodes),
    ]
    questions += [f"scene?generation={number}" for number in failed.models]
    reply = answers(failed, tmp_path / "page.html", *questions)
    found = dict(zip(questions, reply["found"], strict=True))
    for what, has in found.items():
        name, _, query = what.partition("?")
        given = dict(pair.split("=") for pair in query.split("&") if pair)
        answer = json.loads(view.questions[name](given).content)
        assert has == json.loads(json.dumps(json_ready(answer))), what
    assert reply["mesh"] in {len(mesh) for mesh in view.past.looks(0).meshes.values()}


def test_file_explains_a_running_node(failed: Record, tmp_path: Path) -> None:
    """An unknown node has no answer."""
    questions = ["why?of=arm1:sequence&t=0.3", "why?of=0.3", "why?of=arm1:nonsense"]
    reply = answers(failed, tmp_path / "page.html", *questions)
    running, then, none = reply["found"]
    assert [story["status"] for story in running["stories"]] == ["RUNNING"]
    assert then == running
    assert none == "this page has no answer to that"


def test_file_contains_camera_images(tmp_path: Path) -> None:
    record = recorded(tmp_path, WATCHING)
    reply = answers(record, tmp_path / "page.html", "now")
    kind, _, text = str(reply["eye"]).partition(",")
    assert kind == "data:image/jpeg;base64"
    assert base64.b64decode(text).startswith(b"\xff\xd8")


def test_text_of_a_tree_cannot_end_the_script(tmp_path: Path) -> None:
    reply = SHORT.replace(
        "- subtree", "- set: {key: other, value: '</script><b>'}\n        - subtree"
    )
    page = html_of(recorded(tmp_path, reply))
    assert page.count("</script>") == 2
    assert "</script><b>" in json.dumps(kept(page))
