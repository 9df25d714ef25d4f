"""Sweeps: many runs of one tree over seeds, parameters and realities, and their statistics.

Input: a `manifest`, which defines each trial as a function of its number.
Output: one row per trial in Parquet files (`table`), a report (`report`), comparisons.
Open first: `sweep` (from a manifest to a table), then `trial` (one run as a row). `calls` runs a
function with many arguments on the same engines.
"""
