"""Interactive tuning of the color that a camera looks for.

Open first: `color`.
"""
