"""Set-points: what a controller is to follow, one every control period.

In: a trajectory, a stream, or a target in a plane; limits of the joints.
Out: positions, velocities and accelerations of the joints that keep the limits, at any time scale.
Open first: `limiter` (the gate that keeps the limits, jerk included); others: `set_point`,
`trajectory_source`, `stream_source`, `planar_servo` (follows a target by `following_kernels`),
`time_scaling` (slower).
"""
