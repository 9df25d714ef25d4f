"""Descriptions of robots, checked by our own reader before any library sees them.

In: URDF and SRDF files, XML with meshes beside it.
Out: links, joints, masses, inertias and shapes that are sound, or every problem with its line.
Open first: `description` (a whole file), then `xml_source` (elements that know their place),
`link`, `joint`, `kinematic_tree` (who hangs on whom), `mesh_path` (where meshes may lie),
`arm_chains` (what could be an arm).
"""
