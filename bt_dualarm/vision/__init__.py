"""From an image to where a target is and how it moves.

In: frames of a camera, the colour to look for, what is known of the target's shape and plane.
Out: a motion of the target, position, velocity and doubt, predicted to any time.
Open first: `tracker` (puts it together); others: `detect` (image to pixels), `localise` (pixels to
a point of the world), `outline` (parts that are covered), `estimate` (the filter), `calm_estimate`
(a second one beside it), `motion_model` (how it moves), `stillness`. For things that stand still:
`sighted` (found in several pictures), `edges` (outlines), `known_shape`, `shape_fit` (their poses),
`markers` (squares that are printed on them).
"""
