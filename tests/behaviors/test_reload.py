"""Hot reload of a running tree: unchanged leaves go on, others are halted and start again."""

from __future__ import annotations

from pathlib import Path
from textwrap import indent

import numpy as np
import pytest

from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.skill.registry import kind_of
from tests.behaviors.ticking import Stage


class Edited(Stage):
    """A tree whose file is changed between two ticks."""

    def change(self, folder: Path, tree: str) -> None:
        node_types = {name: kind_of(skill, "the test") for name, skill in self.skills.items()}
        file = folder / "edited.yaml"
        head = "bt_dualarm: 1\narms:\n  arm1:\n    robot: ur5\n    tree:\n"
        file.write_text(head + indent(tree.strip("\n"), "      "))
        self.tree.change(load_tree_file(file, node_types).arms["arm1"].tree)

    def ticked(self, count: int) -> None:
        for _ in range(count):
            self.tick()

    @property
    def status(self) -> str:
        return self.tree.status

    def since(self, number: int) -> list[str]:
        """Status changes of leaves from an event number on, as ``a RUNNING`` or ``a HALTED``."""
        return [
            f"{change.path.rpartition('/')[2]} {change.code or change.new}"
            for change in self.events[number:]
            if change.kind == "act"
        ]


def act(name: str, script: str) -> str:
    return f"- act: {{name: {name}, script: {script}}}\n"


def listed(kind: str, *leaves: tuple[str, str], head: str = "") -> str:
    inner = indent("".join(act(*leaf) for leaf in leaves), "    ")
    return f"{kind}:\n  {head}\n  children:\n{inner}" if head else f"{kind}:\n{inner}"


A = ("a", "S")
B = ("b", "RRRS")
C = ("c", "RS")

EDITS = {
    "nothing": ([A, B, C], ["b SUCCESS", "c RUNNING", "c SUCCESS"]),
    "one that is to come": (
        [A, B, ("c", "S")],
        ["b SUCCESS", "c SUCCESS"],
    ),
    "one that is over is not done again": (
        [("a", "RS"), B, C],
        ["b SUCCESS", "c RUNNING", "c SUCCESS"],
    ),
    "the one that runs": (
        [A, ("b", "RS"), C],
        ["b HALTED", "b RUNNING", "b SUCCESS", "c RUNNING", "c SUCCESS"],
    ),
    "one more behind it": (
        [A, B, ("new", "S"), C],
        ["b SUCCESS", "new SUCCESS", "c RUNNING", "c SUCCESS"],
    ),
    "one more before it is not done": (
        [A, ("new", "S"), B, C],
        ["b SUCCESS", "c RUNNING", "c SUCCESS"],
    ),
    "the one that runs is gone": ([A, C], ["b HALTED", "c RUNNING", "c SUCCESS"]),
    "another in its place": (
        [A, ("new", "RS"), C],
        ["b HALTED", "new RUNNING", "new SUCCESS", "c RUNNING", "c SUCCESS"],
    ),
    "nothing is left behind it: all begins anew": (
        [A],
        ["b HALTED", "a SUCCESS"],
    ),
}


@pytest.mark.parametrize("edit", EDITS)
def test_sequence_goes_on_after_a_reload(tmp_path: Path, edit: str) -> None:
    after, reported = EDITS[edit]
    stage = Edited(tmp_path, listed("sequence", A, B, C))
    stage.ticked(2)
    seen = len(stage.events)
    stage.change(tmp_path, listed("sequence", *after))
    stage.ticked(8)
    changes = [each for each in stage.since(seen) if each != "a INVALID"]
    assert changes == reported
    assert stage.status == "SUCCESS"


def test_selector_goes_on_with_its_current_child(tmp_path: Path) -> None:
    stage = Edited(tmp_path, listed("selector", ("a", "F"), ("b", "RRF"), ("c", "S")))
    stage.ticked(2)
    seen = len(stage.events)
    stage.change(tmp_path, listed("selector", ("a", "F"), ("b", "RRF"), ("c", "RS")))
    stage.ticked(5)
    changes = [each for each in stage.since(seen) if not each.endswith(" INVALID")]
    assert changes == ["b SCRIPTED", "c RUNNING", "c SUCCESS"]


