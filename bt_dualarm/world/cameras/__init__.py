"""Cameras with a frame rate, a latency, frames that get lost and a shake.

In: the world at a step of the clock, and the `Window` that whoever looks through it wants exposed.
Out: a `Frame`, image and pose of one exposure, handed to those who subscribed, a latency later.
Open first: `camera` (exposure and delivery); others: `frame` (what it saw), `optics` (`shutter` for
motion blur, `lens` for distortion), `calibration` (what is believed), `guarded_camera` (what a leaf
holds of it), `look` (what was found in a frame, for the record), `undrawn` (pictures of a past that
is known, drawn when somebody looks).
"""
