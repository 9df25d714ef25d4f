"""Tool paths, and trajectories under velocity, acceleration and jerk limits.

Open first: `path_timing`.
"""
