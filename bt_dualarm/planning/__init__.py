"""Collision-free motions: straight where possible, otherwise by a planner.

Open first: `problem`.
"""
