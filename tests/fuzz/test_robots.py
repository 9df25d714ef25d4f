"""Mutated robots cause only the project's errors, in limited time, and accepted ones run."""

from __future__ import annotations

import os
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from bt_dualarm.kinematics.solver import Chain
from bt_dualarm.runtime.file_check import check
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.outcome import Ending
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry
from tests.fuzz import mesh_mutation, page_mutation, urdf_mutation
from tests.fuzz.seeds import dice_of
from tests.robots.small_arm import DESCRIPTION, URDF
from tests.robots.test_mesh_check import BOX, ascii_stl, obj, stl

TIMES = float(os.environ.get("BT_DUALARM_FUZZ_TIMES", "1"))
"""Factor of the number of mutants: 1 takes 5 s of one core; `make fuzz` uses more."""

CHUNKS = 8 if TIMES > 1 else 2
"""Parts for parallel workers; each has its own seed, and some mutants that are accepted."""

LONGEST_S = 10.0
"""CPU time limit for one mutant, s: on an idle machine none needs two, and unbounded work exceeds
it on any machine."""

URDFS, DESCRIPTIONS, MESHES = (int(TIMES * count / CHUNKS) for count in (120, 120, 60))

TREE = """\
bt_dualarm: 1
name: mutant
world: {scene: empty}
arms:
  arm1:
    robot: small.yaml
    base: {xyz: [0, 0, 0.4]}
    tree:
      sequence:
        - selector: [{reach_to_pose: {offset: {xyz: [0.01, 0, 0.01]}}}, succeed]
        - go_home
"""

SRDF = """\
<robot name="small"><disable_collisions link1="base" link2="lower" reason="Never"/></robot>
"""

DAE = """\
<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="1" name="meter"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="a" count="12">0 0 0 0.1 0 0 0 0.1 0 0 0 0.1</float_array>
<technique_common><accessor source="#a" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/>
<p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="d"><node><instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#d"/></scene></COLLADA>
"""

MESHES_OF = {
    "stl": stl(BOX),
    "ascii.stl": ascii_stl(BOX),
    "obj": obj(BOX),
    "dae": DAE.encode(),
}


def urdf_with(mesh: str) -> str:
    """URDF of the small arm with a mesh as visual and collision geometry, and a turning hand."""
    geometry = f'<geometry><mesh filename="{mesh}" scale="1 -1 1"/></geometry>'
    text = URDF.replace('<geometry><sphere radius="0.03"/></geometry>', geometry)
    text = text.replace(
        '<link name="lower">', f'<link name="hand"/><link name="lower"><visual>{geometry}</visual>'
    )
    return text.replace(
        "</robot>",
        '<joint name="hand_joint" type="continuous"><parent link="flange"/><child link="hand"/>'
        '<axis xyz="1 1 0"/><mimic joint="elbow"/></joint></robot>',
    )


def folder_with_an_arm(folder: Path) -> Path:
    """Writes a tree file and all files that it needs; returns the tree file."""
    (folder / "small.urdf").write_text(urdf_with("box.stl"), encoding="utf-8")
    (folder / "small.srdf").write_text(SRDF, encoding="utf-8")
    (folder / "small.yaml").write_text(description(), encoding="utf-8")
    (folder / "box.stl").write_bytes(stl(BOX))
    (folder / "mutant.yaml").write_text(TREE, encoding="utf-8")
    return folder / "mutant.yaml"


def description() -> str:
    return DESCRIPTION + (
        "srdf: small.srdf\nlocked: {slide: 0.01, hand_joint: 30}\n"
        "cameras:\n  wrist: {link: flange, xyz: [0, 0, 0.1], forward: [0, 0, 1], up: [1, 0, 0]}\n"
        "exclude: [[base, upper]]\ncolors: {default: [1, 1, 1, 1], finger: [0, 0, 0, 1]}\n"
    )


