"""The whole check of a tree file, with the robots and the scene that it names, before a run.

In: a tree file, text or mapping; the skills that there are; the catalogue of robots.
Out: every problem at once: robots, postures, mounts, cameras, overlaps, poses out of reach.
Open first: `check` (the steps in their order); others: `reaching`, `robots`.
"""
