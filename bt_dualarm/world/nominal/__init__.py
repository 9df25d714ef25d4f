"""What a controller believes of an arm: the robot's page and the tree file, never the plant.

In: the robot's page, the pose of its base, what it holds as the file declares it; joint readings.
Out: kinematics and dynamics of that one arm, in a MuJoCo model of its own.
Open first: `nominal_arm`; others: `nominal_load` (what the arm holds).
"""
