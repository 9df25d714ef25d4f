"""The soak test: its counts, and its criteria for growth and drift."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from benchmarks.soak import TASKS, Segment, Usage, problems_of, soak, starts

TREE = """
bt_dualarm: 1
name: small soak
world: {scene: empty, timestep: 0.004, seed: 0, time_limit: 100}
arms:
  arm1:
    robot: ur5
    posture: present
    tree:
      repeat:
        times: forever
        child:
          force_success:
            child:
              sequence:
                name: move
                children:
                  - reach_to_pose: {offset: {xyz: [0, 0, 0.05]}}
                  - reach_to_pose: {offset: {xyz: [0, 0, -0.05]}}
"""


def segment(number: int, memory_mb: float = 300.0, files: int = 9, succeeded: int = 95) -> Segment:
    done = Counter(dict.fromkeys(TASKS, 100))
    good = Counter(dict.fromkeys(TASKS, succeeded))
    return Segment(number + 1.0, Usage(memory_mb, 3, files, 1), done, good)


def test_constant_usage_and_success_is_no_problem() -> None:
    assert problems_of([segment(n, 300 + n % 3, succeeded=95 - n % 3) for n in range(24)]) == []


def test_memory_may_grow_in_the_first_hour_only() -> None:
    """A first segment of half an hour does not count: imports and compiled code remain."""
    early = Segment(0.5, Usage(200.0, 3, 9, 1), segment(0).done, segment(0).succeeded)
    assert problems_of([early, *(segment(n) for n in range(4))]) == []
    (problem,) = problems_of([segment(n, 300 + n) for n in range(6)])
    assert problem == "memory changed by +1.7 %, from 300.0 to 305.0 MB"


def test_growing_files_and_falling_success_are_reported() -> None:
    found = problems_of([segment(n, files=9 + n, succeeded=99 - 8 * n) for n in range(4)])
    assert found[0] == "files grew from 9 to 12"
    assert [one.partition("'")[2].partition("'")[0] for one in found[1:]] == list(TASKS)
    assert "190 of 200 and 158 of 200" in found[1]


def test_task_that_is_never_done_is_reported() -> None:
    idle = [Segment(1.0, Usage(300.0, 3, 9, 1)), Segment(2.0, Usage(300.0, 3, 9, 1))]
    assert problems_of(idle) == [f"'{task}' was never done" for task in TASKS]


def test_short_soak_counts_tasks_and_releases_its_resources(tmp_path: Path) -> None:
    """The soak has three segments of two seconds and leaves two records."""
    segments = list(soak(6 / 3600, 2 / 3600, 0, tmp_path, TREE))
    assert [one.done["move"] for one in segments] == pytest.approx([2, 2, 2], abs=1)
    assert all(one.succeeded == one.done and one.done["move"] for one in segments)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["00001", "00002"]
    held = {(one.usage.threads, one.usage.files, one.usage.children) for one in segments[1:]}
    assert len(held) == 1, "segments release their resources"


@pytest.mark.slow
def test_starts_and_ends_release_their_resources(tmp_path: Path) -> None:
    usages = [usage for _, usage in starts(5, tmp_path)]
    assert len({(one.threads, one.files, one.children) for one in usages}) == 1
    assert not list(tmp_path.iterdir())
