"""Forward and inverse kinematics: joint angles to tool poses and back.

Open first: `inverse_kinematics`.
"""
