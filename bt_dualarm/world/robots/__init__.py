"""Robots: from a page of YAML and a URDF to an arm that can be attached to a world.

In: the name of a robot or the path of its page; URDF, SRDF and meshes of example-robot-data.
Out: a `Robot` (joint limits, postures, tool frame, camera mounts) and its MjSpec with shapes and
motors.
Open first: `catalogue` (names to robots); others: `robot` (what a robot is), `page` (what a page
may say), `arm_description` (page and URDF together, every problem at once), `page_draft` (a first
page from a URDF), `mjspec` (shapes, motors, exclusions), `meshes` (COLLADA to STL, cached),
`mesh_shapes` (hulls, convex parts), `geom_groups`.
"""
