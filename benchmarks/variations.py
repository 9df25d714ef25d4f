"""Variations of tree files that must end like the original.

    python -m benchmarks.variations [TREE ...] [--only frames halts] [--seed 0] [--jobs 2]

Each variation leaves the task as it is. A difference shows where a feature depends on what should
not matter to it:

frames: Free boxes and cylinders are compounds whose frame is 0.4 m beside them.
meshes: They are meshes, read from a file.
world: The world is turned by 90° about the vertical and moved by 1.5 m.
orders: Arms and objects are declared in the opposite order.
nodes: Each leaf is the only child of a sequence, a selector and a timeout: the same hash.
halts: Each leaf is halted once, 1.3, 2.1 and 3.1 s after its start, and started again. Where
    several arms act together, those of one arm are, and the others try again.

A variation is omitted, with the reason, where it would change the task: frames and the world if a
pose is an expression or relative, the world also if there is a scene. Prints each outcome; exits
with code 1 if one is not that of the original.
"""

from __future__ import annotations

import argparse
import copy
import math
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
import yaml
from pydantic import ValidationError

import bt_dualarm as bt
from benchmarks.campaign import Campaign, add_options
from bt_dualarm.core.pose import Pose
from bt_dualarm.grasping.grasp import MeshSolid
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.values import PoseSpec
from bt_dualarm.spec.yaml_reader import with_tuples

Tree: TypeAlias = dict[str, Any]

TREES: Final = (
    "grasp_and_place",
    "stack",
    "handover",
    "carry_together",
    "assembly",
    "peg_in_hole",
    "pick_by_sight",
    "shared_bin",
    "pick_and_track",
)
"""Shipped trees that are varied by default."""

BESIDE: Final = (0.3, -0.2, 0.2)
"""Position of an object in the frame of its compound, m."""

ELSEWHERE: Final = Pose.from_rpy((1.3, -0.7, 0.0), (0.0, 0.0, math.pi / 2))
"""Pose of the origin of the turned world in the original one."""

HALTS_S: Final = (1.3, 2.1, 3.1)
"""Times after which leaves are halted, s."""

_TRIES: Final = 6
"""Attempts at an action of several arms, one of which is halted in each of its own leaves."""

_POSES: Final = ("to", "at", "then_at", "path")
"""Ports with poses in the world."""

_DIRECTIONS: Final = ("approach", "direction")
_NO_NODES: Final = ("params", "condition", "only_if", "until", "ports")


class NotVariableError(Exception):
    """A tree has something that a variation cannot express."""


@cache
def _skills() -> frozenset[str]:
    return frozenset(Registry.load().skills)


def _spec(given: object) -> PoseSpec | None:
    """A pose in the world in numbers; None for an expression, or a relative one."""
    try:
        return PoseSpec.model_validate(with_tuples(given))
    except ValidationError:
        return None


def _pose_of(given: Tree) -> Pose:
    return PoseSpec.model_validate(with_tuples(given)).pose


def _as_given(pose: Pose) -> Tree:
    return {"xyz": pose.position.tolist(), "quat": pose.quaternion.tolist()}


def _leaves(node: Any, change: Callable[[Tree], Tree]) -> Any:
    """A tree whose leaves that are skills are changed; others are as they were."""
    if isinstance(node, str):
        return change({node: {}}) if node in _skills() else node
    if isinstance(node, list):
        return [_leaves(child, change) for child in node]
    if not isinstance(node, dict):
        return node
    if len(node) == 1 and next(iter(node)) in _skills():
        return change(node)
    return {
        key: value if key in _NO_NODES else _leaves(value, change) for key, value in node.items()
    }


def _with_leaves(file: Tree, change: Callable[[Tree], Tree]) -> Tree:
    """A file with each leaf of its trees and subtrees changed."""
    file = copy.deepcopy(file)
    for holder in (*file["arms"].values(), *file.get("subtrees", {}).values()):
        holder["tree"] = _leaves(holder["tree"], change)
    return file


