"""From a checked tree to nodes that tick, and what they tell the outside.

In: the nodes of one arm as the file has them, the skills' classes, a clock.
Out: an `ArmTree` to tick, halt and look at; every change of a status; a report per run of a leaf.
Open first: `build` (from node to behaviour); others: `composites`, `decorators` (retry, repeat,
timeout) and `words` for the words, `leaf` (how a skill is run), `board` (the blackboard).
"""
