"""A run watched, stopped and stepped from a browser; a record seen at any of its times.

In: a run as it is advanced, or the folder of its record; what a browser's buttons ask for.
Out: scene, trees, signals, pictures, reasons; pauses between steps, which change nothing; a record
as one file.
Open first: `view` (run and server put together), `past_answers` (the same of a record), `page_file`
(the same as a file); others: `gate` (pause, step, speed, breakpoints), `snapshot` (the copy that a
browser sees), `signals` (samples of arms and grippers), `viewers` (which pages are open), `past` (a
record, also while it is being written), `server` (who may ask for what), `answers` (what).
"""
