"""What an arm's electronics report and obey: the only way from a controller to the plant.

In: the plant, a MuJoCo model and its state, once a physics step; torques from the controller.
Out: joint readings with their stamp; torques at the plant's motors.
Open first: `arm_hardware` (one arm's sensors and drives); `electronics` has those of all arms side
by side, `hardware_kernels` what they do at each step, compiled.
"""
