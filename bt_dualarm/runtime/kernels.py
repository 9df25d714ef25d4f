"""Which kernels a tree file needs: they are compiled before its run begins."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from bt_dualarm.spec.document import TreeFile

GROUPS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "planning": (
            "bt_dualarm.planning.path_search:warm_up_edges",
            "bt_dualarm.planning.path_search:warm_up_search",
        ),
        "motion": (
            "bt_dualarm.control.computed_torque:warm_up_control",
            "bt_dualarm.control.collision_detection:warm_up_collision_detection",
            "bt_dualarm.trajectory.set_points:warm_up_limiter",
            "bt_dualarm.trajectory.path_timing:warm_up_timing",
            "bt_dualarm.safety.failsafe:warm_up_reservations",
            "bt_dualarm.collision.distance:warm_up_spheres",
            "bt_dualarm.sim.devices:warm_up_sensors",
        ),
        "vision": (
            "bt_dualarm.control.planar_servo:warm_up_servo",
            "bt_dualarm.perception.target_filter:warm_up_prediction",
            "bt_dualarm.perception.target_filter:warm_up_rest_detection",
            "bt_dualarm.perception.shape_fit:warm_up_outlines",
            "bt_dualarm.perception.localization:warm_up_localization",
            "bt_dualarm.perception.detection:warm_up_detection",
        ),
        "cameras": (
            "bt_dualarm.sim.renderers:warm_up_renderer",
            "bt_dualarm.sim.camera:warm_up_lens",
            "bt_dualarm.sim.camera:warm_up_shutter",
        ),
        "textures": ("bt_dualarm.sim.renderers:warm_up_textures",),
        "grippers": (
            "bt_dualarm.grasping.candidates:warm_up_grasping",
            "bt_dualarm.sim.grippers:warm_up_held_objects",
        ),
    }
)
"""Functions that call the kernels of a group, by its name; kernels that call the same ones are in
one group, and groups take about equally long to compile."""


def needed(file: TreeFile) -> tuple[str, ...]:
    """Names of the groups whose kernels a run of a file may call.

    Those of a search are among them: whether one is needed shows during the run, which would wait
    for them.
    """
    arms = file.arms.values()
    names = ["planning", "motion"]
    if any(arm.camera is not None for arm in arms):
        names += ["vision", "cameras"]
        if any(obj.textures for obj in file.objects.values()):
            names.append("textures")
    if any(arm.gripper is not None for arm in arms):
        names.append("grippers")
    return tuple(names)


def compile_kernels(names: tuple[str, ...] = tuple(GROUPS)) -> None:
    """Compile groups of kernels, all of them by default; logs a line if that takes time.

    Compiles on first use on a machine; later calls return at once.
    """
    from bt_dualarm.core.kernel import compile_once

    compile_once({name: GROUPS[name] for name in names})
