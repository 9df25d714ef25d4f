"""Robots of a tree file: problems of a description are reported at their own position."""

from __future__ import annotations

from pathlib import Path

from bt_dualarm.runtime.file_check import check
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry
from tests.robots.small_arm import DESCRIPTION, NAME, URDF, line_of, write_robot

TREE = f"""\
bt_dualarm: 1
name: small
world: {{scene: empty}}
arms:
  arm1: {{robot: {NAME}, base: {{xyz: [0, 0, 0.4]}}, tree: go_home}}
  arm2: {{robot: {NAME}, base: {{xyz: [2, 0, 0.4]}}, tree: go_home}}
"""


def test_problems_of_a_description_have_their_own_position(
    tmp_path: Path, registry: Registry
) -> None:
    """They are reported once for any number of arms; each arm is reported as unusable."""
    urdf = URDF.replace('value="1.0"', 'value="-1"').replace('xyz="0 1 0"', 'xyz="0 1"')
    write_robot(tmp_path, urdf, DESCRIPTION.replace("[0, 30]", "[0]"))
    (tmp_path / "tree.yaml").write_text(TREE, encoding="utf-8")
    found = check(tmp_path / "tree.yaml", registry.kinds).problems
    assert sorted((Path(p.place.file).name, p.place.line) for p in found) == [
        ("small.urdf", line_of(urdf, 'value="-1"')),
        ("small.urdf", line_of(urdf, 'xyz="0 1"')),
        ("small.yaml", line_of(DESCRIPTION, "home:")),
        ("tree.yaml", line_of(TREE, "arm1")),
        ("tree.yaml", line_of(TREE, "arm2")),
    ]


def test_an_arm_may_have_a_link_called_pedestal(tmp_path: Path, registry: Registry) -> None:
    """Baxter has one; the pedestal that the world puts below a base is another body."""
    write_robot(tmp_path, URDF.replace('"lower"', '"pedestal"'))
    (tmp_path / "tree.yaml").write_text(TREE, encoding="utf-8")
    checked = check(tmp_path / "tree.yaml", registry.kinds)
    assert checked.problems == ()
    model = World(checked.runnable()).model
    names = [model.body(number).name for number in range(model.nbody)]
    assert {"arm1/pedestal", "arm1/pedestal/"} <= set(names)


def test_an_arm_that_begins_in_collision_with_itself_is_an_error(
    tmp_path: Path, registry: Registry
) -> None:
    """Contacts would push it out of its posture, and every motion would begin in a collision."""
    lowered = URDF.replace('<origin xyz="0 0 0.3" rpy="0 0 0"/>', '<origin xyz="0 0 -0.2"/>')
    description = DESCRIPTION.replace("[0, 30]", "[0, 0]\n  up: [0, 110]")
    write_robot(tmp_path, lowered, description)
    tree = TREE.replace("xyz: [2, 0, 0.4]}", "xyz: [2, 0, 0.4]}, posture: up")
    (tmp_path / "tree.yaml").write_text(tree, encoding="utf-8")
    (problem,) = check(tmp_path / "tree.yaml", registry.kinds).problems
    assert (problem.severity, problem.place.line) == ("error", line_of(TREE, "arm1"))
    assert problem.message == (
        "arm 'arm1' would collide with itself: arm1/lower 30 mm deep in arm1/base"
    )
    assert "'exclude'" in problem.hint
    write_robot(tmp_path, lowered, description + "exclude: [[base, lower]]\n")
    assert check(tmp_path / "tree.yaml", registry.kinds).problems == ()


def test_an_arm_that_begins_in_collision_with_its_pedestal_is_an_error(
    tmp_path: Path, registry: Registry
) -> None:
    """The pedestal is not a part of the robot: `exclude` of its description cannot name it."""
    lowered = URDF.replace('<origin xyz="0 0 0.3" rpy="0 0 0"/>', '<origin xyz="0 0 -0.25"/>')
    description = DESCRIPTION.replace("[0, 30]", "[0, 110]\n  down: [0, 0]")
    write_robot(tmp_path, lowered, description + "exclude: [[base, lower]]\n")
    tree = TREE.replace("xyz: [2, 0, 0.4]}", "xyz: [2, 0, 0.4]}, posture: down")
    (tmp_path / "tree.yaml").write_text(tree, encoding="utf-8")
    (problem,) = check(tmp_path / "tree.yaml", registry.kinds).problems
    assert (problem.severity, problem.place.line) == ("error", line_of(tree, "arm2"))
    assert problem.message == (
        "arm 'arm2' would collide with its pedestal, which fills the gap below its base: "
        "arm2/lower would be 30 mm deep in it"
    )
