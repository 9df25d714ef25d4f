"""A guarded move ends before a link touches an object: only the tool may.

The seeds give sequences in which a forearm came down on a cube and on another object.
"""

from __future__ import annotations

import pytest

from benchmarks.sequences import play


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "skills", "bodies"),
    [
        (21234, ("track", "move_until_contact"), ("arm1/forearm_link", "cube")),
        (
            40531,
            ("scan", "move_until_contact", "move_through"),
            ("arm1/forearm_link", "other"),
        ),
    ],
)
def test_guarded_move_ends_before_a_link_collides(
    seed: int, skills: tuple[str, ...], bodies: tuple[str, str]
) -> None:
    played = play(seed, len(skills), "lab", skills)
    assert played.breaches == ()
    (moved,) = [leaf for leaf in played.leaves if leaf[0] == "move_until_contact"]
    assert moved[1:3] == ("FAILURE", "IN_COLLISION")
    assert all(body in moved[3] for body in bodies)
