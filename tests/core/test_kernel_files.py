"""Machine code that is broken, cannot be written or is not wanted."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from tests.core.doubling import Compiled, reported, started
from tests.families import some

SAID = "Compiling kernels, once on this machine: up to a minute"


@pytest.mark.parametrize("left", some([0, 3, 100, -1], 3))
def test_code_that_was_cut_off_is_compiled_again(left: int, compiled: Compiled) -> None:
    """As after a loss of power: numba raises over it, or LLVM ends the process."""
    cache = compiled.cache
    file = compiled.file
    scripts = compiled.scripts
    whole = file.read_bytes()
    file.write_bytes(whole[:left])
    assert reported(started(cache, scripts))[:3] == (6.0, 0, [])
    assert file.read_bytes() == whole
    assert reported(started(cache, scripts))[:3] == (6.0, 1, [])


def test_code_that_was_garbled_is_compiled_again(compiled: Compiled) -> None:
    whole = compiled.file.read_bytes()
    compiled.file.write_bytes(whole[:2000] + b"XXXX" + whole[2004:])
    assert reported(started(compiled.cache, compiled.scripts))[:3] == (6.0, 0, [])


def test_code_is_found_where_nothing_can_be_written(compiled: Compiled) -> None:
    """As in a container whose image has the code."""
    places = compiled.file.parent, compiled.file.parents[1]
    for place in places:
        place.chmod(stat.S_IRUSR | stat.S_IXUSR)
    assert reported(started(compiled.cache, compiled.scripts)) == (6.0, 1, [], places[1])
    for place in reversed(places):
        place.chmod(stat.S_IRWXU)


@pytest.mark.parametrize("mode", [stat.S_IRUSR | stat.S_IXUSR, None])
def test_without_a_place_for_code_kernels_work_all_the_same(
    mode: int | None, tmp_path: Path, scripts: Path
) -> None:
    """Which is said."""
    cache = tmp_path / "cache"
    if mode is None:
        cache.write_text("no folder")
    else:
        cache.mkdir(mode)
    result, hits, said, place = reported(started(cache, scripts))
    assert (result, hits) == (6.0, 0)
    assert said == [f"Compiling kernels, in every run: {place} cannot be written: up to a minute"]


def test_without_numba_nothing_is_compiled(tmp_path: Path, scripts: Path) -> None:
    """Nor taken for compiled by the next process."""
    cache = tmp_path / "cache"
    assert reported(started(cache, scripts, NUMBA_DISABLE_JIT="1"))[:3] == (6.0, 0, [])
    assert reported(started(cache, scripts))[1:3] == (0, [SAID])


def test_other_code_for_who_has_used_numba_before(compiled: Compiled) -> None:
    """Numba is set up for this very processor then: other code is wanted, and nothing silent."""
    cache = compiled.cache
    scripts = compiled.scripts
    for hits, said in (0, [SAID]), (1, []):
        process = started(cache, scripts, first="import numba; numba.njit(lambda x: x)\n")
        assert reported(process)[:3] == (6.0, hits, said)
    imported = started(cache, scripts, first="import numba\n")
    assert reported(imported)[:3] == (6.0, 1, [])
