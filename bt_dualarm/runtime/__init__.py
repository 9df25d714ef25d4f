"""A run of a tree: assembled, advanced on one simulated clock, shown, recorded, reported.

In: a checked tree file with its skills; options such as the seed, the renderer, a record's folder.
Out: a `RunResult`; status changes for those who look on; a record: summary, events, series, plots.
Open first: `api` (run, open, check), `run` (a run in steps); others: `assembly` (what it consists
of), `runner` (one step of the clock), `arm_runtime`, `signals` (Ctrl-C),
`watchdog` (code that does not return), `display` and `drawing`
(the tree as ASCII lines in the terminal), `record`, `record_folder`, `plots`, `summary` (of a
record), `state_log` (the hash), `history` (of
all states, as it grows; `history_start`, `history_frames`, `notes`, `sights`, `picture_file`).
"""
