"""Collision checks and distances in any configuration, without moving the world.

Open first: `checker`.
"""
