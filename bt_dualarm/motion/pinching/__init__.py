"""Two pads that shut on a solid, in machine code: distances, what they meet, force, and room.

In: solids as numbers (`kernel_forms`), lines along which pads close, measures, loads.
Out: rows of numbers, entered into arrays that are given.
Open first: `jaw_kernels` (places where pads hold, room around a gripper); others: `pad_kernels`
(what pads meet, the force of a pinch), `solid_kernels` (distance and reach of a solid).
"""
