"""Forward and inverse kinematics: joint angles to tool poses and back.

In: a robot, where its base stands, tool poses or whole paths of them (targets, tolerance, residual,
seed).
Out: configurations in one branch within the joint limits, the Jacobian's condition (singularity),
the reach.
Open first: `arm_kinematics` (one arm: `solve`, `follow`); others that matter: `multistart`
(restarts from many configurations), `gauss_newton` (PlaCo's iteration), `workspace` (how far a tool
gets), `multi_arm`.
"""
