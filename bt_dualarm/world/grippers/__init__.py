"""What takes hold of things, on any arm: fingers and suction cups.

In: the YAML of a gripper (`assets/grippers/*.yaml`, or one of a user), the robot that carries it.
Out: `Gripper`, as everybody works with it; the robot with it on its flange; fingers, pads, drive
and cup in the arm's MjSpec; a drive with its sensors for each arm that is present.
Open first: `gripper` (what a gripper is); others: `named` (gripper by name), `gripper_entry` and
`description` (what its YAML may say), `parts` (shapes and inertia), `mounting` (on a flange),
`sealing` (does a lip lie on a thing), `carrying` and `grip_kernels` (what is held goes with it),
`mjspec` (fingers in the simulation), `drive` and `finger_kernels` (how fingers move and what is
felt of them), `tactile` and `tactile_kernels` (what pads feel).
"""
