"""Record folders: one run at a time uses a folder, and other files are not touched."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import bt_dualarm
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.runtime.recorder import EARLIER, LOCK, PARTS, RecordError, RecordFolder

RECORD_FILES = (
    "summary.json",
    "events.jsonl",
    "samples.npz",
    "run.log",
    "divergence.npz",
    "overview.png",
    "scene.png",
    "arm1_plane.png",
    "arm1_time.png",
)


def summary(*arms: str) -> str:
    return json.dumps({"outcome": "SUCCESS", "state_sha256": "0", "arms": dict.fromkeys(arms)})


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_an_earlier_record_is_removed_and_other_files_stay(tmp_path: Path) -> None:
    """So are plots of its arms, which would be taken for those of the new run."""
    for name in (*RECORD_FILES, "arm2_plane.png", "mine_plane.png", "notes.txt"):
        (tmp_path / name).write_text("")
    (tmp_path / "summary.json").write_text(summary("arm1", "arm2"))
    with RecordFolder(tmp_path, ["arm1"]):
        assert names(tmp_path) == {LOCK, EARLIER, "mine_plane.png", "notes.txt"}
    assert names(tmp_path) == {"mine_plane.png", "notes.txt"}, "nothing of its own stays behind"


@pytest.mark.parametrize("name", RECORD_FILES)
@pytest.mark.parametrize(
    "text", ["", "junk", "[]", "3", "{}", '{"arms": 3}', '{"arms": {"arm1": 0}}', "\xff"]
)
def test_a_file_that_is_not_from_a_run_is_not_overwritten(
    name: str, text: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(text, encoding="latin-1")
    with pytest.raises(RecordError, match=f"{name} exists and is not from a run"):
        RecordFolder(tmp_path, ["arm1"])
    assert names(tmp_path) == {name}
    assert (tmp_path / name).read_text(encoding="latin-1") == text


OTHER_FILES: dict[str, tuple[Callable[[Path], object], str]] = {
    "fifo": (os.mkfifo, "a pipe"),
    "folder": (Path.mkdir, "a folder"),
    "link to a device": (lambda path: path.symlink_to("/dev/zero"), "a symbolic link"),
    "link to nothing": (lambda path: path.symlink_to("nothing"), "a symbolic link"),
}


@pytest.mark.parametrize("kind", OTHER_FILES)
@pytest.mark.parametrize("name", [LOCK, *RECORD_FILES])
def test_an_irregular_file_is_refused_and_not_opened(name: str, kind: str, tmp_path: Path) -> None:
    """Opening a pipe without a writer would not return."""
    make, words = OTHER_FILES[kind]
    make(tmp_path / name)
    with pytest.raises(RecordError, match=f"{name} exists and is {words}, not a regular file"):
        RecordFolder(tmp_path, ["arm1"])
    assert names(tmp_path) == {name}


@given(st.text(max_size=20))
def test_a_summary_does_not_affect_other_folders(name: str) -> None:
    """Whatever names it gives to its arms."""
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent, "record")
        folder.mkdir()
        (Path(parent) / "secret_time.png").write_bytes(b"")
        (folder / "summary.json").write_text(summary("../secret", f"../{name}", name))
        with RecordFolder(folder, [name]):
            assert (Path(parent) / "secret_time.png").exists()


def test_the_folder_of_a_killed_run_is_free(tmp_path: Path) -> None:
    """Whatever it had written by then; the system has released its lock."""
    program = (
        "import os, sys; from pathlib import Path; "
        "from bt_dualarm.runtime.recorder import RecordFolder; "
        "folder = RecordFolder(Path(sys.argv[1]), []); "
        "Path(sys.argv[1], 'events.jsonl').write_text('x'); os.kill(os.getpid(), 9)"
    )
    done = subprocess.run([sys.executable, "-c", program, str(tmp_path)], check=False)
    assert (done.returncode, names(tmp_path)) == (-9, {LOCK, "events.jsonl"})
    with RecordFolder(tmp_path, ["arm1"]):
        assert names(tmp_path) == {LOCK, EARLIER}
    assert names(tmp_path) == set()


def test_files_that_a_killed_run_was_writing_are_removed(tmp_path: Path) -> None:
    """Only its own: they are hidden, and would not be found otherwise."""
    program = (
        "import os, sys; from pathlib import Path; "
        "from bt_dualarm.core.share import write_atomically; "
        "write_atomically(Path(sys.argv[1]), lambda file: os.kill(os.getpid(), 9))"
    )
    for name in ("arm1_time.png", "mine.png"):
        subprocess.run([sys.executable, "-c", program, str(tmp_path / name)], check=False)
    (tmp_path / ".arm1_time.png").touch()
    assert len(names(tmp_path)) == 3
    with RecordFolder(tmp_path, ["arm1"]):
        left = names(tmp_path) - {LOCK, ".arm1_time.png"}
    assert [name.partition(".png")[0] for name in left] == [".mine"]


def test_a_second_run_is_refused_until_the_first_is_over(tmp_path: Path) -> None:
    """Of two runs into one folder, one was once silently lost."""
    with RecordFolder(tmp_path, ["arm1"]):
        for _ in range(2):
            with pytest.raises(RecordError, match="another run is recording there"):
                RecordFolder(tmp_path, ["arm2"])
        (tmp_path / "summary.json").write_text(summary("arm1"))
    with RecordFolder(tmp_path, ["arm2"]):
        assert names(tmp_path) == {LOCK, EARLIER}


def contents(folder: Path) -> dict[str, bytes]:
    """Contents of all files in a folder, by their path relative to it."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def test_a_withdrawn_record_leaves_the_earlier_one(tmp_path: Path) -> None:
    """Also the samples of a run that was killed, and whatever the withdrawn run has written."""
    for name in (*RECORD_FILES, "arm2_plane.png", "notes.txt"):
        (tmp_path / name).write_text(f"earlier {name}")
    (tmp_path / "summary.json").write_text(summary("arm1", "arm2"))
    (tmp_path / PARTS).mkdir()
    (tmp_path / PARTS / "time.npy").write_text("earlier")
    before = contents(tmp_path)
    for _ in range(2):
        with RecordFolder(tmp_path, ["arm1", "arm3"]) as folder:
            for name in ("events.jsonl", "arm3_time.png"):
                (tmp_path / name).write_text("new")
            (tmp_path / PARTS).mkdir()
            (tmp_path / PARTS / "tool.npy").write_text("new")
            folder.withdraw()
        assert contents(tmp_path) == before


