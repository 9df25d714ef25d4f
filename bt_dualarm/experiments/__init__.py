"""The tracking experiments: one arm moves a cube, the other follows it by its camera.

Open first: `trials`.
"""
