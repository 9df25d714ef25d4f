"""Messages of the check for mistaken and hostile files, word for word.

The texts are beside the files in ``tests/golden/mistakes``. After an intended change,
``python -m tests.spec.test_mistakes`` rewrites them: read every one that changed aloud.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from bt_dualarm.behaviors.load import check_file
from tests.spec.writing import SKILLS

FOLDER = Path(__file__).parent.parent / "golden" / "mistakes"
FILES = sorted(FOLDER.glob("*.yaml"))


def text_of(file: Path) -> str:
    """Messages of the check, with file names relative to the folder."""
    before = Path.cwd()
    os.chdir(file.parent)
    try:
        problems = check_file(Path(file.name), SKILLS)
    finally:
        os.chdir(before)
    return "".join(f"{problem}\n" for problem in problems)


@pytest.mark.parametrize("file", FILES, ids=[file.stem for file in FILES])
def test_messages_equal_the_golden_text(file: Path) -> None:
    assert text_of(file) == file.with_suffix(".txt").read_text(encoding="utf-8")


def test_there_are_at_least_60_files_and_none_passes() -> None:
    assert len(FILES) >= 60
    assert all(text_of(file) for file in FILES)


if __name__ == "__main__":
    for mistaken in FILES:
        mistaken.with_suffix(".txt").write_text(text_of(mistaken), encoding="utf-8")
