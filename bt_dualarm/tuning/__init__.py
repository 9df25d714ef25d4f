"""Choosing by eye what colour a camera looks for.

In: one picture, of a camera of a tree file or of an image file, and a colour.
Out: what is found of that colour, as a table and a picture; new ranges, written where they belong.
Open first: `look` (what is found); others: `shot` (takes the picture), `page` (the live page),
`saving` (writes).
"""
