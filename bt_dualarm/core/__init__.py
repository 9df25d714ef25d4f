"""Foundations that every other package uses: errors, poses, compiled kernels, shared files.

Open first: `errors`.
"""
