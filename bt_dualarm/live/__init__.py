"""A run watched, stopped and stepped from a browser on this machine.

In: a run as it is advanced; what the page's buttons ask for.
Out: a page with scene and trees; pauses between steps, which change nothing of the run.
Open first: `view` (run and server put together); others: `gate` (pause, step, speed, breakpoints),
`snapshot` (the copy that a page sees), `server` (who may ask for what).
"""
