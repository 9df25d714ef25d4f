"""The base class of skills, their registry, and the parts that skills share.

Open first: `skill`.
"""
