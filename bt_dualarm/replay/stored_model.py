"""Untrusted MuJoCo models in binary form: validated, tried in another process, and loaded.

MuJoCo checks the sizes in such a file and most indices, but not all: one wrong number can crash the
process later, in a step or a rendering. So a model is first loaded and used in a separate process,
which may crash, and all its indices are checked against the arrays that they refer to. This file is
also the program of that process, so it imports as little as possible.
"""

from __future__ import annotations

import faulthandler
import hashlib
import json
import os
import resource
import select
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Final, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

Vector: TypeAlias = npt.NDArray[np.float64]

MOST_ARENA: Final = 1 << 29
"""Largest scratch memory (arena) of a model, bytes; it is reserved, but used only as needed."""

_SECONDS: Final = 20
"""Limit of the CPU time for loading and trying a model, s; it normally takes 0.1 s."""

MOST_SPACE: Final = 3 << 30
"""Address space that trying a model may add, bytes."""

_LENGTHS: Final = struct.Struct("<QQQ")
"""Bytes of a model, number of its states, and their bytes, in a request to try it."""
_VALID: Final = "valid"
_MOST_ACCEPTED: Final = 4096

_accepted: dict[str, None] = {}
"""Digests of models that were tried from this process and are harmless."""


def stored_model(
    content: bytes,
    states: Sequence[Vector] = (),
    others: Sequence[tuple[bytes, Sequence[Vector]]] = (),
) -> mujoco.MjModel:
    """Load a model.

    Args:
        content: Its binary form.
        states: States with which it is tried: time, positions and velocities of each.
        others: More models with states, which are probably loaded next: where a process has to be
            started for a model, it tries these as well, since its start takes the most time.

    Raises:
        ValueError: MuJoCo cannot read it, crashes with it, or it contains an invalid index; the
            message says what is wrong.
    """
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_ignore)  # by default MuJoCo writes MUJOCO_LOG.TXT
    trials = {_digest(content): (content, states)}
    if not _accepted.keys() & trials.keys():
        # A fork takes a hundredth of the time, but may deadlock if there are other threads.
        is_single = threading.active_count() == 1 and len([*Path("/proc/self/task").iterdir()]) == 1
        if is_single:
            complaints = [_forked(content, states)]
        else:
            trials |= {_digest(one[0]): one for one in others}
            trials = {digest: one for digest, one in trials.items() if digest not in _accepted}
            complaints = _spawned([*trials.values()])
        for digest, complaint in zip(trials, complaints, strict=False):
            if not complaint:
                _accepted[digest] = None
        if complaints[0]:
            raise ValueError(complaints[0])
        while len(_accepted) > _MOST_ACCEPTED:
            del _accepted[next(iter(_accepted))]
    return _loaded(content)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _ignore(_: str) -> None:
    """Drop a warning of MuJoCo."""


def _loaded(content: bytes) -> mujoco.MjModel:
    try:
        return mujoco.MjModel.from_binary_path("model.mjb", {"model.mjb": content})
    except (ValueError, mujoco.FatalError) as error:
        raise ValueError(f"MuJoCo {mujoco.__version__} cannot read it: {error}") from error


