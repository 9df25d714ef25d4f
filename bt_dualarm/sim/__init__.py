"""The simulated world: MuJoCo model, sensors, drives, grippers, cameras and renderers.

Open first: `world`.
"""
