"""A run watched, stopped and stepped from a browser; a record seen at any of its times.

In: a run as it is advanced, or the folder of its record; what a browser's buttons ask for.
Out: scene, trees, signals, pictures, reasons; pauses between steps, which change nothing.
Open first: `view` (run and server put together), `past_answers` (the same of a record); others:
`gate` (pause, step, speed, breakpoints), `snapshot` (the copy that a browser sees), `past` (a
record, also while it is being written), `server` (who may ask for what), `answers` (what).
"""
