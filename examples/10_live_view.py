"""Watch a run in a terminal in real time: the tree with its statuses.

For the scene in 3-D, cameras, signals, and breakpoints in a browser: ``bt-run motions --view``.

Prints::

    0.5 s, tool at 0.29 m/s
      > sequence
        > reach_to_pose 24 %
        . circle
    ...
    3.1 s, tool at 0.00 m/s
      + sequence
        + reach_to_pose
        + circle
"""

import sys

import bt_dualarm as bt

TREE = """
bt_dualarm: 1
world: {scene: empty}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.40]}
    tree:
      sequence:
        - reach_to_pose: {posture: present, speed: 1.0}
        - circle: {plane: yz, radius: 0.05, turns: 0.5, speed: 1.0}
"""

MARKS = {"RUNNING": ">", "SUCCESS": "+", "FAILURE": "x", "INVALID": "."}
CLEAR = "\x1b[H\x1b[J" if sys.stdout.isatty() else ""  # redraw in place

# With `real_time` a step takes at least its simulated time on the wall clock.
with bt.open(TREE, real_time=True) as run:
    arm = run.arms["arm1"]
    while not run.done:
        run.step(0.45)
        before = arm.tool_pose
        if not run.done:
            run.step(0.05)
        speed = arm.tool_pose.distance(before) / 0.05
        print(f"{CLEAR}{run.time:.1f} s, tool at {speed:.2f} m/s")
        nodes = [(1, run.trees["arm1"].snapshot())]
        while nodes:
            depth, node = nodes.pop()
            progress = "" if node.progress is None else f" {100 * node.progress:.0f} %"
            print(f"{'  ' * depth}{MARKS[node.status]} {node.name}{progress}")
            nodes += [(depth + 1, child) for child in reversed(node.children)]
