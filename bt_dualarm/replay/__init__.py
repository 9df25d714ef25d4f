"""Records of runs, read again: what went wrong and why, whether a run repeats, pages and tables.

In: the folder of a record, whole or left behind by a process that was killed.
Out: a `Record`; the story of a failure.
Open first: `record` (all that a record holds).
"""
