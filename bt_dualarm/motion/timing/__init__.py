"""When a path is where: motions in time under limits of velocity, acceleration and jerk.

In: configurations along a path, or two of them, and joint limits.
Out: a `Trajectory`: set-points on an even grid, from rest to rest, no limit passed.
Open first: `path_timing` (along a path); others: `time_optimal` (TOPP-RA), `jerk_limited` (the jerk
limit by a moving average), `point_to_point` (Ruckig, stops), `trajectory` (what a motion is, how
much of limits it uses).
"""
