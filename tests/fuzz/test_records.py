"""Hostile records cause an error message and an exit code, no other writes and no raw output."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.families import some
from tests.fuzz.malicious_records import MALICIOUS
from tests.fuzz.record_mutation import Files, mutated
from tests.fuzz.record_readers import QUICK, SLOW, fault_of
from tests.fuzz.recorded import recorded
from tests.fuzz.seeds import dice_of
from tests.fuzz.test_robots import TIMES

CHUNKS = 4
MUTANTS = int(TIMES * 8 / CHUNKS)
"""Mutants per chunk; each is read by three of the quick readers."""

MOST_MB = 1024


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    return recorded(tmp_path_factory.mktemp("recorded"))


def read_by(files: Files, names: list[str], sandbox: Path) -> list[tuple[str, bool, str]]:
    """Name of each reader, whether it refused the record, and the rule that it broke, if any."""
    sandbox.mkdir()
    files.write(sandbox / "record")
    readers = QUICK | SLOW
    return [(name, *fault_of(readers[name], sandbox)) for name in names]


def test_original_record_is_read_by_all_readers(files: Files, tmp_path: Path) -> None:
    """The record is valid before the mutations of the other tests."""
    names = [*QUICK, "--lerobot", "--check"]
    assert read_by(files, names, tmp_path / "s") == [(name, False, "") for name in names]


@pytest.mark.parametrize("name", some(MALICIOUS, 5))
def test_malicious_record_breaks_no_rule(name: str, files: Files, tmp_path: Path) -> None:
    """One reader in turn reads each record; in ``make fuzz``, all quick ones do."""
    changed = files.copy()
    MALICIOUS[name](changed)
    readers = [*QUICK]
    chosen = readers if TIMES > 1 else [readers[[*MALICIOUS].index(name) % len(readers)]]
    found = read_by(changed, chosen, tmp_path / "s")
    assert [(reader, fault) for reader, _, fault in found if fault] == []


@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_mutants_break_no_rule(chunk: int, files: Files, tmp_path: Path) -> None:
    dice = dice_of(chunk)
    faults = []
    for number in range(MUTANTS):
        done, mutant = mutated(files, dice)
        found = read_by(mutant, dice.sample([*QUICK], 3), tmp_path / str(number))
        faults += [(number, done, name, fault) for name, _, fault in found if fault]
    assert faults == []


@pytest.mark.parametrize(
    "name",
    some(["a bomb of arrays", "a bomb of text", "two hundred models", "events without end"], 2),
)
def test_bomb_needs_less_than_a_gigabyte(name: str, files: Files, tmp_path: Path) -> None:
    """Read in a separate process, as by a user."""
    changed = files.copy()
    MALICIOUS[name](changed)
    changed.write(tmp_path / "record")
    program = f"import bt_dualarm.cli as cli; cli.why([{str(tmp_path / 'record')!r}])"
    # Not `ru_maxrss`: a process inherits the value of its parent.
    report = "print(next(line for line in open('/proc/self/status') if line.startswith('VmHWM')))"
    done = subprocess.run(
        [sys.executable, "-c", f"{program}; {report}"], capture_output=True, text=True, check=True
    )
    assert "Traceback" not in done.stderr
    assert int(done.stdout.split()[-2]) < MOST_MB * 1024
