"""The record of a run: files that survive the end of the process, read within limits.

Open first: `history_file`.
"""
