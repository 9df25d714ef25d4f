"""Cubic splines through points, as paths and their timing draw them.

In: knots and points.
Out: positions and derivatives at any place, and the coefficients.
Open first: `cubic_spline`.
"""
