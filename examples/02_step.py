"""Advance a run in steps, inspect it in between, and stop it early.

Prints::

    0.3 s: tool 21 mm from the center, tree RUNNING
    0.6 s: tool 97 mm from the center, tree RUNNING
    0.9 s: tool 100 mm from the center, tree RUNNING
    ...
    at (0.655, 0.088, 0.602) m: stop
    a stop was requested: arm1 UNFINISHED, at rest True
"""

import bt_dualarm as bt

with bt.open("circle", params={"radius": 0.1}) as run:  # nothing has moved yet
    arm = run.arms["arm1"]
    center = arm.tool_pose  # of the circle: that is drawn around where the tool is
    while not run.done and arm.tool_pose.position[2] > center.position[2] - 0.08:
        run.step(0.3)  # simulated seconds; how a run is divided does not change it
        distance_mm = 1000 * arm.tool_pose.distance(center)
        print(f"{run.time:.1f} s: tool {distance_mm:.0f} mm from the center,", end=" ")
        print(f"tree {run.trees['arm1'].status}")
    x, y, z = arm.tool_pose.position
    print(f"at ({x:.3f}, {y:.3f}, {z:.3f}) m: stop")
    run.stop()  # halts the trees and brings the arms to rest
    result = run.finish()

print(f"{result.ending}: arm1 {result.arms['arm1'].outcome}, at rest {result.at_rest}")
