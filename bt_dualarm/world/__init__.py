"""The simulated world: one MuJoCo model with arms and objects that come and go while it runs.

In: a checked tree file: scene, objects, arms, seed.
Out: a `World`: poses, contacts, spawning and removing, attaching and detaching, physics steps,
saved states.
Open first: `world` (the life of a world); others: `composition` (editing the MjSpec), `view` (what
can be measured), `attachments` (welds), `stepping` (a step and divergence), `arm_body` (an arm's
place in the arrays).
"""
