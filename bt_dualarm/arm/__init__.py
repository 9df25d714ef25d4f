"""One arm as skills see it: its state, motions, gripper and camera.

Open first: `arm`.
"""