def _with_poses(file: Tree, of: Callable[[str, PoseSpec], Pose | None]) -> Tree:
    """A file with each pose of a leaf changed by a function of the leaf's object and the pose.

    The function returns None for a pose that stays; what has no orientation does not get one.

    Raises:
        NotVariableError: A pose is an expression, or relative.
    """

    def changed(leaf: Tree) -> Tree:
        ((skill, ports),) = leaf.items()
        if not isinstance(ports, dict):
            return leaf
        ports = dict(ports)
        name = str(ports.get("object", ""))
        for key in _POSES:
            poses = ports.get(key)
            is_name = isinstance(poses, str) and "{" not in poses
            if poses is None or is_name or isinstance(poses, int | float):
                continue
            moved = []
            for given in poses if isinstance(poses, list) else [poses]:
                spec = _spec(given)
                if spec is None:
                    raise NotVariableError(f"{skill}: {key}: {given}")
                pose = of(name, spec)
                there = given if pose is None else _as_given(pose)
                moved.append(there if spec.is_oriented else {"xyz": there["xyz"]})
            ports[key] = moved if isinstance(poses, list) else moved[0]
        return {skill: ports}

    return _with_leaves(file, changed)


def _free(file: Tree) -> dict[str, Tree]:
    """Free boxes and cylinders of a file, by name."""
    return {
        name: obj
        for name, obj in file.get("objects", {}).items()
        if obj["shape"] in ("box", "cylinder")
        and not {"fixed", "marker", "texture", "many", "spawned"} & set(obj)
    }


def frames(file: Tree, folder: Path) -> Iterator[tuple[str, Tree]]:
    """See the module."""
    del folder
    file = copy.deepcopy(file)
    names = _free(file)
    back = Pose.from_rpy(BESIDE).inverse
    for obj in names.values():
        part = {"shape": obj.pop("shape"), "size": obj.pop("size"), "pose": {"xyz": [*BESIDE]}}
        obj.pop("noise", None)  # its yaw would turn the object about the frame
        obj |= {"shape": "compound", "parts": {"all": part}}
        obj["pose"] = _as_given(_pose_of(obj["pose"]) @ back)

    def moved(name: str, spec: PoseSpec) -> Pose | None:
        if name not in names:
            return None
        if not spec.is_oriented:
            raise NotVariableError("a goal without an orientation")
        return spec.pose @ back

    yield "frames", _with_poses(file, moved)


def meshes(file: Tree, folder: Path) -> Iterator[tuple[str, Tree]]:
    """See the module."""
    file = copy.deepcopy(file)
    for name, obj in _free(file).items():
        given = {key: obj[key] for key in ("shape", "size")} | {"mass": 1.0}
        corners = body_of(ObjectSpec.model_validate(with_tuples(given))).corners
        rows = MeshSolid.hull_of(corners).corners.reshape(-1, 3)
        lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in rows.tolist()]
        lines += [f"f {i + 1} {i + 2} {i + 3}" for i in range(0, len(rows), 3)]
        (folder / f"{name}.obj").write_text("\n".join(lines))
        del obj["size"]
        obj |= {"shape": "mesh", "file": f"{name}.obj"}
    yield "meshes", file


def world(file: Tree, folder: Path) -> Iterator[tuple[str, Tree]]:
    """See the module."""
    del folder
    if file["world"]["scene"] != "empty" or file.get("cell"):
        raise NotVariableError("a scene")
    file = copy.deepcopy(file)
    for holder, key in (
        *((obj, "pose") for obj in file["objects"].values()),
        *((arm, "base") for arm in file["arms"].values()),
    ):
        holder[key] = _as_given(ELSEWHERE @ _pose_of(holder.get(key, {"xyz": (0, 0, 0)})))
        holder.pop("noise", None)

    def turned(leaf: Tree) -> Tree:
        ((skill, ports),) = leaf.items()
        if not isinstance(ports, dict):
            return leaf
        if "offset" in ports:
            raise NotVariableError(f"{skill}: offset")
        along = {key: ports[key] for key in _DIRECTIONS if key in ports}
        axes = {key: ELSEWHERE.turn(np.array(one, float)).tolist() for key, one in along.items()}
        return {skill: ports | axes}

    turned_file = _with_leaves(file, turned)
    yield "world", _with_poses(turned_file, lambda _, spec: ELSEWHERE @ spec.pose)


def orders(file: Tree, folder: Path) -> Iterator[tuple[str, Tree]]:
    """See the module."""
    del folder
    for key in ("arms", "objects"):
        if len(file.get(key, ())) > 1:
            yield f"{key} reversed", {**file, key: dict(reversed(file[key].items()))}


