"""Machine code that is damaged, cannot be written or is disabled."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from tests.core.doubling import Compiled, reported, started
from tests.families import some

NOTICE = "Compiling kernels, once on this machine: up to a minute"


@pytest.mark.parametrize("left", some([0, 3, 100, -1], 3))
def test_truncated_code_is_compiled_again(left: int, compiled: Compiled) -> None:
    """After a loss of power, for example, numba would raise or LLVM would end the process."""
    cache = compiled.cache
    file = compiled.file
    scripts = compiled.scripts
    whole = file.read_bytes()
    file.write_bytes(whole[:left])
    assert reported(started(cache, scripts))[:3] == (6.0, 0, [])
    assert file.read_bytes() == whole
    assert reported(started(cache, scripts))[:3] == (6.0, 1, [])


def test_corrupted_code_is_compiled_again(compiled: Compiled) -> None:
    whole = compiled.file.read_bytes()
    compiled.file.write_bytes(whole[:2000] + b"XXXX" + whole[2004:])
    assert reported(started(compiled.cache, compiled.scripts))[:3] == (6.0, 0, [])


def test_code_in_a_read_only_folder_is_found(compiled: Compiled) -> None:
    """A container image that includes the code is an example."""
    places = compiled.file.parent, compiled.file.parents[1]
    for place in places:
        place.chmod(stat.S_IRUSR | stat.S_IXUSR)
    assert reported(started(compiled.cache, compiled.scripts)) == (6.0, 1, [], places[1])
    for place in reversed(places):
        place.chmod(stat.S_IRWXU)


@pytest.mark.parametrize("mode", [stat.S_IRUSR | stat.S_IXUSR, None])
def test_kernels_work_without_a_writable_cache(
    mode: int | None, tmp_path: Path, scripts: Path
) -> None:
    """The log says so."""
    cache = tmp_path / "cache"
    if mode is None:
        cache.write_text("no folder")
    else:
        cache.mkdir(mode)
    result, hits, log, folder = reported(started(cache, scripts))
    assert (result, hits) == (6.0, 0)
    assert log == [f"Compiling kernels, in every run: {folder} cannot be written: up to a minute"]


def test_without_numba_nothing_is_compiled(tmp_path: Path, scripts: Path) -> None:
    """The next process compiles as if for the first time."""
    cache = tmp_path / "cache"
    assert reported(started(cache, scripts, NUMBA_DISABLE_JIT="1"))[:3] == (6.0, 0, [])
    assert reported(started(cache, scripts))[1:3] == (0, [NOTICE])


def test_process_that_has_used_numba_before_has_its_own_code(compiled: Compiled) -> None:
    """Numba is then configured for this specific processor, so different code is compiled."""
    cache = compiled.cache
    scripts = compiled.scripts
    for hits, log in (0, [NOTICE]), (1, []):
        process = started(cache, scripts, first="import numba; numba.njit(lambda x: x)\n")
        assert reported(process)[:3] == (6.0, hits, log)
    imported = started(cache, scripts, first="import numba\n")
    assert reported(imported)[:3] == (6.0, 1, [])
