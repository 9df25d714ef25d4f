"""What an arm would touch and how near it is, in any configuration, without moving the world.

In: a world as it is, configurations of an arm, objects that may be touched, the margin to other
arms.
Out: contacts (which link, what, how deep), distances between arms, clearance to the scene, sweep
bounds.
Open first: `checker` (is a configuration free?); others: `scratch_model` (a copy of MuJoCo's
model), `scratch_copies` (used again), `arm_distance` (arm to arm), `bounding_spheres` (quick
bounds), `contacts` (touching now), `clearance`, `sweep`.
"""
