"""Machine code of all kernels that look for grasps, loaded as this module is imported.

Loading takes 0.3 s, which no tick should wait for: skills that grasp name this module in `needs`.
"""

from __future__ import annotations

from bt_dualarm.grasping.candidates import warm_up_grasping

warm_up_grasping()