def _forked(content: bytes, states: Sequence[Vector]) -> str:
    """Try a model in a fork of this process; returns the problem, empty if there is none."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            faulthandler.disable()
            nowhere = os.open(os.devnull, os.O_RDWR)
            os.dup2(nowhere, 1)
            os.dup2(nowhere, 2)
            os.write(writing, _tried(content, states).encode())
        finally:
            os.kill(os.getpid(), signal.SIGKILL)  # skips the parent's cleanup
    os.close(writing)
    try:
        with os.fdopen(reading, "rb") as answer:
            if not select.select([answer], [], [], 3.0 * _SECONDS)[0]:
                os.kill(child, signal.SIGKILL)
            output = answer.read()
    finally:
        ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return _verdict(output, ended)


def _spawned(trials: Sequence[tuple[bytes, Sequence[Vector]]]) -> list[str]:
    """Try models in a new process; returns the problem of each, empty if there is none.

    The list may be shorter than that of the models, but has the first.
    """
    request = bytearray()
    for content, states in trials:
        numbers = np.concatenate([*states, np.empty(0)]).astype("<f8").tobytes()
        request += _LENGTHS.pack(len(content), len(states), len(numbers)) + content + numbers
    try:
        done = subprocess.run(  # noqa: S603 - this interpreter, this file
            [sys.executable, "-P", Path(__file__)],
            input=bytes(request),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=3.0 * _SECONDS * (1 + len(trials)),
            check=False,
            process_group=0,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},  # it forks
        )
    except subprocess.TimeoutExpired:
        return [_verdict(b"", -signal.SIGKILL)]
    except OSError as error:
        return [f"it cannot be tried: {error}"]
    complaints = [str(json.loads(line)) for line in done.stdout.splitlines()]
    return complaints or [_verdict(b"", done.returncode)]


def _verdict(output: bytes, ended: int) -> str:
    if output:
        return output.decode("utf-8", "replace").removeprefix(_VALID)[:1000]
    if ended in (-signal.SIGKILL, -signal.SIGXCPU):
        return "MuJoCo does not finish loading it"
    return f"MuJoCo crashes on it (a process that tried ended with {ended})"


def _tried(content: bytes, states: Sequence[Vector]) -> str:
    """Try a model in this process; returns the problem, or `_VALID`."""
    space = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (_SECONDS, _SECONDS))
    resource.setrlimit(resource.RLIMIT_AS, (space + MOST_SPACE, space + MOST_SPACE))
    mujoco.set_mju_user_warning(_ignore)
    try:
        model = _loaded(content)
        complaint = complaint_about(model)
        if not complaint:
            _use(model, states)
    except (ValueError, IndexError, mujoco.FatalError, mujoco.UnexpectedError) as error:
        complaint = f"it cannot be used: {error}"
    except MemoryError:
        complaint = "it takes too much memory"
    return complaint or _VALID


def complaint_about(model: mujoco.MjModel) -> str:
    """Find invalid indices and values in a model; returns the first problem, empty if none.

    Features that this project never uses (flexes, skins, height fields, plugins, …) are refused.
    """
    for check in (_sizes, _numbers, _options, _indices, _ranges, _kinds, _tree, _meshes, _names):
        complaint = check(model)
        if complaint:
            return complaint
    return ""


_UNUSED: Final = (
    "na", "nbvhdynamic", "noct", "nflex", "nflexnode", "nflexvert", "nflexedge", "nflexelem",
    "nflexelemdata", "nflexstiffness", "nflexbending", "nefm0dof", "nefm0L", "nefmCvert",
    "nflexelemedge", "nflexshelldata", "nflextexcoord", "nJfe", "nmeshtexcoord", "nskin",
    "nskinvert", "nskintexvert", "nskinface", "nskinbone", "nskinbonevert", "nhfield",
    "nhfielddata", "npair", "nnumeric", "nnumericdata", "ntext", "ntextdata", "ntuple",
    "ntupledata", "nkey", "nmocap", "nplugin", "npluginattr", "npluginstate", "nuser_body",
    "nuser_jnt", "nuser_site", "nuser_cam", "nuser_tendon", "nuser_actuator",
    "nuser_sensor", "nplastic", "ngravcomp", "nuserdata", "nhistory",
)  # fmt: skip
"""Counts of elements that models of this project do not have."""


_TEXTURE_DATA: Final = 13
"""Numbers of user data of geoms in a model with textures (`USER_DATA` in `sim/skins.py`)."""


def _sizes(model: mujoco.MjModel) -> str:
    for name in _UNUSED:
        if getattr(model, name):
            return f"{name} is {getattr(model, name)}; expected 0"
    if not 0 < model.narena <= MOST_ARENA:
        return f"narena is {model.narena}; expected at most {MOST_ARENA}"
    for name in ("nconmax", "njmax"):
        if getattr(model, name) != -1:
            return f"{name} is {getattr(model, name)}; expected -1"
    if model.nuser_geom not in (0, _TEXTURE_DATA):
        return f"nuser_geom is {model.nuser_geom}; expected 0 or {_TEXTURE_DATA}"
    if np.count_nonzero(model.body_gravcomp):
        return "a body has gravity compensation; expected none"
    needed = {
        "npolygonmax": max(model.mesh_polyvertnum, default=0),
        "nmeshdegmax": max(model.mesh_polymapnum, default=0),
        "nemax": 0,
    }
    for name, least in needed.items():
        if not least <= getattr(model, name) <= 10_000:
            return f"{name} is {getattr(model, name)}; expected at least {least}"
    moments = sum(
        model.ten_J_rownnz[target] if kind == _Trn.mjTRN_TENDON else int(kind != _Trn.mjTRN_BODY)
        for kind, target in zip(model.actuator_trntype, model.actuator_trnid[:, 0], strict=True)
        if kind != _Trn.mjTRN_TENDON or 0 <= target < model.ntendon
    )
    if not moments <= model.nJmom <= 1_000_000:
        return f"nJmom is {model.nJmom}; expected at least {moments}"
    return ""


def _numbers(model: mujoco.MjModel) -> str:
    for name in _fields(model):
        value = getattr(model, name)
        if value.dtype.kind == "f" and not (np.abs(value) <= mujoco.mjMAXVAL).all():
            return f"{name} has numbers that are not finite, or beyond 1e10"
    return ""


_OPTIONS: Final = {
    "timestep": (1e-5, 0.1), "impratio": (0.0, 1e6), "iterations": (0, 10_000),
    "ls_iterations": (0, 10_000), "noslip_iterations": (0, 1000), "ccd_iterations": (0, 10_000),
    "sdf_iterations": (0, 1000), "sdf_initpoints": (0, 1000), "integrator": (0, 3), "cone": (0, 1),
    "jacobian": (0, 2), "solver": (0, 2), "tolerance": (0.0, 1.0), "ls_tolerance": (0.0, 1.0),
    "noslip_tolerance": (0.0, 1.0), "ccd_tolerance": (0.0, 1.0), "density": (0.0, 0.0),
    "viscosity": (0.0, 0.0), "enableflags": (0, 2**31), "disableflags": (0, 2**31),
}  # fmt: skip
"""Minimum and maximum value of each option that matters to time and memory."""


def _options(model: mujoco.MjModel) -> str:
    for name, (least, most) in _OPTIONS.items():
        value = getattr(model.opt, name)
        if not least <= value <= most:
            return f"opt.{name} is {value}; expected {least:g} to {most:g}"
    for name in ("gravity", "wind", "magnetic", "o_solref", "o_solimp", "o_friction"):
        if not (np.abs(getattr(model.opt, name)) <= mujoco.mjMAXVAL).all():
            return f"opt.{name} is not finite"
    return ""


_INDICES: Final = {
    "body_parentid": "nbody", "body_rootid": "nbody", "body_weldid": "nbody",
    "body_treeid": "?ntree", "body_mocapid": "?nmocap", "body_plugin": "?nplugin",
    "jnt_bodyid": "nbody", "jnt_actuatorid": "?nactuator", "jnt_plasticadr": "?nplastic",
    "dof_bodyid": "nbody", "dof_jntid": "njnt", "dof_parentid": "?nv", "dof_treeid": "ntree",
    "dof_Madr": "nM", "geom_bodyid": "nbody", "geom_matid": "?nmat", "geom_dataid": "?nmesh",
    "geom_plugin": "?nplugin", "site_bodyid": "nbody", "site_matid": "?nmat",
    "site_dataid": "?nmesh", "cam_bodyid": "nbody", "cam_targetbodyid": "?nbody",
    "light_bodyid": "nbody", "light_targetbodyid": "?nbody", "light_texid": "?ntex",
    "mat_texid": "?ntex", "tendon_matid": "?nmat", "tendon_actuatorid": "?nactuator",
    "tendon_plasticadr": "?nplastic", "tendon_treeid": "?ntree", "actuator_plugin": "?nplugin",
    "actuator_actadr": "?na", "actuator_historyadr": "?nhistory", "sensor_plugin": "?nplugin",
    "sensor_historyadr": "?nhistory", "mesh_octadr": "?noct", "mesh_pathadr": "?npaths",
    "mesh_texcoordadr": "?nmeshtexcoord", "mesh_graphadr": "?nmeshgraph",
    "tex_pathadr": "?npaths", "tex_contenttypeadr": "?npaths", "M_colind": "nv",
    "D_colind": "nv", "B_colind": "nv", "ten_J_colind": "nv", "mapM2M": "nM", "mapM2D": "?nC",
    "mapD2M": "?nD", "D_diag": "nv", "bvh_child": "?nbvh", "names_map": "?nnames",
    **{
        f"name_{what}adr": "nnames"
        for what in (
            "body", "jnt", "geom", "site", "cam", "light", "mesh", "tex", "mat", "exclude", "eq",
            "tendon", "actuator", "sensor",
        )
    },
}  # fmt: skip
"""Size that each index array refers to; with a question mark -1 means none."""


def _indices(model: mujoco.MjModel) -> str:
    for name, counted in _INDICES.items():
        least = -(counted[0] == "?")
        size = getattr(model, counted.lstrip("?"))
        values = getattr(model, name)
        if values.size and not (least <= values.min() and values.max() < max(size, least + 1)):
            worst = values.min() if values.min() < least else values.max()
            return f"{name} has {worst}; expected {least} to {size - 1}"
    return ""


_RANGES: Final = (
    ("body_jntadr", "body_jntnum", "njnt"), ("body_dofadr", "body_dofnum", "nv"),
    ("body_geomadr", "body_geomnum", "ngeom"), ("body_bvhadr", "body_bvhnum", "nbvh"),
    ("mesh_vertadr", "mesh_vertnum", "nmeshvert"), ("mesh_faceadr", "mesh_facenum", "nmeshface"),
    ("mesh_normaladr", "mesh_normalnum", "nmeshnormal"),
    ("mesh_texcoordadr", "mesh_texcoordnum", "nmeshtexcoord"),
    ("mesh_bvhadr", "mesh_bvhnum", "nbvh"), ("mesh_octadr", "mesh_octnum", "noct"),
    ("mesh_polyadr", "mesh_polynum", "nmeshpoly"),
    ("mesh_polyvertadr", "mesh_polyvertnum", "nmeshpolyvert"),
    ("mesh_polymapadr", "mesh_polymapnum", "nmeshpolymap"),
    ("tree_bodyadr", "tree_bodynum", "nbody"), ("tree_dofadr", "tree_dofnum", "nv"),
    ("tendon_adr", "tendon_num", "nwrap"), ("M_rowadr", "M_rownnz", "nC"),
    ("D_rowadr", "D_rownnz", "nD"), ("B_rowadr", "B_rownnz", "nB"),
    ("ten_J_rowadr", "ten_J_rownnz", "nJten"), ("actuator_ctrladr", "actuator_ctrlnum", "nu"),
    ("actuator_outadr", "actuator_outnum", "nout"), ("sensor_adr", "sensor_dim", "nsensordata"),
)  # fmt: skip
"""Arrays of first indices and of counts, and the size that they refer to."""


def _ranges(model: mujoco.MjModel) -> str:
    pairs = [(names, getattr(model, names[0]), getattr(model, names[1])) for names in _RANGES]
    kinds = model.jnt_type
    if kinds.size and not (kinds.min() >= 0 and kinds.max() <= 3):
        return "jnt_type has another kind than free, ball, slide and hinge"
    pairs += [
        (("jnt_qposadr", "jnt_type", "nq"), model.jnt_qposadr, np.array((7, 4, 1, 1))[kinds]),
        (("jnt_dofadr", "jnt_type", "nv"), model.jnt_dofadr, np.array((6, 3, 1, 1))[kinds]),
    ]
    shape = [getattr(model, f"tex_{side}").astype(np.int64) for side in ("width", "height")]
    if model.ntex and not (min(map(np.min, shape)) >= 1 and max(map(np.max, shape)) <= 16_384):
        return "a texture has no size, or more than 16384 pixels"
    pixels = shape[0] * shape[1] * model.tex_nchannel
    pairs.append((("tex_adr", "tex_nchannel", "ntexdata"), model.tex_adr, pixels))
    for (first, count, total), starts, counts in pairs:
        here = counts != 0
        ends = starts.astype(np.int64) + counts
        if (
            (counts < 0).any()
            or (starts[here] < 0).any()
            or (ends > getattr(model, total))[here].any()
        ):
            return f"{first} and {count} go beyond {total}"
    return ""


_Geom = mujoco.mjtGeom
_Trn = mujoco.mjtTrn
_Obj = mujoco.mjtObj

_KINDS: Final[dict[str, tuple[int, ...]]] = {
    "geom_type": tuple(
        int(kind)
        for kind in (
            _Geom.mjGEOM_PLANE, _Geom.mjGEOM_SPHERE, _Geom.mjGEOM_CAPSULE, _Geom.mjGEOM_ELLIPSOID,
            _Geom.mjGEOM_CYLINDER, _Geom.mjGEOM_BOX, _Geom.mjGEOM_MESH,
        )
    ),
    "site_type": (2, 3, 4, 5, 6), "geom_condim": (1, 3, 4, 6), "body_simple": (0, 1, 2),
    "body_sameframe": (0, 1, 2, 3, 4), "geom_sameframe": (0, 1, 2, 3, 4),
    "site_sameframe": (0, 1, 2, 3, 4), "cam_mode": (0, 1, 2, 3, 4), "light_mode": (0, 1, 2, 3, 4),
    "light_type": (0, 1, 2, 3), "tex_type": (0, 1, 2), "tex_nchannel": (1, 2, 3, 4),
    "tex_colorspace": (0, 1, 2), "cam_projection": (0, 1), "cam_output": (0, 1),
    "eq_type": (
        int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD), int(mujoco.mjtEq.mjEQ_JOINT)
    ),
    "wrap_type": (int(mujoco.mjtWrap.mjWRAP_JOINT),), "tendon_type": (0,),
    "actuator_trntype": (int(_Trn.mjTRN_JOINT), int(_Trn.mjTRN_TENDON), int(_Trn.mjTRN_BODY)),
    "actuator_dyntype": (0,), "actuator_gaintype": (0, 1), "actuator_biastype": (0, 1),
    "actuator_actnum": (0,), "actuator_ctrlnum": (1,), "actuator_outnum": (1,),
    "actuator_ctrlspec": (0,), "actuator_history": (0,), "sensor_history": (0,),
    "sensor_type": (int(mujoco.mjtSensor.mjSENS_CONTACT),),
    "sensor_objtype": (int(_Obj.mjOBJ_GEOM),), "sensor_reftype": (0,), "sensor_refid": (-1,),
    "sensor_datatype": (0,), "sensor_needstage": (3,), "sensor_dim": (3,),
    "sensor_intprm": (1, 2, 3), "tree_sleep_policy": (0, 1, 2, 3, 4, 5),
}  # fmt: skip
"""Kinds in models of this project; only the requirements of these kinds are checked."""


def _kinds(model: mujoco.MjModel) -> str:
    for name, known in _KINDS.items():
        values = getattr(model, name)
        others = values[~np.isin(values, known)]
        if others.size:
            return f"{name} is {others.flat[0]}; expected one of {known}"
    if (model.geom_dataid[model.geom_type == _Geom.mjGEOM_MESH] < 0).any():
        return "a geom is a mesh, and names none"
    if ((model.cam_fovy <= 0) | (model.cam_fovy >= 180)).any():
        return "cam_fovy is not between 0 and 180"
    if model.ncam and not (model.cam_resolution.min() > 0 and model.cam_resolution.max() <= 4096):
        return "cam_resolution is not from 1 to 4096"
    if model.nsensor and len(set(map(bytes, model.sensor_intprm))) > 1:
        return "sensor_intprm differs from sensor to sensor"
    targets = {_Trn.mjTRN_JOINT: "njnt", _Trn.mjTRN_TENDON: "ntendon", _Trn.mjTRN_BODY: "nbody"}
    objects = {_Obj.mjOBJ_BODY: "nbody", _Obj.mjOBJ_SITE: "nsite", _Obj.mjOBJ_JOINT: "njnt"}
    references = [
        ("actuator_trnid", model.actuator_trnid[:, 0], model.actuator_trntype, targets, 0),
        ("eq_obj1id", model.eq_obj1id, model.eq_objtype, objects, 0),
        ("eq_obj2id", model.eq_obj2id, model.eq_objtype, objects, -1),
        ("sensor_objid", model.sensor_objid, model.sensor_objtype, {_Obj.mjOBJ_GEOM: "ngeom"}, 0),
        ("wrap_objid", model.wrap_objid, model.wrap_type, {mujoco.mjtWrap.mjWRAP_JOINT: "njnt"}, 0),
    ]
    for name, values, kinds, counted, least in references:
        for value, kind in zip(values.tolist(), kinds.tolist(), strict=True):
            total = (
                getattr(model, counted[type(next(iter(counted)))(kind)], -1)
                if any(int(each) == kind for each in counted)
                else -1
            )
            if not least <= value < total:
                return f"{name} is {value} of kind {kind}: there is no such thing"
    joints = model.eq_type == mujoco.mjtEq.mjEQ_JOINT
    if ((model.eq_objtype == _Obj.mjOBJ_JOINT) != joints).any():
        return "eq_objtype does not fit eq_type"
    if (
        joints.any()
        and not np.isin(
            model.jnt_type[np.concatenate((model.eq_obj1id[joints], model.eq_obj2id[joints]))],
            (2, 3),
        ).all()
    ):
        return "an equality couples joints that are neither slides nor hinges"
    return ""


def _tree(model: mujoco.MjModel) -> str:
    """Check that parents come first, and that the mass matrix has the sparsity of the tree."""
    bodies = np.arange(model.nbody)
    dofs = np.arange(model.nv)
    for name in ("body_parentid", "body_rootid", "body_weldid"):
        ids = getattr(model, name)
        allowed = ids < bodies if name == "body_parentid" else ids <= bodies
        if not (allowed[1:].all() and ids[0] == 0):
            return f"{name} does not come before its body"
    if not (model.dof_parentid < dofs).all():
        return "dof_parentid does not come before its degree of freedom"
    if not np.array_equal(model.dof_bodyid, np.repeat(bodies, model.body_dofnum)):
        return "dof_bodyid and body_dofnum differ"
    if not np.array_equal(model.jnt_bodyid, np.repeat(bodies, model.body_jntnum)):
        return "jnt_bodyid and body_jntnum differ"
    if not np.array_equal(model.geom_bodyid, np.repeat(bodies, model.body_geomnum)):
        return "geom_bodyid and body_geomnum differ"
    widths = np.array((6, 3, 1, 1))[model.jnt_type]
    if not np.array_equal(model.dof_jntid, np.repeat(np.arange(model.njnt), widths)):
        return "dof_jntid and jnt_type differ"
    # dof_simplenum: number of degrees of freedom from here on with a diagonal mass matrix.
    simple = model.dof_simplenum
    if model.nv and not ((simple == 0) | (simple == np.append(simple[1:], 0) + 1)).all():
        return "dof_simplenum does not count down"
    at = 0
    for dof in range(model.nv):
        chain = [dof]
        while not simple[dof] and model.dof_parentid[chain[-1]] >= 0:
            chain.append(int(model.dof_parentid[chain[-1]]))
        first = int(model.M_rowadr[dof])
        count = int(model.M_rownnz[dof])
        if first != at or model.M_colind[first : first + count].tolist() != chain[::-1]:
            return "the rows of the mass matrix are not those of the tree"
        at += count
    for matrix, total in (("D", "nD"), ("B", "nB"), ("ten_J", "nJten")):
        first = getattr(model, f"{matrix}_rowadr")
        count = getattr(model, f"{matrix}_rownnz")
        columns = getattr(model, f"{matrix}_colind")
        if not np.array_equal(first, np.concatenate(([0], np.cumsum(count)[:-1]))[: len(first)]):
            return f"{matrix}_rowadr does not follow {matrix}_rownnz"
        inner = np.ones(len(columns), bool)
        inner[first[count > 0]] = False
        if (
            int(count.sum()) != getattr(model, total)
            or (np.diff(columns, prepend=-1)[inner] <= 0).any()
        ):
            return f"{matrix}_colind does not ascend along its rows"
    if model.nv and not (model.D_diag < model.D_rownnz).all():
        return "D_diag is outside its row"
    if model.nv and not np.array_equal(model.D_colind[model.D_rowadr + model.D_diag], dofs):
        return "D_diag is not the diagonal"
    return ""


_STORED_IN_ORDER: Final = (
    ("mesh_vertadr", "mesh_vertnum", "nmeshvert"),
    ("mesh_faceadr", "mesh_facenum", "nmeshface"),
    ("mesh_normaladr", "mesh_normalnum", "nmeshnormal"),
    ("mesh_polyadr", "mesh_polynum", "nmeshpoly"),
    ("mesh_polyvertadr", "mesh_polyvertnum", "nmeshpolyvert"),
    ("mesh_polymapadr", "mesh_polymapnum", "nmeshpolymap"),
)


def _meshes(model: mujoco.MjModel) -> str:
    """Check that indices in a mesh stay within it, and that bounding volume trees are finite."""
    for first, count, total in _STORED_IN_ORDER:
        counts = getattr(model, count)
        ends = np.cumsum(counts, dtype=np.int64)
        if not np.array_equal(getattr(model, first), ends - counts) or (
            ends.size and ends[-1] != getattr(model, total)
        ):
            return f"{first} does not follow {count}"
    for mesh in range(model.nmesh):
        vertices = int(model.mesh_vertnum[mesh])
        normals = int(model.mesh_normalnum[mesh])
        faces = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
        polygons = slice(
            model.mesh_polyadr[mesh], model.mesh_polyadr[mesh] + model.mesh_polynum[mesh]
        )
        own = slice(model.mesh_vertadr[mesh], model.mesh_vertadr[mesh] + vertices)
        numbered = (
            ("mesh_face", model.mesh_face[faces], vertices),
            ("mesh_facenormal", model.mesh_facenormal[faces], normals),
            ("mesh_extrema", model.mesh_extrema[mesh], vertices),
            (
                "mesh_polyvert",
                _pieces(
                    model.mesh_polyvert,
                    model.mesh_polyvertadr[polygons],
                    model.mesh_polyvertnum[polygons],
                ),
                vertices,
            ),
            (
                "mesh_polymap",
                _pieces(model.mesh_polymap, model.mesh_polymapadr[own], model.mesh_polymapnum[own]),
                int(model.mesh_polynum[mesh]),
            ),
        )
        for name, values, most in numbered:
            if values.size and not (values.min() >= 0 and values.max() < most):
                return f"{name} of mesh {mesh} goes beyond its {most}"
        complaint = _boxes(
            model, model.mesh_bvhadr[mesh], model.mesh_bvhnum[mesh], model.mesh_facenum[mesh]
        ) or _hull(model, mesh)
        if complaint:
            return f"mesh {mesh}: {complaint}"
    # mesh_polymap must be the inverse of mesh_polyvert.
    polygon_mesh = np.repeat(np.arange(model.nmesh), model.mesh_polynum)
    vertex_mesh = np.repeat(np.arange(model.nmesh), model.mesh_vertnum)
    polygon = np.repeat(np.arange(model.nmeshpoly), model.mesh_polyvertnum)
    vertex = np.repeat(np.arange(model.nmeshvert), model.mesh_polymapnum)
    corners = model.mesh_polyvert + model.mesh_vertadr[polygon_mesh[polygon]].astype(np.int64)
    listed = model.mesh_polymap + model.mesh_polyadr[vertex_mesh[vertex]].astype(np.int64)
    pairs = np.sort(corners * (model.nmeshpoly + 1) + polygon)
    if not np.array_equal(pairs, np.sort(vertex * (model.nmeshpoly + 1) + listed)):
        return "mesh_polyvert and mesh_polymap differ"
    for body in range(model.nbody):
        complaint = _boxes(model, model.body_bvhadr[body], model.body_bvhnum[body], model.ngeom)
        if complaint:
            return f"body {body}: {complaint}"
    return ""


def _pieces(
    values: npt.NDArray[np.int32], first: npt.NDArray[np.int32], count: npt.NDArray[np.int32]
) -> npt.NDArray[np.int32]:
    """Values of some ranges, which were checked before."""
    chosen = np.zeros(len(values) + 1, np.int64)
    np.add.at(chosen, first[count > 0], 1)
    np.add.at(chosen, first[count > 0] + count[count > 0], -1)
    return values[np.cumsum(chosen)[:-1] > 0]


def _boxes(model: mujoco.MjModel, first: int, count: int, leaves: int) -> str:
    """Check a bounding volume tree: nodes come after their parents, leaves refer to elements."""
    if not count:
        return ""
    child = model.bvh_child[first : first + count]
    node = model.bvh_nodeid[first : first + count]
    is_leaf = (child < 0).all(axis=1)
    below = child[~is_leaf]
    if (below <= np.flatnonzero(~is_leaf)[:, None]).any() or (below >= count).any():
        return "bvh_child does not come after its parent"
    if ((node >= 0) != is_leaf).any() or (node >= leaves).any() or (node < -1).any():
        return "bvh_nodeid is of nothing"
    depth = model.bvh_depth[first : first + count]
    if not (depth.min() >= 0 and depth.max() <= 1000):
        return "bvh_depth is out of range"
    return ""


def _hull(model: mujoco.MjModel, mesh: int) -> str:
    """Check the graph of a convex hull, in the layout of MuJoCo's `mjModel.mesh_graph`."""
    at = int(model.mesh_graphadr[mesh])
    if at < 0:
        return ""
    graph = model.mesh_graph[at:].astype(np.int64)
    own = int(model.mesh_vertnum[mesh])
    if len(graph) < 2 or not (0 < graph[0] <= own and 0 < graph[1] <= len(graph)):
        return "mesh_graph has no counts"
    vertices = int(graph[0])
    faces = int(graph[1])
    parts = np.cumsum([2, vertices, vertices, vertices + 3 * faces, 3 * faces])
    if parts[-1] > len(graph):
        return "mesh_graph goes beyond its end"
    first, known, edges, corners = np.split(graph[: parts[-1]], parts[:-1])[1:]
    for values, least, count in (
        (first, 0, len(edges)), (known, 0, own), (edges, -1, vertices), (corners, 0, own),
    ):  # fmt: skip
        if values.size and not (values.min() >= least and values.max() < count):
            return "mesh_graph refers to what is not there"
    if edges[-1] != -1:
        return "mesh_graph has a list without an end"
    return ""