def nodes(file: Tree, folder: Path) -> Iterator[tuple[str, Tree]]:
    """See the module."""
    del folder
    yield "in a sequence", _with_leaves(file, lambda leaf: {"sequence": [leaf]})
    yield "in a selector", _with_leaves(file, lambda leaf: {"selector": [leaf]})
    yield (
        "in a timeout",
        _with_leaves(file, lambda leaf: {"timeout": {"seconds": 600, "child": leaf}}),
    )


def halts(file: Tree, folder: Path) -> Iterator[tuple[str, Tree]]:
    """See the module."""
    del folder
    partners = set[str]()

    def found(leaf: Tree) -> Tree:
        (skill,) = leaf
        if Registry.load().skills[skill].counterpart is not None:
            partners.add(skill)
        return leaf

    _with_leaves(file, found)
    for seconds in HALTS_S:

        def halted(leaf: Tree, seconds: float = seconds) -> Tree:
            (skill,) = leaf
            once = {"timeout": {"seconds": seconds, "child": copy.deepcopy(leaf)}}
            return {"selector": [once, again(leaf) if skill in partners else leaf]}

        def again(leaf: Tree) -> Tree:
            (skill,) = leaf
            return {"retry": {"times": _TRIES, "child": leaf}} if skill in partners else leaf

        if not partners:
            yield f"halted after {seconds} s", _with_leaves(file, halted)
            continue
        for name in file["arms"]:
            varied = _with_leaves(file, again)
            varied["arms"][name]["tree"] = _leaves(
                copy.deepcopy(file["arms"][name]["tree"]), halted
            )
            yield f"{name} halted after {seconds} s", varied


VARIATIONS: Final[Mapping[str, Callable[[Tree, Path], Iterator[tuple[str, Tree]]]]] = {
    one.__name__: one for one in (frames, meshes, world, orders, nodes, halts)
}


def vary(tree: str, kind: str, seed: int) -> dict[str, Any]:
    """Run the original and the variations of one kind; the outcome of each."""
    path = Path(tree)
    file = yaml.safe_load(path.read_text())
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if (path.parent / "scenes").is_dir():
            shutil.copytree(path.parent / "scenes", folder / "scenes")
        rows: list[dict[str, Any]] = []
        omitted = ""
        try:
            for label, varied in (("original", file), *VARIATIONS[kind](file, folder)):
                (folder / "varied.yaml").write_text(yaml.safe_dump(varied, sort_keys=False))
                rows.append({"label": label, **_outcome(folder / "varied.yaml", seed)})
        except NotVariableError as error:
            omitted = str(error)
    same = [row["hash"] == rows[0]["hash"] for row in rows]
    good = all(row["outcome"] == rows[0]["outcome"] for row in rows)
    good &= kind != "nodes" or all(same)
    return {"outcome": "SUCCESS" if good else "FAILURE", "rows": rows, "omitted": omitted}


def _outcome(path: Path, seed: int) -> dict[str, Any]:
    try:
        result = bt.run(path, seed=seed)
    except bt.DualArmError as error:
        return {"outcome": type(error).__name__, "why": str(error), "time_s": 0.0, "hash": ""}
    failed = [
        f"{leaf.path}: {leaf.code}: {leaf.reason}"
        for arm in result.arms.values()
        for leaf in arm.runs
        if leaf.status == "FAILURE"
    ]
    is_good = result.outcome == "SUCCESS"
    return {
        "outcome": str(result.outcome),
        "why": "" if is_good else "; ".join(failed[-2:]),
        "time_s": result.sim_time_s,
        "hash": result.state_sha256,
    }


def main() -> int:
    """Print the outcomes; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("trees", nargs="*", default=[f"trees/{name}.yaml" for name in TREES])
    parser.add_argument("--only", nargs="+", default=list(VARIATIONS), choices=list(VARIATIONS))
    parser.add_argument("--seed", type=int, default=0)
    add_options(parser)
    options = parser.parse_args()
    good = True
    with Campaign(options) as campaign:
        cases = [
            {"tree": tree, "kind": kind, "seed": options.seed}
            for tree in options.trees
            for kind in options.only
        ]
        for given, found in campaign.run(vary, cases):
            good &= found["outcome"] == "SUCCESS"
            print(f"{Path(given['tree']).stem}, {given['kind']}")
            for row in found["rows"]:
                print(f"  {row['outcome']:8} {row['time_s']:6.2f} s  {row['label']}  {row['why']}")
            if found["omitted"]:
                print(f"  omitted: {found['omitted']}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
