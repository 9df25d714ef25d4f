"""Run a shipped tree to its end and read its result.

Prints::

    <RunResult circle: SUCCESS after 4.48... s, every tree has ended (arm1 SUCCESS)>
    circle: SUCCESS from 0.00 s to 4.48 s
      path_rms_m = 0.00003...
      path_max_m = 0.00017...
      duration_s = 3.77...
      shortest_s = 3.70...
"""

import bt_dualarm as bt

result = bt.run("circle", seed=3)
print(result)

# A leaf goes by its path in the tree. A tree that fails raises nothing: status, code, and reason
# of the leaf say what happened. `metrics` are the numbers that its skill measured.
for leaf in result.arms["arm1"].leaves.values():
    print(f"{leaf.path}: {leaf.status} from {leaf.started_s:.2f} s to {leaf.ended_s or 0:.2f} s")
    for name, value in leaf.metrics.items():
        print(f"  {name} = {value:.6f}")
