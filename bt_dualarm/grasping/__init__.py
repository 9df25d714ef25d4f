"""Where a gripper can grasp a shape, and with what force.

Open first: `candidates`.
"""
