"""Resuming a record from a time yields the run that was never interrupted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from bt_dualarm import cli
from bt_dualarm.replay.record import Record, ReplayError
from bt_dualarm.replay.rerun import Changed, PastChangedError, parse_place, resumed
from bt_dualarm.skill.registry import Registry
from tests.replay.runs import PARTS, SHORT, recorded, write_short

REGISTRY = Registry.load()


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return recorded(tmp_path_factory.mktemp("short"), seed=4)


def edited(record: Record, folder: Path, old: str, new: str) -> Changed:
    """The tree of the record with an edit."""
    assert old in SHORT
    return Changed(write_short(folder, SHORT.replace(old, new)))


@pytest.mark.parametrize("time", [0.002, 0.5, 1.0])
def test_the_hash_is_that_of_the_uninterrupted_run(short: Record, time: float) -> None:
    with resumed(short, time, REGISTRY, Changed()) as run:
        assert run.time == pytest.approx(time)
        result = run.finish()
    assert short.end is not None
    assert result.state_sha256 == short.end["state_sha256"]


def test_a_tree_edited_after_that_time_goes_on(short: Record, tmp_path: Path) -> None:
    change = edited(short, tmp_path, '{offset: "{goal}"}', "{offset: {xyz: [0, 0, 0.05]}}")
    with resumed(short, 0.3, REGISTRY, change) as run:
        result = run.finish()
    assert result.outcome == "SUCCESS"
    assert short.end is not None
    assert result.state_sha256 != short.end["state_sha256"]


def test_a_tree_edited_before_that_time_is_refused_with_its_node(
    short: Record, tmp_path: Path
) -> None:
    change = edited(short, tmp_path, "value: {xyz: [0, 0.06, 0]}", "value: {xyz: [0, 0.05, 0]}")
    end = short.until - 0.1
    with pytest.raises(PastChangedError) as refused:
        resumed(short, end, REGISTRY, change)
    assert "the past is not that of the record: it differs from" in str(refused.value)
    assert "arm1:sequence/set began at 0.00 s and has another value now" in str(refused.value)


def test_a_refused_run_leaves_an_earlier_record(
    short: Record, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Its record of the repeated past is withdrawn, and its end is not reported.

    What its arms did at the end was written to a file that had been closed: "File exists".
    """
    change = edited(short, tmp_path, "value: {xyz: [0, 0.06, 0]}", "value: {xyz: [0, 0.05, 0]}")
    recorded(tmp_path / "other", duration=0.1)
    (folder,) = {path.parent for path in (tmp_path / "other").rglob("summary.json")}
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    options = {"record": folder, "frames": True}
    with pytest.raises(PastChangedError):
        resumed(short, short.until - 0.1, REGISTRY, replace(change, options=options))
    assert caplog.messages == []
    after = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    assert after == before


def test_a_changed_include_is_refused_if_it_changes_the_past(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Changed comments do not matter; if the file is gone, the recorded text is used."""
    parts = tmp_path / "parts.yaml"
    record = recorded(tmp_path)
    assert record.end is not None
    monkeypatch.chdir("/")
    parts.write_text(f"# said otherwise\n{PARTS}")
    with resumed(record, 0.5, REGISTRY, Changed()) as run:
        assert run.finish().state_sha256 == record.end["state_sha256"]
    parts.write_text(PARTS.replace("-0.06", "-0.05"))
    with pytest.raises(PastChangedError) as refused:
        resumed(record, 0.5, REGISTRY, Changed())
    assert "arm1:sequence/aside/reach_to_pose began at" in str(refused.value)
    assert "has another offset now" in str(refused.value)
    assert f"{parts}, which the tree includes, has changed" in str(refused.value)
    parts.unlink()
    with resumed(record, 0.5, REGISTRY, Changed()) as run:
        assert run.finish().state_sha256 == record.end["state_sha256"]


def test_an_option_that_changes_the_past_is_refused(short: Record) -> None:
    changed = Changed(options={"reality": "rough", "seed": short.start["seed"]})
    with pytest.raises(PastChangedError, match="reality is rough, was not given then") as refused:
        resumed(short, 0.5, REGISTRY, changed)
    assert "seed" not in str(refused.value)


def test_another_node_type_in_the_past_is_refused(short: Record, tmp_path: Path) -> None:
    change = edited(short, tmp_path, "- subtree: {use: aside}", "- wait: {name: aside, seconds: 9}")
    with pytest.raises(
        PastChangedError, match=r"sequence/aside began at 0\.00 s and is a wait now"
    ):
        resumed(short, 0.4, REGISTRY, change)


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("mass: 1", "mass: 2", "objects"),
        ("time_limit: 20", "time_limit: 20, timestep: 0.001", "world"),
        ("posture: present", "posture: home", "arms.arm1"),
    ],
)
def test_a_change_besides_trees_is_named(
    short: Record, tmp_path: Path, old: str, new: str, part: str
) -> None:
    """Only that: the file in another folder is the same otherwise."""
    with pytest.raises(PastChangedError) as refused:
        resumed(short, 0.4, REGISTRY, edited(short, tmp_path, old, new))
    assert f"changed in the file besides trees: {part}\n" in f"{refused.value}\n"


def test_a_time_after_the_trees_were_halted_is_refused_with_the_reason(tmp_path: Path) -> None:
    """The arms came to rest; a run that continues from there would have to halt the trees again."""
    record = recorded(tmp_path, duration=0.5)
    assert record.until > 0.5
    with pytest.raises(PastChangedError) as refused:
        resumed(record, record.until, REGISTRY, Changed(options={"duration": None}))
    halted = "at 0.500 s of the record, the tree of arm1 was halted: the requested duration has"
    assert halted in str(refused.value)


@pytest.mark.parametrize("time", [0.0001, 99.0])
def test_a_time_outside_the_record_is_refused(short: Record, time: float) -> None:
    with pytest.raises(ReplayError, match="the record goes from 0 to"):
        resumed(short, time, REGISTRY, Changed())


@pytest.mark.parametrize("text", ["out", "out@", "@3", "out@x", "out@-1", "out@inf"])
def test_a_resume_argument_has_a_folder_and_a_time(text: str) -> None:
    with pytest.raises(ReplayError, match="takes DIR@SECONDS"):
        parse_place(text)
    with pytest.raises(ReplayError, match="a time after 0"):
        parse_place("out@0.0")
    assert parse_place("a@b@12.4s") == (Path("a@b"), 12.4)


def test_the_command_resumes_the_run(
    short: Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = f"{short.folder}@0.4"
    assert cli.run(["--resume", source, "--record", str(tmp_path / "again")]) == 0
    out, err = capsys.readouterr()
    assert f"continued from the past of {short.folder} up to 0.400 s" in err
    assert "SUCCESS  short" in out
    again = Record.read(tmp_path / "again")
    assert again.end == short.end
    assert cli.run(["--resume", source, "--record", str(short.folder)]) == 2
    assert "--record needs another folder" in capsys.readouterr().err
    assert cli.run(["--resume", f"{tmp_path}@1"]) == 2
    assert "contains no record" in capsys.readouterr().err
