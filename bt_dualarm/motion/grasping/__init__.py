"""Where a gripper can take a shape, and how firmly: candidates for fingers and for suction.

In: a solid in its own frame, the measures of a gripper, the load; to rank, where things stand.
Out: grasps, each a pose of the tool on the object with the force that it takes, best first; or why
there is none.
Open first: `jaw_grasps` (candidates of a parallel gripper); others: `solids` (box, cylinder,
sphere, capsule) and `mesh_solid` (triangles), `antipodal` (pairs of opposite points), `pads`
(what they meet), `holding_force` (wrenches that friction of soft fingers resists), `suction`
(faces for a cup), `ranking` (margin, clearance, reach), `gripper_measures`, `grasp`,
`warming` (calls the kernels of `motion.pinching` once).
"""