_NAMED: Final = (
    "nbody", "njnt", "ngeom", "nsite", "ncam", "nlight", "nflex", "nmesh", "nskin", "nhfield",
    "ntex", "nmat", "npair", "nexclude", "neq", "ntendon", "nactuator", "nsensor", "nnumeric",
    "ntext", "ntuple", "nkey", "nplugin",
)  # fmt: skip
"""Counts of named elements, in the order of MuJoCo's hash table, with two slots per element."""


def _names(model: mujoco.MjModel) -> str:
    if model.nnames < 1 or model.names[-1:] != b"\0":
        return "names do not end"
    at = 0
    for name in _NAMED:
        count = getattr(model, name)
        places = model.names_map[at : at + 2 * count]
        if len(places) < 2 * count or (places.size and places.max() >= max(count, 1)):
            return f"names_map does not fit {name}"
        at += 2 * count
    if at != model.nnames_map:
        return f"names_map has {model.nnames_map} places; expected {at}"
    try:
        plain = model.names.decode("utf-8")
    except UnicodeDecodeError:
        return "names are not UTF-8"
    return "" if plain.replace("\0", "").isprintable() else "names have control characters"


def _fields(model: mujoco.MjModel) -> list[str]:
    """Names of the arrays of a model."""
    return [
        name
        for name in dir(model)
        if not name.startswith("_") and isinstance(getattr(model, name), np.ndarray)
    ]