@pytest.mark.parametrize("note", ["", "notes.txt"])
def test_a_withdrawn_record_leaves_no_folder_that_it_has_created(note: str, tmp_path: Path) -> None:
    """A refused `bt-run --resume` left an empty one."""
    path = tmp_path / "new"
    with RecordFolder(path, ["arm1"]) as folder:
        if note:
            (path / note).write_text("mine")
        folder.withdraw()
    assert path.exists() == bool(note)


def test_files_set_aside_by_a_killed_run_are_removed(tmp_path: Path) -> None:
    """They were those of the run before it; other files in their folder are not touched."""
    (tmp_path / EARLIER).mkdir()
    (tmp_path / EARLIER / "events.jsonl").write_text("x")
    with pytest.raises(RecordError, match=f"{EARLIER} exists and is not from a run"):
        RecordFolder(tmp_path, [])
    (tmp_path / LOCK).touch()
    with RecordFolder(tmp_path, []):
        assert names(tmp_path) == {LOCK}
    (tmp_path / LOCK).touch()
    (tmp_path / EARLIER).mkdir()
    (tmp_path / EARLIER / "thesis.txt").write_text("x")
    with pytest.raises(RecordError, match="Directory not empty"):
        RecordFolder(tmp_path, [])
    assert contents(tmp_path) == {f"{EARLIER}/thesis.txt": b"x"}


def test_a_run_that_ends_with_an_error_before_it_begins_leaves_an_earlier_record(
    tmp_path: Path,
) -> None:
    """For example because the port of the page is in use."""
    bt_dualarm.run("circle", record=tmp_path, duration=0.02)
    before = contents(tmp_path)
    with (
        pytest.raises(DualArmError, match="no"),
        bt_dualarm.open("circle", record=tmp_path, frames=True),
    ):
        raise DualArmError("no")
    assert contents(tmp_path) == before


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(RecordError, match="is not a folder"):
        RecordFolder(tmp_path / "out", [])
    with pytest.raises(RecordError, match="Not a directory"):
        RecordFolder(tmp_path / "out" / "below", [])


def test_the_working_directory_may_change_during_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    with bt_dualarm.open("circle", record="out", duration=0.2) as run:
        run.step(0.1)
        monkeypatch.chdir(tmp_path / "elsewhere")
    assert "summary.json" in names(tmp_path / "out")
    assert LOCK not in names(tmp_path / "out")
    assert names(tmp_path / "elsewhere") == set()
