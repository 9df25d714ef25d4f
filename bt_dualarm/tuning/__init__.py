"""Choosing by eye what colour a camera looks for: one picture, what is found in it, new ranges."""
