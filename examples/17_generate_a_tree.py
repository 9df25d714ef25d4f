"""Build a tree as Python data: two arms that draw polygons, mirrored, at the same time.

Prints::

    left: SUCCESS with 7 leaves
    right: SUCCESS with 5 leaves
    the tools came as near as 0.39 m to each other
"""

from itertools import pairwise
from math import cos, pi, sin
from typing import Any

import bt_dualarm as bt

Node = dict[str, Any]  # Any: values that YAML can express


def polygon(corners: int, radius: float) -> Node:
    """Sequence of straight tool motions along a regular polygon; radius in m."""
    angles = [2 * pi * i / corners for i in range(corners + 1)]
    points = [(radius * cos(angle), radius * sin(angle)) for angle in angles]
    steps = [[0.0, b[0] - a[0], b[1] - a[1]] for a, b in pairwise(points)]
    lines = [{"move_linear": {"offset": {"xyz": step}, "speed": 1.0}} for step in steps]
    return {"sequence": [*lines, {"go_home": {}}]}


def arm(side: float, corners: int) -> Node:
    """Arm specification of a UR5 at a sideways offset in m that draws a polygon."""
    base = {"xyz": [0.0, side, 0.4]}
    return {"robot": "ur5", "base": base, "tree": polygon(corners, radius=0.08)}


tree = {
    "bt_dualarm": 1,
    "name": "polygons",
    "world": {"scene": "empty", "reality": "lab"},
    "arms": {"left": arm(0.25, corners=6), "right": arm(-0.25, corners=4)},
}

with bt.open(tree) as run:
    left, right = run.arms["left"], run.arms["right"]
    nearest = left.tool_pose.distance(right.tool_pose)
    while not run.done:
        run.step(0.02)
        nearest = min(nearest, left.tool_pose.distance(right.tool_pose))
    result = run.finish()

for name, arm_result in result.arms.items():
    print(f"{name}: {arm_result.outcome} with {len(arm_result.leaves)} leaves")
print(f"the tools came as near as {nearest:.2f} m to each other")
