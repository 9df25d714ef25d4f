"""Hits: torques from outside that come faster than anything that is off in an arm's model.

In: at every set-point the inertia of an arm, what is meant, and torques that nobody has asked for.
Out: whether the arm was hit; by how much a torque changed, and what would have been usual.
Open first: `collision_watch` (what counts); its arithmetic is in `hit_kernels`, whose rows are in
`kernel_rows`.
"""
