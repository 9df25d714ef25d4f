"""Choosing the color that a camera looks for, by eye.

Open first: `color`.
"""
