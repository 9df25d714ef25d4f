"""Every export of every robot with every gripper has all joints, fingers, cups and objects.

A run has the same robot four times: with each gripper of the catalog, and once without gripper,
spawned and removed while the others close their grippers; one of them fails. Each export is read
back by the usual reader of its format.
"""

from __future__ import annotations

import base64
import csv
import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
import jsonschema
import numpy as np
import pytest
from mcap.reader import make_reader
from pyarrow import parquet

import bt_dualarm
from bt_dualarm import cli
from bt_dualarm.export.mcap import schema_of
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.timeline import finger_joints, gripper_kind, held_over_time
from bt_dualarm.robots.gripper import gripper_names
from bt_dualarm.sim.painter import ScenePainter, StillRenderer, best_viewpoint
from bt_dualarm.sim.renderers import fan_of
from tests.families import some
from tests.sim.worlds import WIDE

FAMILY = """\
bt_dualarm: 1
name: family
world: {{scene: empty, reality: lab, time_limit: 8}}
objects:
  ball:
    {{shape: sphere, size: [0.03], mass: 0.1, pose: {{xyz: [0, -1.5, 0.03]}}, spawned: false}}
arms:
  first:
    robot: {robot}
    gripper: panda_hand
    camera: {{mount: wrist, resolution: [65, 48], fov: 60, fps: 10}}
    tree:
      sequence:
        - spawn: {{arm: late}}
        - spawn: {{object: ball, at: {{xyz: [0, -1.5, 0.03]}}}}
        - close_gripper: {{width: 0.06, force: 40, speed: 0.1, empty: true}}
        - remove: {{arm: late}}
  second:
    robot: {robot}
    gripper: robotiq_2f85
    base: {{xyz: [3, 0, 0]}}
    tree: {{close_gripper: {{width: 0.05, force: 30, empty: true}}}}
  third:
    robot: {robot}
    gripper: suction_cup
    base: {{xyz: [0, 3, 0]}}
    tree: {{close_gripper: {{force: 40}}}}
  late:
    robot: {robot}
    base: {{xyz: [3, 3, 0]}}
    spawned: false
    removable: true
    tree: {{wait: {{seconds: 10}}}}
"""
GRIPPERS = {"first": "fingers", "second": "fingers", "third": "suction", "late": None}