def _use(model: mujoco.MjModel, states: Sequence[Vector]) -> None:
    """Use a model as readers of records do."""
    data = mujoco.MjData(model)
    hit = np.full(1, -1, np.int32)
    for state in states or [np.concatenate(([0.0], model.qpos0, np.zeros(model.nv)))]:
        if len(state) != 1 + model.nq + model.nv:
            continue  # the reader reports it
        mujoco.mj_resetData(model, data)
        data.qpos[:] = state[1 : 1 + model.nq]
        data.qvel[:] = state[1 + model.nq :]
        mujoco.mj_forward(model, data)
        mujoco.mj_camlight(model, data)
        eye = np.array((2.0, 2.0, 2.0))
        for target in data.geom_xpos:
            mujoco.mj_ray(model, data, eye, target - eye, None, 1, -1, hit)
        for geom in range(1, min(model.ngeom, 100)):
            mujoco.mj_geomDistance(model, data, 0, geom, 0.1, None)
    for kind in (_Obj.mjOBJ_BODY, _Obj.mjOBJ_JOINT, _Obj.mjOBJ_GEOM, _Obj.mjOBJ_SITE):
        mujoco.mj_name2id(model, kind, "tnone is given")


def _main() -> None:
    """Read models and states from standard input, try each in a fork, and write its problem."""
    given = memoryview(sys.stdin.buffer.read())
    while given:
        length, count, size = _LENGTHS.unpack_from(given)
        end = _LENGTHS.size + length
        states = np.frombuffer(given[end : end + size], "<f8")
        content = bytes(given[_LENGTHS.size : end])
        given = given[end + size :]
        complaint = _forked(content, np.split(states, max(count, 1)))
        os.write(1, json.dumps(complaint).encode() + b"\n")


if __name__ == "__main__":
    _main()
