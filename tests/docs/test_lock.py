"""The lock is made by pip's own word on which wheels it would install."""

from __future__ import annotations

import hashlib
import re
import subprocess
from pathlib import Path
from zipfile import ZipFile

import pytest

from docs import lock

PIN = re.compile(r"^(\S+==\S+)((?: \\\n    --hash=sha256:[0-9a-f]{64})+)$", re.MULTILINE)


def wheel(folder: Path, name: str, tag: str = "py3-none-any") -> str:
    """Write a wheel with nothing in it; its hash."""
    path = folder / f"{name}-1.0-{tag}.whl"
    with ZipFile(path, "w") as archive:
        about = f"{name}-1.0.dist-info/"
        archive.writestr(f"{about}METADATA", f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        archive.writestr(
            f"{about}WHEEL", f"Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: {tag}\n"
        )
        archive.writestr(f"{about}RECORD", "")
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.slow
def test_a_lock_is_made_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One hash for each wheel that some Python would get; those of other machines are left out."""
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path))
    plain = wheel(tmp_path, "plain")
    tags = [f"cp{number}-cp{number}-manylinux_2_17_x86_64" for number in (311, 312, 313)]
    built = sorted(wheel(tmp_path, "built", tag) for tag in tags)
    wheel(tmp_path, "built", "cp312-cp312-win_amd64")
    pins = tmp_path / "pins.txt"
    made = tmp_path / "made.lock"
    pins.write_text("plain==1.0\nbuilt==1.0\n", encoding="utf-8")
    lock.main(pins, made)
    content = made.read_text(encoding="utf-8")
    assert [name for name, _ in PIN.findall(content)] == ["built==1.0", "plain==1.0"]
    found = {name: re.findall(r"sha256:(\w+)", hashes) for name, hashes in PIN.findall(content)}
    assert found == {"built==1.0": built, "plain==1.0": [plain]}
    pins.write_text("built==2.0\n", encoding="utf-8")
    with pytest.raises(subprocess.CalledProcessError):
        lock.main(pins, made)


def test_the_lock_is_of_the_form_that_it_is_made_in() -> None:
    """Written by hand it would differ from what the next renewal makes of it."""
    text = lock.LOCK.read_text(encoding="utf-8")
    pins = {name: re.findall(r"sha256:(\w+)", hashes) for name, hashes in PIN.findall(text)}
    most = max(map(len, pins.values()))
    by_python = [{pin: some[i] for pin, some in pins.items() if i < len(some)} for i in range(most)]
    assert lock.locked(by_python) == text
