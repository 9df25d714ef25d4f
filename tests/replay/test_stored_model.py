"""Stored models: one is used only if all its references are valid and it does no harm."""

from __future__ import annotations

import struct
from pathlib import Path

import mujoco
import numpy as np
import pytest

import bt_dualarm
from bt_dualarm.replay.stored_model import _spawned, complaint_about, stored_model

TREE = """\
bt_dualarm: 1
name: all
world: {{scene: table, reality: {reality}}}
objects:
  box: {{shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, pose: {{xyz: [0.4, 0.3, 0.5]}},
    marker: {{id: 3, size: 0.03}}}}
  ball: {{shape: sphere, size: [0.05], mass: 1, pose: {{xyz: [0.6, 0.6, 0.5]}}}}
  can: {{shape: cylinder, size: [0.03, 0.1], mass: 1, pose: {{xyz: [-0.6, 0.6, 0.5]}}}}
  pill: {{shape: capsule, size: [0.03, 0.1], mass: 1, pose: {{xyz: [-0.6, -0.6, 0.5]}}}}
  post: {{shape: box, size: [0.05, 0.05, 0.05], mass: 1, fixed: true, pose: {{xyz: [0.8, 0.3, 1]}}}}
arms:
  arm1:
    robot: {robot}
    gripper: {gripper}
    base: {{xyz: [0, 0, 0.4]}}
    camera: {{mount: wrist}}
    tree: {{wait: {{seconds: 1}}}}
"""


@pytest.fixture(autouse=True, scope="module")
def models_tried_here() -> None:
    """Not in this module: what is tried elsewhere does no harm here."""


def content_of(model: mujoco.MjModel) -> bytes:
    content = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, content)
    return content.tobytes()


def world(folder: Path, robot: str, gripper: str, reality: str = "lab") -> mujoco.MjModel:
    path = folder / "tree.yaml"
    path.write_text(TREE.format(robot=robot, gripper=gripper, reality=reality))
    with bt_dualarm.open(path) as run:
        return stored_model(content_of(run.world.model))


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> mujoco.MjModel:
    return world(tmp_path_factory.mktemp("model"), "ur5", "robotiq_2f85")


@pytest.mark.parametrize(
    ("robot", "gripper"),
    [
        ("panda", "none"), ("panda", "panda_hand"), ("ur3", "suction_cup"),
        ("xarm7", "robotiq_2f85"), ("ur10", "panda_hand"),
    ],
)  # fmt: skip
def test_models_of_this_project_are_accepted(robot: str, gripper: str, tmp_path: Path) -> None:
    assert complaint_about(world(tmp_path, robot, gripper, "rough")) == ""


DAMAGE = (
    ("mesh_vertadr", 5000), ("mesh_polyadr", 3), ("mesh_face", 10**6), ("geom_type", 1),
    ("jnt_actuatorid", 7000), ("actuator_ctrladr", 10**6), ("tree_dofnum", 2**30),
    ("dof_treeid", 77), ("sensor_intprm", 2**31 - 1), ("sensor_history", 100),
    ("sensor_reftype", 20), ("body_parentid", 3), ("bvh_child", 0), ("geom_dataid", 10**6),
    ("actuator_trnid", 10**6), ("name_bodyadr", 10**6), ("M_colind", 5),
    ("body_pos", np.nan), ("body_mass", 1e300), ("cam_resolution", 10**6), ("eq_type", 2**20),
    ("wrap_objid", 10**4), ("mat_texid", 9), ("tex_width", 30_000), ("names_map", 10**6),
)  # fmt: skip
"""Fields in which a wrong value made MuJoCo crash or hang, and related ones, with such values."""


def test_invalid_references_are_refused(model: mujoco.MjModel) -> None:
    """Each is tried in its own process, forked from one small process, which takes less time."""
    contents = []
    for field, value in DAMAGE:
        changed = mujoco.MjModel.from_binary_path("m.mjb", {"m.mjb": content_of(model)})
        getattr(changed, field).reshape(-1)[0] = value
        contents.append(content_of(changed))
    complaints = _spawned([(content, ()) for content in contents])
    assert len(complaints) == len(DAMAGE)
    assert [one for one, complaint in zip(DAMAGE, complaints, strict=True) if not complaint] == []
    with pytest.raises(ValueError, match=r".+"):
        stored_model(contents[0])


def test_a_model_that_requests_a_terabyte_is_refused(model: mujoco.MjModel) -> None:
    """The scratch memory that it asks for is the last but one of its 98 sizes."""
    content = bytearray(content_of(model))
    at = 20 + 8 * 96
    assert struct.unpack_from("<q", content, at)[0] == model.narena
    struct.pack_into("<q", content, at, 1 << 40)
    with pytest.raises(ValueError, match="narena"):
        stored_model(bytes(content))


@pytest.mark.parametrize("content", [b"", b"x" * 100, bytes(range(256)) * 400])
def test_an_unreadable_model_is_refused_and_leaves_no_file(
    content: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MuJoCo would leave MUJOCO_LOG.TXT in the current folder."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match="cannot read it"):
        stored_model(content)
    assert not [*tmp_path.iterdir()]


def test_a_new_process_reports_the_same_as_a_fork(model: mujoco.MjModel) -> None:
    good = content_of(model)
    bad = b"x" * 100
    for trials in ([good], [bad, good], [good, bad, good]):
        complaints = _spawned([(content, ()) for content in trials])
        assert len(complaints) == len(trials)
        for content, complaint in zip(trials, complaints, strict=True):
            assert bool(complaint) is (content is bad)
            assert ("cannot read it" in complaint) is (content is bad)


def test_valid_values_are_defined_for_every_index_field(model: mujoco.MjModel) -> None:
    """For a field that a new MuJoCo adds, its valid values have to be defined."""
    from bt_dualarm.replay import stored_model as module

    free = {
        "body_contype", "body_conaffinity", "geom_contype", "geom_conaffinity", "geom_priority",
        "exclude_signature", "tex_data", "light_castshadow", "tex_adr", "jnt_type",
    }  # fmt: skip
    known = free | {*module._INDICES, *module._KINDS} | {n for pair in module._RANGES for n in pair}
    known |= {"mesh_face", "mesh_facenormal", "mesh_facetexcoord", "mesh_extrema", "mesh_graph"}
    known |= {"mesh_polyvert", "mesh_polymap", "bvh_depth", "bvh_nodeid", "dof_simplenum"}
    known |= {"jnt_qposadr", "jnt_dofadr", "eq_obj1id", "eq_obj2id", "eq_objtype", "wrap_objid"}
    known |= {"actuator_trnid", "sensor_objid", "cam_resolution", "tex_width", "tex_height"}
    known |= {"tendon_treenum"}
    for name in module._fields(model):
        array = getattr(model, name)
        if array.size and array.dtype.kind in "iu" and not name.endswith("_group"):
            assert name in known, name
