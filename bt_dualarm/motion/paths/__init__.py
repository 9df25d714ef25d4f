"""Paths of a tool in space, without time.

In: poses or the numbers of a curve: waypoints, radius, amplitude, frequency, corner blending, axis
and angle.
Out: a `CartesianPath`: poses of the tool in small steps, lines, circles, arcs, Lissajous curves and
splines.
Open first: `cartesian_path` (what a path is, lines, splines); others: `curves`, `blending` (rounded
corners).
"""
