"""A trial depends only on the manifest and its number; errors name the argument."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path

import pytest

from bt_dualarm.behaviors.load import load
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.robots.urdf_arm import robot_data_dir
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.problems import SpecError
from bt_dualarm.sweeps.manifest import (
    Grid,
    Manifest,
    SweepError,
    Values,
    checked,
    read_manifest,
    seeds_of,
    shard_of,
    values_of,
)
from tests.sweeps.synthetic import TREE


def manifest(**fields: object) -> Manifest:
    return checked(Manifest(TREE, **fields))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "seeds"),
    [("0:3", (0, 1, 2)), ("7", (7,)), ("0:2,5,9:11", (0, 1, 5, 9, 10)), (" 1 , 2 ", (1, 2))],
)
def test_seeds_are_parsed(text: str, seeds: tuple[int, ...]) -> None:
    assert seeds_of(text) == seeds


@pytest.mark.parametrize("text", ["", "a", "3:3", "5:2", "-1", "1.5", "0:99999999999", "1,,2"])
def test_invalid_seeds_are_refused(text: str) -> None:
    with pytest.raises(SweepError, match=r"neither a seed nor|above their beginning"):
        seeds_of(text)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("0.2:1.0:5", Grid(0.2, 1.0, 5)),
        ("-1:1", Grid(-1, 1)),
        ("2cm:8 cm:3", Grid(0.02, 0.08, 3, "m")),
        ("0:500 ms", Grid(0, 0.5, None, "s")),
        ("-90°:90°:3", Grid(-90, 90, 3, "deg")),
        ("a:b:3", ("a:b:3",)),
        ("fingers,attach", ("fingers", "attach")),
        ("[0, 0, 1],[1, 0, 0]", ("[0, 0, 1]", "[1, 0, 0]")),
        ("{a: 1, b: [2, 3]}", ("{a: 1, b: [2, 3]}",)),
        ("0.3", ("0.3",)),
    ],
)
def test_values_are_parsed(text: str, values: Values) -> None:
    assert values_of(text) == values


@pytest.mark.parametrize("text", ["", "a,,b", "[1,2", "1:0:3", "0:1:0"])
def test_invalid_values_are_refused(text: str) -> None:
    with pytest.raises(SweepError):
        values_of(text)


def test_range_with_units_has_the_values_of_the_parameter() -> None:
    """As on the command line of `bt-run`; a unit of another quantity is refused."""
    tree = (
        "bt_dualarm: 1\nparams: {h: {type: number, unit: m, default: 0.1}}\n"
        "arms: {a: {robot: ur5, tree: {reach_to_pose: {offset: {xyz: [0, 0, '{h}']}}}}}\n"
    )
    assert [
        point["h"] for point in checked(Manifest(tree, params={"h": values_of("2cm:8cm:3")})).points
    ] == [0.02, 0.05, 0.08]
    with pytest.raises(SweepError, match="the range is in s, the parameter in m"):
        checked(Manifest(tree, params={"h": values_of("2s:8s:3")}))
    with pytest.raises(SweepError, match="units of different quantities"):
        values_of("2s:8cm:3")


def test_grid_has_decimal_values() -> None:
    assert Grid(0.2, 1.0, 5).values() == (0.2, 0.4, 0.6, 0.8, 1.0)
    assert Grid(0.1, 0.7, 1).values() == (0.1,)


def test_values_get_the_type_of_the_parameter() -> None:
    made = manifest(params={"count": Grid(1, 5, 3), "axis": ("[1, 0, 0]",), "tool": ("cup",)})
    assert made.points == tuple(
        {"count": count, "axis": [1, 0, 0], "tool": "cup"} for count in (1, 3, 5)
    )


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"params": {"z": (1.0,)}}, "no parameter 'z'"),
        ({"params": {"toll": ("cup",)}}, "did you mean 'tool'"),
        ({"params": {"x": (2.0,)}}, "must be at most 1"),
        ({"params": {"x": Grid(0, 2, 3)}}, "must be at most 1"),
        ({"params": {"x": ("far",)}}, "expected a number"),
        ({"params": {"tool": Grid(0, 1, 2)}}, "tool is a text"),
        ({"params": {"count": Grid(1, 2, 3)}}, "whole number"),
        ({"params": {"x": (0.5, 0.5)}}, "occurs twice"),
        ({"params": {"x": Grid(0, 1)}}, "is for samples or a search"),
        ({"params": {"x": ()}}, "list of values is empty"),
        ({"seeds": (1, 1)}, "seed 1 is given twice"),
        ({"seeds": ()}, "at least one seed"),
        ({"realities": ("labb",)}, "did you mean 'lab'"),
        ({"sampler": "lhs", "samples": 4}, "give a parameter FROM:TO"),
        ({"sampler": "lhs", "params": {"x": Grid(0, 1)}}, "number of samples"),
        ({"samples": 4}, "needs a sampler"),
        ({"seeds": tuple(range(5000)), "params": {"x": Grid(0, 1, 4000)}}, "more than 10000000"),
    ],
)
def test_errors_name_the_argument(fields: dict[str, object], message: str) -> None:
    with pytest.raises(DualArmError, match=message):
        manifest(**fields)


def test_trial_depends_only_on_manifest_and_number() -> None:
    fields = {"params": {"x": Grid(0, 1, 3)}, "seeds": (3, 4), "realities": ("lab", "rough")}
    first, second = manifest(**fields), manifest(**fields)
    assert [*first.trials()] == [*second.trials()]
    assert len({trial.identity for trial in first.trials()}) == len(first) == 12
    seeds = [trial.seed for trial in first.trials()]
    assert seeds == sorted(seeds)  # so that an early end has covered every combination
    with pytest.raises(IndexError):
        first.trial(12)


def test_identity_depends_on_the_run_not_on_the_sweep() -> None:
    few = manifest(params={"x": (0.5,)}, seeds=(0, 1))
    more = manifest(params={"x": (0.2, 0.5, 0.7)}, seeds=(1, 0, 2), realities=(None, "lab"))
    assert {t.identity for t in few.trials()} < {t.identity for t in more.trials()}


@pytest.mark.parametrize(
    ("old", "new"),
    [("wait: 0.1", "wait: 0.2"), ("robot: ur5", "robot: ur3"), ("scene: empty", "scene: table")],
)
def test_changed_tree_is_another_trial(old: str, new: str) -> None:
    changed = checked(Manifest(TREE.replace(old, new)))
    assert changed.trial(0).identity != manifest().trial(0).identity


def test_changed_duration_or_reality_is_another_trial() -> None:
    made = [manifest(), manifest(duration=1.0), manifest(realities=("rough",))]
    assert len({one.trial(0).identity for one in made}) == 3


OWN_ROBOT = """
bt_dualarm: 1
name: own
world: {scene: empty}
objects: {part: {shape: mesh, file: part.stl, mass: 0.1, pose: {xyz: [0.4, -0.4, 0.43]}}}
arms: {arm1: {robot: arm/own.yaml, tree: {follow_path: {file: points.csv}}}}
"""


@pytest.mark.parametrize("changed", ["arm/own.yaml", "arm/own.urdf", "points.csv", "part.stl"])
def test_changed_file_of_the_tree_is_another_trial(changed: str, tmp_path: Path) -> None:
    (tmp_path / "arm").mkdir()
    shutil.copy(robot_data_dir() / "z1_description/urdf/z1.urdf", tmp_path / "arm/own.urdf")
    (tmp_path / "arm/own.yaml").write_text(
        "title: Own\nurdf: own.urdf\nbase_link: link00\n"
        "tool: {link: gripperStator, xyz: [0.15, 0, 0], rpy: [0, 90, 0]}\n"
        "joints: [joint1, joint2, joint3, joint4, joint5, joint6]\n"
        "limits:\n  acceleration: {value: 5.0, source: chosen for this}\n"
        "  jerk: {value: 100.0, source: chosen for this}\npostures: {home: [0, 60, -60, 0, 0, 0]}\n"
    )
    (tmp_path / "points.csv").write_text("0, 0\n80, 0\n80, 50\n")
    (tmp_path / "part.stl").write_text("solid part\nendsolid part\n")
    (tmp_path / "tree.yaml").write_text(OWN_ROBOT)
    made = [Manifest(tmp_path / "tree.yaml"), Manifest(tmp_path / "tree.yaml", (0, 1))]
    assert made[0].trial(0).identity == made[1].trial(0).identity
    loaded = load(tmp_path / "tree.yaml", Registry.load().kinds)
    assert loaded.file is not None, loaded.problems
    path = tmp_path / changed
    path.write_text(path.read_text() + "\n")
    assert Manifest(tmp_path / "tree.yaml").trial(0).identity != made[0].trial(0).identity


def test_shards_are_a_partition() -> None:
    made = manifest(seeds=tuple(range(11)))
    shards = [[t.index for t in made.trials((number, 3))] for number in (1, 2, 3)]
    assert sorted(itertools.chain(*shards)) == list(range(11))
    assert [len(part) for part in shards] == [4, 4, 3]


@pytest.mark.parametrize("text", ["0/3", "4/3", "1", "1/0", "a/b", "1/3/4"])
def test_invalid_shard_is_refused(text: str) -> None:
    with pytest.raises(SweepError, match="not a shard"):
        shard_of(text)


@pytest.mark.parametrize("sampler", ["lhs", "sobol"])
def test_samples_fill_the_ranges(sampler: str) -> None:
    ranges = {"x": Grid(0.2, 0.4), "y": Grid(0.5, 1.0)}
    made = manifest(params={**ranges, "tool": ("hand", "cup")}, sampler=sampler, samples=16)
    assert len(made) == len(made.points) == 32
    for name, one in ranges.items():
        values = [point[name] for point in made.points]
        assert min(values) < one.low + 0.2 * (one.high - one.low)
        assert max(values) > one.high - 0.2 * (one.high - one.low)
        assert all(one.low <= value <= one.high for value in values)


def test_longer_sobol_sequence_extends_a_sweep() -> None:
    ranges = {"x": Grid(0.2, 0.4)}
    short = manifest(params=ranges, sampler="sobol", samples=5)
    long = manifest(params=ranges, sampler="sobol", samples=11)
    assert long.points[:5] == short.points


def test_manifest_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "tree.yaml").write_text(TREE)
    file = tmp_path / "sweep.yaml"
    file.write_text(
        "bt_sweep: 1\ntree: tree.yaml\nseeds: '0:2'\nreality: [lab]\n"
        "params: {x: '0:1:3', tool: [hand, cup], count: 2}\n"
    )
    made = checked(read_manifest(file))
    assert len(made) == 12
    assert made.trial(0).params == {"x": 0.0, "tool": "hand", "count": 2}


def test_errors_of_a_manifest_file_have_their_line(tmp_path: Path) -> None:
    file = tmp_path / "sweep.yaml"
    file.write_text("bt_sweep: 1\ntree: circle\nsedes: '0:2'\nsamples: -1\n")
    with pytest.raises(SpecError) as caught:
        read_manifest(file)
    text = str(caught.value)
    assert "sweep.yaml:3:1" in text
    assert "did you mean 'seeds'" in text
    assert "sweep.yaml:4:10" in text


def test_values_of_a_manifest_file_have_their_line(tmp_path: Path) -> None:
    file = tmp_path / "sweep.yaml"
    file.write_text(
        "bt_sweep: 1\ntree: circel\nseeds: '3:1'\nreality: [labb]\n"
        "params:\n  speed: '1.0:0.5:3'\n  radius: '[0.1'\n"
    )
    with pytest.raises(SpecError) as caught:
        read_manifest(file)
    found = str(caught.value)
    for line, message in [
        (2, "no such file, nor a shipped tree"),
        (3, "the end of seeds must be above their beginning"),
        (4, "did you mean 'lab'"),
        (6, "does not rise"),
        (7, "is not a list of values"),
    ]:
        assert f"sweep.yaml:{line}:" in found
        assert message in found