def test_parallel_starts_new_children(tmp_path: Path) -> None:
    stage = Edited(tmp_path, listed("parallel", ("a", "S"), ("b", "RRRS")))
    stage.ticked(2)
    seen = len(stage.events)
    stage.change(tmp_path, listed("parallel", ("a", "S"), ("b", "RRRS"), ("c", "S")))
    stage.ticked(4)
    assert stage.since(seen) == ["c SUCCESS", "b SUCCESS"]
    assert stage.status == "SUCCESS"


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (
            "retry: {times: 2, child: {act: {script: RRRS}}}",
            "retry: {times: 9, child: {act: {script: RRRS}}}",
        ),
        (
            "timeout: {seconds: 50, child: {act: {script: RRRS}}}",
            "timeout: {seconds: 60, child: {act: {script: RRRS}}}",
        ),
        (
            "if: {condition: succeed, then: {act: {script: RRRS}}}",
            "if: {condition: succeed, then: {act: {script: RRRS}}, else: fail}",
        ),
        (
            "switch: {value: x, cases: {x: {act: {script: RRRS}}}}",
            "switch: {value: x, cases: {y: fail, x: {act: {script: RRRS}}}}",
        ),
        ("inverter: {child: {act: {script: RRRF}}}", "inverter: {child: {act: {script: RRRF}}}"),
    ],
)
def test_running_leaf_goes_on_below_a_changed_parent(
    tmp_path: Path, before: str, after: str
) -> None:
    stage = Edited(tmp_path, before)
    stage.ticked(2)
    seen = len(stage.events)
    stage.change(tmp_path, after)
    stage.ticked(4)
    assert len(stage.since(seen)) == 1, "it ends without a halt"
    assert stage.status == "SUCCESS"


def test_timeout_restarts_when_its_seconds_change(tmp_path: Path) -> None:
    stage = Edited(tmp_path, f"timeout: {{seconds: 4, child: {{act: {{script: {30 * 'R'}}}}}}}")
    stage.ticked(3)
    stage.change(tmp_path, f"timeout: {{seconds: 6, child: {{act: {{script: {30 * 'R'}}}}}}}")
    stage.ticked(6)
    assert stage.status == "RUNNING"
    stage.ticked(1)
    assert stage.status == "FAILURE"


def test_children_of_another_node_type_start_again(tmp_path: Path) -> None:
    stage = Edited(tmp_path, listed("sequence", A, B))
    stage.ticked(2)
    seen = len(stage.events)
    stage.change(tmp_path, listed("selector", A, B))
    stage.ticked(1)
    assert "b HALTED" in stage.since(seen)
    assert stage.status == "SUCCESS"


def test_new_leaf_reads_values_written_before_the_reload(tmp_path: Path) -> None:
    tree = "sequence:\n  - set: {key: x, value: RS}\n  - act: {name: b, script: RRRR}\n"
    stage = Edited(tmp_path, tree)
    stage.ticked(2)
    stage.change(tmp_path, tree.replace("script: RRRR", 'script: "{x}"'))
    stage.ticked(3)
    assert stage.status == "SUCCESS"


def test_tree_that_has_ended_is_not_changed(tmp_path: Path) -> None:
    stage = Edited(tmp_path, listed("sequence", A))
    stage.ticked(2)
    stage.change(tmp_path, listed("sequence", B))
    stage.ticked(2)
    assert stage.status == "SUCCESS"
    assert [child.name for child in stage.tree.view().children] == ["a"]


@pytest.mark.parametrize("seed", range(40))
def test_any_edit_at_any_time_keeps_the_tree_consistent(tmp_path: Path, seed: int) -> None:
    """Whatever is changed and whatever runs, the tree ends without an error."""
    rng = np.random.default_rng(seed)

    def drawn() -> str:
        kind = str(rng.choice(["sequence", "selector", "parallel"]))
        leaves = [
            (name, "R" * int(rng.integers(0, 4)) + str(rng.choice(["S", "F"])))
            for name in rng.permutation(list("abcdef"))[: rng.integers(1, 6)]
        ]
        return listed(kind, *leaves)

    stage = Edited(tmp_path, drawn())
    for _ in range(6):
        stage.ticked(int(rng.integers(0, 3)))
        stage.change(tmp_path, drawn())
        running = [node for node in stage.tree.view().children if node.status == "RUNNING"]
        assert stage.status == "RUNNING" or not running
    stage.ticked(60)
    assert stage.status in ("SUCCESS", "FAILURE")
