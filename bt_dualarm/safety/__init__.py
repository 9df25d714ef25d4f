"""The guard: no arm meets another, and none touches what it should not.

Open first: `guard`.
"""
