"""From images to where a target is and how it moves, and to poses of objects at rest.

Open first: `tracker`.
"""
