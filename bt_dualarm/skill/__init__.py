"""What skills are made of: the base class of leaves, their registry, and the parts they share.

In: an `Arm`, ports that were checked, a clock, random numbers of their own.
Out: progress once a tick, metrics, SUCCESS of what was verified or a `Failure` with its reason.
Open first: `skill` (the base class); others: `registry` (finding skills), `path_following`,
`visual_servoing`, `briskness` and `spiral_search` (a lost target), `scoring` (against the truth).
"""
