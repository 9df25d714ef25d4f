"""Every node type and every shipped skill is documented by an example that works."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_dualarm.behaviors.language import LANGUAGE
from bt_dualarm.behaviors.load import check_file
from bt_dualarm.skill.registry import Registry
from tests.spec.writing import SKILLS, task

BEFORE = """
subtrees:
  pause: {params: {time: {type: duration}}, tree: {wait: "{time}"}}
cell:
  signals: {ready: {type: boolean, written_by: [arm1], initial: false}}
  zones: {bin: {size: [0.3, 0.3, 0.2]}}
  rendezvous: {handover: [arm1, arm2]}
objects:
  cube: {shape: box, size: [0.05, 0.05, 0.05], mass: 0.1}
  beam: {shape: box, size: [1.2, 0.05, 0.05], mass: 4.0}
  cabinet:
    shape: compound
    mass: 5
    fixed: true
    pose: {xyz: [0, 2, 0.2]}
    parts:
      frame: {shape: box, size: [0.3, 0.01, 0.3]}
      box: {shape: box, size: [0.2, 0.2, 0.2], pose: {xyz: [0, 0.2, 0]}}
    joints: {slide: {type: slide, axis: [0, 1, 0], range: [0, 0.2], parts: [box]}}
"""


@pytest.mark.parametrize("node_type", LANGUAGE)
def test_examples_of_node_types(node_type: str, tmp_path: Path) -> None:
    """The example passes; each port and output has a description."""
    kind = LANGUAGE[node_type]
    path = task(tmp_path, kind.example, BEFORE)
    partner = kind.example if node_type == "meet" else "wait: 1"
    if node_type == "in_step":
        partner = kind.example.replace("arm2", "arm1")
    with path.open("a") as file:
        file.write(f"  arm2: {{robot: panda, tree: {{sequence: [{{{partner}}}]}}}}\n")
    problems = check_file(path, SKILLS)
    assert not [problem for problem in problems if problem.severity == "error"]
    assert kind.example.startswith(node_type)
    assert all(field.description for field in kind.ports.model_fields.values())
    assert all(field.description for field in kind.outputs.model_fields.values())


def test_examples_of_shipped_skills(tmp_path: Path) -> None:
    kinds = Registry.load().kinds
    for name, kind in kinds.items():
        path = task(tmp_path, kind.example, BEFORE)
        joint = kind.counterpart
        theirs = "succeed"
        if joint is not None:
            theirs = f"{{{joint.kind}: {{object: cube, {joint.its_partner}: arm1}}}}"
            if (
                joint.partner == joint.its_partner
            ):  # all arms use one skill, whose example fits each
                theirs = f"{{{kind.example.replace('arm2', 'arm1')}}}"
        with path.open("a") as file:
            file.write(f"  arm2: {{robot: panda, tree: {theirs}}}\n")
        problems = check_file(path, kinds)
        assert not [str(p) for p in problems if p.severity == "error"], name
        assert kind.example.startswith(name)
