"""Records read again: their timeline and scene, reruns, resumed runs.

Open first: `record`.
"""
