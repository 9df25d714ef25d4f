"""Ways around obstacles, found by machine code: what a path touches, trees of paths, shortcuts.

In: a test of configurations (`CollisionChecker`), a start, goals.
Out: corners of a path that keeps clear of everything, between the corners, too.
Open first: `swept` (an arm and its world as the kernels read them), `quick_search` (the search);
others: `long_way` (is all of a way clear?), `sweep_kernels` (how far a straight way is free),
`room_kernels` (around one configuration), `distance_kernels` (of two shapes), `tree_kernels`
(RRT-Connect).
"""
