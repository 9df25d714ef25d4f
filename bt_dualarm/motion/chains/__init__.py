"""An arm as a chain of rigid bodies, in machine code: what is worked out at every set-point.

In: an arm's nominal model or its kinematics, once; what encoders say and set-points, each period.
Out: where joints and links are, inertia and bias, the state by its observers, torques.
Open first: `torque_kernels` (the law), `links` (the chain's numbers); `kernel_rows` has what
stands where in the arrays of the kernels.
"""
