"""Pictures of a world, by OpenGL or by casting rays, which need no library.

In: a model with its state, and an `Exposure`: which camera, which part of its image, how finely.
Out: an `Image`, the same to a colour filter whichever renderer drew it; a `Still` for people.
Open first: `renderer` (the interface); others: `choose` (which one a machine gets), `raycast` (an
image by casting rays), `opengl`, `painter` and `still` (for people, with shadows).
"""
