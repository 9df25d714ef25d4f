"""The tracking experiments: one arm moves a cube, the other follows it by its camera.

In: a `Cell`, the settings of one experiment, and seeds.
Out: trials, what was measured in each run; results over seeds; a report with pictures and bounds.
Open first: `cases` (the experiments); others: `trial` (runs one), `bounds` (theoretical bounds of
tracking), `campaign` (all that `bt-experiments` is asked for), `report`.
"""
