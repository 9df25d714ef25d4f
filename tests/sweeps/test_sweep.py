"""What a sweep runs, keeps and refuses, with an engine without simulation."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path

import pytest

from bt_dualarm.behaviors.load import load
from bt_dualarm.runtime.file_check import checked_faults
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.sweeps.api import merge
from bt_dualarm.sweeps.comparison import compare
from bt_dualarm.sweeps.job import Row
from bt_dualarm.sweeps.manifest import Grid, Manifest, SweepError, TrialSpec, checked
from bt_dualarm.sweeps.report import causes_of, cells_of, write_report
from bt_dualarm.sweeps.search import search_boundary
from bt_dualarm.sweeps.sweep import Progress, StopCondition, run_sweep
from bt_dualarm.sweeps.trial import TrialJob, lost_row, run_trial
from tests.sweeps.synthetic import TREE, InstantEngine, row_of


@pytest.fixture(scope="module")
def manifest() -> Manifest:
    return checked(Manifest(TREE, tuple(range(4)), {"x": Grid(0, 1, 3)}, ("lab", "rough")))


def works(trial: TrialSpec) -> Row:
    return row_of(trial, works=trial.params["x"] != 1.0, error_m=0.001 * trial.seed)


def test_every_trial_has_a_row_in_order(manifest: Manifest, tmp_path: Path) -> None:
    seen: list[Progress] = []
    result = run_sweep(
        manifest, tmp_path, lambda: InstantEngine(works), progress=lambda p: seen.append(replace(p))
    )
    assert result.complete
    assert result.table["trial"].to_pylist() == list(range(24))
    assert (result.rate.successes, result.rate.trials) == (16, 24)
    assert seen[0].done == 0
    assert seen[-1].failures["UNREACHABLE sequence/reach_to_pose"] == 8


def test_only_missing_trials_run(manifest: Manifest, tmp_path: Path) -> None:
    first = InstantEngine(works)
    run_sweep(manifest, tmp_path, lambda: first, shard=(1, 3))
    second = InstantEngine(works)
    result = run_sweep(manifest, tmp_path, lambda: second)
    assert sorted([*first.ran, *second.ran]) == list(range(24))
    again = run_sweep(manifest, tmp_path, lambda: pytest.fail("nothing is left to run"))
    assert again.sha256 == result.sha256


def test_larger_sweep_reuses_equal_trials(manifest: Manifest, tmp_path: Path) -> None:
    run_sweep(manifest, tmp_path, lambda: InstantEngine(works))
    larger = replace(manifest, seeds=(9, *manifest.seeds))
    engine = InstantEngine(works)
    result = run_sweep(larger, tmp_path, lambda: engine)
    assert sorted(engine.ran) == list(range(6))
    assert result.table["trial"].to_pylist() == list(range(30))
    assert result.table["seed"].to_pylist()[:6] == [9] * 6


def test_stop_request_keeps_finished_trials(manifest: Manifest, tmp_path: Path) -> None:
    stop = StopRequest()

    def end_early(trial: TrialSpec) -> Row:
        if len(engine.ran) == 7:
            stop.ask()
        return works(trial)

    engine = InstantEngine(end_early)
    result = run_sweep(manifest, tmp_path, lambda: engine, stop=stop)
    assert not result.complete
    assert len(result.table) == 7
    rest = run_sweep(manifest, tmp_path, lambda: InstantEngine(works))
    whole = run_sweep(manifest, tmp_path / "other", lambda: InstantEngine(works))
    assert rest.sha256 == whole.sha256


def test_two_sweeps_may_run_in_one_folder_concurrently(manifest: Manifest, tmp_path: Path) -> None:
    def meanwhile(trial: TrialSpec) -> Row:
        if len(engine.ran) == 5:
            other = run_sweep(manifest, tmp_path, lambda: InstantEngine(works))
            assert other.complete
        return works(trial)

    engine = InstantEngine(meanwhile)
    result = run_sweep(manifest, tmp_path, lambda: engine)
    whole = run_sweep(manifest, tmp_path / "other", lambda: InstantEngine(works))
    assert len(result.table) == 24
    assert result.sha256 == whole.sha256


def test_engine_error_keeps_finished_trials(manifest: Manifest, tmp_path: Path) -> None:
    def break_down(trial: TrialSpec) -> Row:
        if len(engine.ran) == 5:
            raise SweepError("no worker process can be started")
        return works(trial)

    engine = InstantEngine(break_down)
    with pytest.raises(SweepError, match="can be started"):
        run_sweep(manifest, tmp_path, lambda: engine)
    rest = InstantEngine(works)
    run_sweep(manifest, tmp_path, lambda: rest)
    assert len(rest.ran) == 24 - 4


def test_sweep_ends_once_the_interval_is_narrow(tmp_path: Path) -> None:
    long = checked(Manifest(TREE, tuple(range(1000))))
    ends = set()
    for slots in (1, 4):
        engine = InstantEngine(row_of, slots)
        folder = tmp_path / str(slots)
        result = run_sweep(long, folder, lambda e=engine: e, until=StopCondition.of("ci<0.1"))  # type: ignore[misc]
        assert result.enough
        assert result.rate.width < 0.1
        ends.add((len(result.table), result.sha256))
    assert len(ends) == 1  # regardless of other finished trials


@pytest.mark.parametrize("text", ["ci<0", "ci<2", "ci>0.1", "0.1", "ci<x", ""])
def test_invalid_stop_conditions_are_refused(text: str) -> None:
    with pytest.raises(SweepError, match="not a condition"):
        StopCondition.of(text)


def test_shard_ends_once_its_own_intervals_are_narrow(tmp_path: Path) -> None:
    """Of two alternating combinations, each of two shards has only one."""
    two = checked(Manifest(TREE, tuple(range(1000)), {"tool": ("hand", "cup")}))
    condition = StopCondition.of("ci<0.1")
    result = run_sweep(two, tmp_path, lambda: InstantEngine(row_of), until=condition, shard=(1, 2))
    assert result.enough
    assert len(result.table) < 100


def test_trials_without_a_result_run_again(manifest: Manifest, tmp_path: Path) -> None:
    def crash(trial: TrialSpec) -> Row:
        return lost_row(trial, "died", 3) if trial.index in (3, 7) else works(trial)

    first = run_sweep(manifest, tmp_path, lambda: InstantEngine(crash))
    assert first.table["outcome"].to_pylist().count("CRASHED") == 2
    engine = InstantEngine(works)
    again = run_sweep(manifest, tmp_path, lambda: engine)
    assert sorted(engine.ran) == [3, 7]
    whole = run_sweep(manifest, tmp_path / "other", lambda: InstantEngine(works))
    assert again.sha256 == whole.sha256  # deaths do not affect the results


def test_worker_with_other_code_or_files_ends_the_sweep(manifest: Manifest, tmp_path: Path) -> None:
    job = TrialJob(TREE, None, (), manifest.trial(0), None, None, "none", tmp_path)
    assert run_trial(replace(job, inputs=manifest.inputs_at({})))["outcome"] != "REFUSED"
    other = {**manifest.inputs_at({}), "code": "0123456789abcdef"}
    row = run_trial(replace(job, inputs=other))
    assert (row["outcome"], row["reason"]) == (
        "REFUSED",
        "it differs from the sweep in code",
    )
    missing = run_trial(replace(job, tree=tmp_path / "gone.yaml", inputs=other))
    assert f"no file {tmp_path / 'gone.yaml'}" in str(missing["reason"])
    with pytest.raises(SweepError, match=r"cannot run trial 5.*same environment and files"):
        run_sweep(manifest, tmp_path, lambda: InstantEngine(lambda _: row))
    # No row is kept, so a repaired worker runs all trials.
    engine = InstantEngine(works)
    run_sweep(manifest, tmp_path, lambda: engine)
    assert len(engine.ran) == 24


def test_audit_confirms_trials_on_another_worker(manifest: Manifest, tmp_path: Path) -> None:
    engine = InstantEngine(works)
    result = run_sweep(manifest, tmp_path, lambda: engine, audit=1.0)
    assert len(engine.ran) == 48
    assert result.progress.audited == 24
    assert all(result.table["audited"].to_pylist())


def test_failed_audit_names_both_machines(manifest: Manifest, tmp_path: Path) -> None:
    def drift(trial: TrialSpec) -> Row:
        ran = engine.ran.count(trial.index)
        return {**works(trial), "state_sha256": f"{ran}", "machine": f"host{ran}"}

    engine = InstantEngine(drift)
    with pytest.raises(SweepError, match=r"two results.*host1.*host2"):
        run_sweep(manifest, tmp_path, lambda: engine, audit=1.0)


def test_shards_merge_to_the_whole_sweep(manifest: Manifest, tmp_path: Path) -> None:
    whole = run_sweep(manifest, tmp_path / "whole", lambda: InstantEngine(works))
    parts = [tmp_path / f"part{number}" for number in (1, 2)]
    for number, part in enumerate(parts, 1):
        run_sweep(manifest, part, lambda: InstantEngine(works), shard=(number, 2))
    merged = merge(parts, tmp_path / "merged")
    assert merged.sha256 == whole.sha256
    assert (tmp_path / "merged" / "report.html").is_file()
    assert merged.complete


def test_missing_shard_is_reported(manifest: Manifest, tmp_path: Path) -> None:
    run_sweep(manifest, tmp_path / "part1", lambda: InstantEngine(works), shard=(1, 2))
    merged = merge([tmp_path / "part1"], tmp_path / "merged")
    assert not merged.complete
    assert (merged.progress.done, merged.progress.total) == (12, 24)


def test_sweeps_of_different_trees_are_not_merged(manifest: Manifest, tmp_path: Path) -> None:
    run_sweep(manifest, tmp_path / "a", lambda: InstantEngine(works))
    other = checked(replace(manifest, tree=TREE.replace("wait: 0.1", "wait: 0.2")))
    run_sweep(other, tmp_path / "b", lambda: InstantEngine(works))
    with pytest.raises(SweepError, match=r"no parts of one sweep.*differ in tree"):
        merge([tmp_path / "a", tmp_path / "b"], tmp_path / "merged")


def test_report_shows_causes_and_parameters_of_failures(manifest: Manifest, tmp_path: Path) -> None:
    result = run_sweep(manifest, tmp_path, lambda: InstantEngine(works))
    (cause,) = causes_of(result.table)
    assert (cause.count, cause.code, cause.where) == (8, "UNREACHABLE", "x 1")
    cells = cells_of(result.table)
    assert [cell.rate.value for cell in cells] == [1, 1, 1, 1, 0, 0]
    (tmp_path / "records" / cause.identity).mkdir(parents=True)
    write_report(tmp_path, result.table, "<b>guess.yaml")
    page = (tmp_path / "report.html").read_text()
    text = (tmp_path / "report.md").read_text()
    for expected in (f"records/{cause.identity}", "--param x=1.0 --seed 0 --reality lab"):
        assert expected in page
        assert expected in text
    assert "<b>guess" not in page
    assert "it is \\| too far away" in text
    assert "66.7 %" in page
    assert page.count("data:image/png") >= 2


@pytest.mark.parametrize("edge", [0.3, 0.51, 0.8])
def test_search_finds_the_boundary(edge: float, tmp_path: Path) -> None:
    base = checked(Manifest(TREE, (0, 1), {"x": Grid(0, 1)}, search=5))

    def below(trial: TrialSpec) -> Row:
        return row_of(trial, works=float(str(trial.params["x"])) < edge)

    engine = InstantEngine(below)
    result = search_boundary(base, lambda m: run_sweep(m, tmp_path, lambda: engine))
    assert result.boundary is not None
    ((found,),) = result.boundary.points
    assert abs(found - edge) <= result.boundary.spacing[0]
    assert result.boundary.spacing[0] == 1 / 128
    assert len(engine.ran) == 2 * (5 + 5)  # five points, then one per halving


def test_search_in_two_parameters_follows_a_circle(tmp_path: Path) -> None:
    base = checked(Manifest(TREE, (0,), {"x": Grid(0, 1), "y": Grid(0, 1)}, search=3))

    def inside(trial: TrialSpec) -> Row:
        x, y = float(str(trial.params["x"])), float(str(trial.params["y"]))
        return row_of(trial, works=x * x + y * y < 0.64)

    engine = InstantEngine(inside)
    result = search_boundary(base, lambda m: run_sweep(m, tmp_path, lambda: engine))
    assert result.boundary is not None
    radii = [(x * x + y * y) ** 0.5 for x, y in result.boundary.points]
    assert len(radii) > 20
    assert max(abs(radius - 0.8) for radius in radii) < 2 / 32
    assert len(engine.ran) < 33 * 33 / 2  # of all points of the finest grid


def test_search_reports_a_missing_boundary(tmp_path: Path) -> None:
    base = checked(Manifest(TREE, (0,), {"x": Grid(0, 1)}, search=3))
    engine = InstantEngine(row_of)
    result = search_boundary(base, lambda m: run_sweep(m, tmp_path, lambda: engine))
    assert str(result.boundary) == "no boundary: success everywhere"
    assert len(engine.ran) == 5


def test_two_sweeps_are_compared_by_pairs(manifest: Manifest, tmp_path: Path) -> None:
    def slower(trial: TrialSpec) -> Row:
        row = works(trial)
        return {
            **row,
            "metric.arm1.circle.error_m": 0.002 + 0.0011 * trial.seed,
            "state_sha256": "",
        }

    run_sweep(manifest, tmp_path / "a", lambda: InstantEngine(works))
    run_sweep(manifest, tmp_path / "b", lambda: InstantEngine(slower))
    same = compare(tmp_path / "a", tmp_path / "a")
    assert (same.verdict, same.equal_states, same.is_decided) == ("equal", 24, False)
    found = compare(tmp_path / "a", tmp_path / "b")
    assert found.verdict == "undecided"
    assert [one.name for one in found.metrics if one.differs] == ["arm1.circle.error_m"]
    run_sweep(replace(manifest, seeds=(99,)), tmp_path / "c", lambda: InstantEngine(works))
    with pytest.raises(SweepError, match="no trials with the same seed"):
        compare(tmp_path / "a", tmp_path / "c")


def test_comparison_uses_the_last_sweep_in_a_folder(manifest: Manifest, tmp_path: Path) -> None:
    """Rows of an older tree remain in the folder."""
    run_sweep(manifest, tmp_path / "a", lambda: InstantEngine(works))
    changed = checked(replace(manifest, tree=TREE.replace("wait: 0.1", "wait: 0.2")))
    for number in range(5):  # file names, and thus their order, are random
        folder = tmp_path / f"b{number}"
        run_sweep(manifest, folder, lambda: InstantEngine(works))
        run_sweep(changed, folder, lambda: InstantEngine(lambda t: row_of(t, works=False)))
        assert compare(tmp_path / "a", folder).rates.only_a == 16


def test_command_that_repeats_a_trial_has_all_its_options(tmp_path: Path) -> None:
    file = tmp_path / "it's a tree.yaml"
    file.write_text(TREE)
    faults = {"slow": {"kind": "weak_joint", "arm": "arm1", "joint": "elbow_joint"}}
    made = checked(
        Manifest(
            file,
            params={"axis": ([0, 0, 1],)},
            duration=3.0,
            skills=(tmp_path,),
            faults={"faults": faults},
        )
    )
    result = run_sweep(
        made, tmp_path / "out", lambda: InstantEngine(lambda t: row_of(t, works=False))
    )
    write_report(tmp_path / "out", result.table, made.title)
    (line,) = [
        one
        for one in (tmp_path / "out" / "report.md").read_text().splitlines()
        if one.startswith("bt-run")
    ]
    arguments = shlex.split(line)
    assert arguments[:4] == ["bt-run", str(file), "--param", "axis=[0, 0, 1]"]
    assert arguments[4:] == [
        "--seed", "0", "--duration", "3", "--skills", str(tmp_path),
        "--faults", str(tmp_path / "out" / "faults.yaml"),
    ]  # fmt: skip
    assert checked_faults(load(file).file, Path(arguments[-1])).keys() == {"slow"}  # type: ignore[arg-type]
    write_report(tmp_path / "out", result.table, "<text>")
    assert "bt-run" not in (tmp_path / "out" / "report.md").read_text()
