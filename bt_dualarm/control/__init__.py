"""Control of an arm: computed torque, observers, payload estimation, collision detection.

Open first: `controller`.
"""
