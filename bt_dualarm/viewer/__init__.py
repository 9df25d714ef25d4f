"""The web page of a run or a record: live view, replay, and one self-contained file.

Open first: `server`.
"""
