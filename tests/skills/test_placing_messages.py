"""Messages of `place` for goals at which an object would not stay."""

from __future__ import annotations

from tests.skills.test_unnamed_objects import failure


def test_unstable_capsule_is_not_blamed_on_the_support() -> None:
    """The table is level, but a capsule cannot stand on its end."""
    code, reason = failure(
        {
            "sequence": [
                {"grasp": {"object": "cube"}},
                {"place": {"at": {"xyz": [0.30, -0.45, 0.44], "rpy": [0, 0, 0]}}},
            ]
        },
        shape="capsule",
        size=[0.02, 0.04],
        pose={"xyz": [0.40, -0.45, 0.42], "rpy": [90, 0, 0]},
    )
    assert code == "NOT_SUPPORTED", reason
    assert "not level" not in reason
    assert "give `at` an orientation in which it lies" in reason
