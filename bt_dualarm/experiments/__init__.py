"""The tracking experiments: one arm moves a cube, and the other tracks it with its camera.

Open first: `trials`.
"""
