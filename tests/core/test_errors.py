"""Which of several failures says what stopped all attempts."""

from __future__ import annotations

import pytest

from bt_dualarm.core.errors import CollisionFailure, Failure, nearest_to_success

DEEP = CollisionFailure("deep in the table", "a/wrist", "table", depth_m=0.06)
TOUCH = CollisionFailure("touches a crate", "a/palm", "crate", depth_m=0.001)
SHORT = Failure("UNREACHABLE", "too far", residual_m=0.02)
SINGULAR = Failure("SINGULAR", "near a singularity")
NO_PLAN = Failure("NO_PLAN", "no path was found", checks=4000)
BROKEN = [Failure("PATH_BROKEN", "breaks off", fraction=share) for share in (0.03, 0.44, 0.2)]


@pytest.mark.parametrize(
    ("failures", "nearest"),
    [
        ([DEEP], DEEP),
        ([DEEP, TOUCH, SHORT], TOUCH),
        ([DEEP, SHORT, SINGULAR], SHORT),
        ([SINGULAR, DEEP], DEEP),
        ([TOUCH, NO_PLAN], NO_PLAN),
        ([SINGULAR, *BROKEN], BROKEN[1]),
        ([*BROKEN, DEEP], DEEP),
        ([SINGULAR, Failure("SINGULAR", "again")], SINGULAR),
    ],
)
def test_nearest_to_success(failures: list[Failure], nearest: Failure) -> None:
    assert nearest_to_success(failures) is nearest