@pytest.fixture(scope="module", params=some(WIDE, 3))
def family(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Record:
    """Record of a run that fails: the third arm's cup has nothing to seal on."""
    folder = tmp_path_factory.mktemp(request.param)
    result = bt_dualarm.run(FAMILY.format(robot=request.param), record=folder)
    assert result.outcome == "FAILURE"
    return Record.read(folder)


def test_every_gripper_of_the_catalog_is_in_the_family() -> None:
    used = {name for name in gripper_names() if f"gripper: {name}\n" in FAMILY}
    assert used == set(gripper_names())


def test_the_record_has_every_gripper_in_every_state(family: Record) -> None:
    for arm, kind in GRIPPERS.items():
        for index in range(len(family.times)):
            model = family.model(family.moment(index).generation)
            state = family.gripper(arm, index)
            assert (state is not None) == (kind is not None)
            assert kind == gripper_kind(model, arm) or arm == "late"
            if state is not None and kind == "fingers":
                moment = family.moment(index)
                fingers = moment.qpos[model.jnt_qposadr[finger_joints(model, arm)]]
                assert state.width == pytest.approx(fingers.sum(), abs=5e-4), "by its encoder"
        last = family.gripper(arm, len(family.times) - 1)
        if last is not None:
            commanded = last.commanded_width, last.commanded_force
            assert commanded == pytest.approx(
                {"first": (0.06, 40), "second": (0.05, 30), "third": (0, 40)}[arm]
            )


def test_mcap_has_all_joints_grippers_and_shapes(family: Record, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    assert cli.record(["export", str(family.folder), "--mcap", str(path)]) == 0
    found: dict[str, list[dict[str, Any]]] = defaultdict(list)
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            content = json.loads(message.data)
            assert schema is not None
            jsonschema.Draft202012Validator(schema_of(schema.name)).validate(content)
            found[channel.topic].append(content)
    bodies: set[str] = {
        frame["child_frame_id"] for message in found["/bodies"] for frame in message["transforms"]
    }
    for arm, kind in GRIPPERS.items():
        model = family.model(family.moment(10).generation)
        names = {model.joint(j).name for j in range(model.njnt)}
        own = {name for name in names if name.startswith(f"{arm}/")}
        for topic in (f"/{arm}/joints", f"/{arm}/set_point"):
            assert own == {joint["name"] for joint in found[topic][-1]["joints"]}
        assert len(found[f"/{arm}/gripper"]) == (len(family.times) if kind else 0)
        shown = next(m for m in found[f"/scene/{arm}"] if m["entities"])
        entities = {entity["id"]: entity for entity in shown["entities"]}
        assert {entity["frame_id"] for entity in entities.values()} <= bodies | {"world"}
        assert any(entity["models"] for entity in entities.values()), "real meshes"
        hands = {f"{arm}/gripper/left", f"{arm}/gripper/right", f"{arm}/gripper/palm"}
        if kind == "suction":
            hands = {f"{arm}/gripper/palm", f"{arm}/gripper/cup"}
        assert (hands <= entities.keys()) == (kind is not None)
        for entity in entities.values():
            for model_ in entity["models"]:
                _check_glb(base64.b64decode(model_["data"]))
    assert len(found["/scene/first"]) == len(found["/scene/third"]) == 1, "they do not change"
    assert found["/scene/late"][-1]["entities"] == [], "it was removed"
    assert found["/scene/late"][-1]["deletions"][0]["type"] == 1
    worlds = [{entity["id"] for entity in m["entities"]} for m in found["/scene/world"]]
    assert "ball" not in worlds[0]
    assert "ball" in worlds[-1]


def _check_glb(content: bytes) -> None:
    """Check against the glTF 2.0 specification: header, two chunks, accessors in their buffer."""
    assert content[:4] == b"glTF"
    version, length, reported = np.frombuffer(content[4:16], "<u4").tolist()
    assert (version, length, content[16:20]) == (2, len(content), b"JSON")
    document = json.loads(content[20 : 20 + reported])
    binary = content[20 + reported + 8 :]
    assert document["buffers"][0]["byteLength"] == len(binary)
    positions, indices = document["accessors"]
    cut = document["bufferViews"][1]["byteOffset"]
    vertices = np.frombuffer(binary[:cut], "<f4").reshape(-1, 3)
    faces = np.frombuffer(binary[cut:], "<u4")
    assert (positions["count"], indices["count"]) == (len(vertices), len(faces))
    assert faces.max() < len(vertices)
    np.testing.assert_allclose(vertices.min(axis=0), positions["min"])


def test_a_data_set_has_all_joints_grippers_and_objects(family: Record, tmp_path: Path) -> None:
    folder = tmp_path / "set"
    assert cli.record(["export", str(family.folder), "--lerobot", str(folder)]) == 0
    info = json.loads((folder / "meta" / "info.json").read_text())
    features = info["features"]
    state = features["observation.state"]["names"]
    action = features["action"]["names"]
    grip = {name for name in state if ".gripper." in name}
    assert grip == {"first.gripper.width", "second.gripper.width", "third.gripper.vacuum"}
    assert {name for name in action if ".gripper." in name} == {
        f"{arm}.gripper.{what}"
        for arm, names in (("first", 3), ("second", 3), ("third", 1))
        for what in ("width", "speed", "force")[-names:]
    }
    model = family.model(family.moment(10).generation)
    joints = {model.joint(j).name.replace("/", ".") for j in range(model.njnt)}
    arms = {name for name in joints if name.partition(".")[0] in GRIPPERS}
    fingers = {name for name in arms if ".gripper." in name}
    assert set(state) - grip == arms - fingers
    frames = parquet.read_table(folder / "data/chunk-000/file-000.parquet")  # type: ignore[no-untyped-call]
    for name in ("observation.state", "observation.velocity", "observation.effort", "action"):
        values = np.array(frames[name].to_pylist())
        assert values.shape == (info["total_frames"], len(features[name]["names"]))
        assert np.isfinite(values).all()
    states = np.array(frames["observation.state"].to_pylist())
    actions = np.array(frames["action"].to_pylist())
    for frame in (0, 5, info["total_frames"] - 1):
        row = family.index_at(family.times[0] + frame / info["fps"])
        first = family.gripper("first", row)
        third = family.gripper("third", row)
        assert first is not None
        assert third is not None
        assert states[frame, state.index("first.gripper.width")] == pytest.approx(first.width)
        commanded = actions[frame, action.index("first.gripper.width")]
        assert commanded == pytest.approx(first.commanded_width)
        assert actions[frame, action.index("third.gripper.force")] == third.commanded_force
    assert features["observation.environment_state"]["names"][:3] == ["ball.x", "ball.y", "ball.z"]
    poses = np.array(frames["observation.environment_state"].to_pylist())
    np.testing.assert_allclose(poses[-1, :3], [0, -1.5, 0.03], atol=2e-3)
    assert not any(frames["next.success"].to_pylist()), "the run failed"
    assert frames["next.done"].to_pylist() == [False] * (len(poses) - 1) + [True]
    video = cv2.VideoCapture(str(folder / "videos/observation.images.first/chunk-000/file-000.mp4"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == info["total_frames"]


def test_tables_have_a_file_for_each_gripper(family: Record, tmp_path: Path) -> None:
    assert cli.record(["export", str(family.folder), "--csv", str(tmp_path)]) == 0
    files = {path.name for path in tmp_path.glob("gripper_*.csv")}
    assert files == {f"gripper_{arm}.csv" for arm, kind in GRIPPERS.items() if kind}
    for path in tmp_path.glob("gripper_*.csv"):
        rows = [*csv.DictReader(path.read_text().splitlines())]
        assert len(rows) == len(family.times)
        last = family.gripper(path.stem.removeprefix("gripper_"), len(family.times) - 1)
        assert last is not None
        assert float(rows[-1]["commanded_force_n"]) == last.commanded_force
        assert float(rows[-1]["width_m"]) == pytest.approx(last.width)


GRASP = """\
bt_dualarm: 1
name: grasp
world: {scene: table, time_limit: 20}
objects:
  cube: {shape: box, size: [0.05, 0.05, 0.05], mass: 0.2, pose: {xyz: [0.4, -0.45, 0.425]}}
arms:
  arm1:
    robot: ur5
    gripper: robotiq_2f85
    base: {xyz: [0, 0, 0.4]}
    tree: {sequence: [{grasp: {object: cube}}, {release: {}}]}
"""


def test_exports_of_a_grasp_show_when_the_object_is_held(tmp_path: Path) -> None:
    """Fingers stop at 50 mm, commanded to close further, while they are reported to hold the
    object, which is lifted with them."""
    assert bt_dualarm.run(GRASP, record=tmp_path / "out").outcome == "SUCCESS"
    record = Record.read(tmp_path / "out")
    (taken, held), (released, nothing) = held_over_time(record, "arm1")
    assert (held, nothing) == (("cube",), ())
    command = ["export", str(record.folder), "--csv", str(tmp_path / "tables")]
    assert cli.record([*command, "--lerobot", str(tmp_path / "set")]) == 0
    rows = [*csv.DictReader((tmp_path / "tables" / "gripper_arm1.csv").read_text().splitlines())]
    for row in rows:
        during = taken <= float(row["time_s"]) + 1e-9 < released
        assert (row["held"] == "cube") == during
        if during and float(row["commanded_width_m"]) == 0.0:  # until release is commanded
            assert float(row["width_m"]) == pytest.approx(0.05, abs=2e-3)
            assert float(row["force_n"]) == pytest.approx(float(row["commanded_force_n"]), rel=0.3)
    closed = [row for row in rows if row["held"] and float(row["commanded_width_m"]) == 0.0]
    assert len(closed) > 25, "half a second at least"
    info = json.loads((tmp_path / "set" / "meta" / "info.json").read_text())
    names = info["features"]["observation.environment_state"]["names"]
    frames = parquet.read_table(tmp_path / "set" / "data/chunk-000/file-000.parquet")  # type: ignore[no-untyped-call]
    heights = np.array(frames["observation.environment_state"].to_pylist())[
        :, names.index("cube.z")
    ]
    assert heights[0] == pytest.approx(0.425, abs=1e-3)
    assert heights.max() > 0.44, "it was lifted"
    assert frames["next.success"].to_pylist()[-1] is True


def test_images_show_every_gripper(family: Record) -> None:
    """The renderer of videos and `scene.png` shows fingers, palms and cups."""
    moment = family.moment(10)
    still = StillRenderer(family.model(moment.generation), moment.qpos, moment.time)
    view = best_viewpoint([still], 880 / 720)
    assert view is not None
    met = ScenePainter(still.model).trace(still.data, fan_of(view, 880, 720)).geoms
    bodies = {
        still.model.body(still.model.geom_bodyid[geom]).name for geom in np.unique(met[met >= 0])
    }
    for arm, kind in GRIPPERS.items():
        seen = {name for name in bodies if name.startswith(f"{arm}/gripper/")}
        assert bool(seen) == (kind is not None)