def accepted(tree: Path, registry: Registry) -> bool:
    """Checks a file, and if it has no errors, runs it and checks the result."""
    checked = check(tree, registry.kinds)
    assert all(str(problem) for problem in checked.problems)
    if checked.file is None:
        return False
    with Run(checked.file, registry, RunOptions(duration=0.03)) as run:
        result = run.finish()
    assert result.ending in (Ending.DURATION, Ending.FINISHED), result.error
    for leaf in result.arms["arm1"].leaves.values():
        assert leaf.code != "EXCEPTION", leaf.reason
    # Images need visual geometry, too; both engines must agree on the arm.
    arm = World(checked.file, visuals=True).arms["arm1"]
    tool = Chain(arm.robot, arm.base).forward(arm.q).position
    assert tool == pytest.approx(arm.tool_pose.position, abs=1e-6 * (1 + np.abs(tool).max()))
    return True


def survivors(
    count: int, seconds: float, tree: Path, mutate: Callable[[int], str | bytes], registry: Registry
) -> int:
    """Number of accepted mutants; each must finish within a CPU time in s and without exception."""
    alive = 0
    for number in range(count):
        mutant = mutate(number)
        began = time.process_time()
        try:
            alive += accepted(tree, registry)
        except Exception as error:
            raise AssertionError(f"mutant {number}:\n{mutant!r}") from error
        assert time.process_time() - began < seconds, mutant
    return alive


@pytest.mark.slow
@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_mutated_urdf_is_refused_or_runs(chunk: int, tmp_path: Path, registry: Registry) -> None:
    """No mutant raises another exception, takes long, or is accepted but does not run."""
    tree = folder_with_an_arm(tmp_path)
    dice = dice_of(chunk)
    assert accepted(tree, registry)
    root = ET.fromstring(urdf_with("box.stl"))  # noqa: S314 - own data

    def mutate(_: int) -> bytes:
        content = urdf_mutation.mutated(root, dice)
        (tmp_path / "small.urdf").write_bytes(content)
        return content

    assert URDFS > survivors(URDFS, LONGEST_S, tree, mutate, registry) > 0


@pytest.mark.slow
@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_mutated_robot_description_is_refused_or_runs(
    chunk: int, tmp_path: Path, registry: Registry
) -> None:
    """The same holds for robot descriptions."""
    tree = folder_with_an_arm(tmp_path)
    dice = dice_of(chunk)
    data = yaml.safe_load(description())

    def mutate(_: int) -> str:
        text = page_mutation.mutated(data, dice)
        (tmp_path / "small.yaml").write_text(text, encoding="utf-8")
        return text

    assert DESCRIPTIONS > survivors(DESCRIPTIONS, LONGEST_S, tree, mutate, registry) > 0


@pytest.mark.slow
@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_mutated_mesh_is_refused_or_runs(chunk: int, tmp_path: Path, registry: Registry) -> None:
    """The same holds for meshes."""
    tree = folder_with_an_arm(tmp_path)
    dice = dice_of(chunk)

    def mutate(number: int) -> bytes:
        suffix = dice.choice(tuple(MESHES_OF))
        content = mesh_mutation.mutated(MESHES_OF[suffix], dice)
        name = f"mutant{number}.{suffix}"  # MuJoCo caches meshes by name
        (tmp_path / name).write_bytes(content)
        (tmp_path / "small.urdf").write_text(urdf_with(name), encoding="utf-8")
        return content

    assert MESHES > survivors(MESHES, LONGEST_S, tree, mutate, registry) > 0


CORPUS = Path(__file__).parent / "corpus"
"""Files found by fuzzing: each caused a traceback or an abort, or ran for minutes."""

VALID = {
    "infinite_limits", "link_called_as_the_frame_of_the_tool", "link_called_pedestal",
    "mass_of_a_link_that_moves_nothing", "unknown_encoding",
}  # fmt: skip
"""Files of the corpus that describe a valid arm."""


@pytest.mark.parametrize("path", sorted(CORPUS.glob("*.urdf")), ids=lambda path: path.stem)
def test_file_of_the_corpus_is_refused_or_runs(
    path: Path, tmp_path: Path, registry: Registry
) -> None:
    tree = folder_with_an_arm(tmp_path)
    (tmp_path / "small.urdf").write_bytes(path.read_bytes())
    own = path.with_suffix(".yaml")
    (tmp_path / "small.yaml").write_text(own.read_text() if own.exists() else DESCRIPTION)
    assert accepted(tree, registry) == (path.stem in VALID)
