"""A run as a Gymnasium environment, in which actions replace the trees of some arms.

Open first: `api`.
"""
