"""Why a run failed: the deciding leaf, its cause, and the evidence.

Open first: `story`.
"""
