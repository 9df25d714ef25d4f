"""Robots and grippers: descriptions, URDF, meshes, catalog, and their MuJoCo specs.

Open first: `robot_description`.
"""
