"""From where a tool is to be to torques: kinematics, paths, planning, timing, safety, control.

In: an arm of the world, and what a skill asks of its tool or its joints: a pose, a path, a joint
target.
Out: torques within the limits of velocity, acceleration, jerk and effort, or a `Failure` with its
reason.
Open first: `control/controller` (what happens each period); each sub-package has a map of its own.
"""
