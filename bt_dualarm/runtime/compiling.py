"""All kernels of the package, compiled before a run needs them."""

from __future__ import annotations

from bt_dualarm.kernels.kernel import compile_once
from bt_dualarm.motion.chains.warming import move_something
from bt_dualarm.motion.collision.bounding_spheres import bound_something
from bt_dualarm.motion.grasping.warming import grasp_something
from bt_dualarm.motion.hits.collision_watch import be_hit_by_something
from bt_dualarm.motion.safety.failsafe import reserve_something
from bt_dualarm.motion.search.quick_search import search_something
from bt_dualarm.motion.setpoints.planar_servo import follow_something
from bt_dualarm.motion.timing.path_timing import time_something
from bt_dualarm.vision.detect import detect_something
from bt_dualarm.vision.guessed_plane import swing_something
from bt_dualarm.vision.motion_model import predict_something
from bt_dualarm.vision.outline_error import outline_something
from bt_dualarm.vision.stillness import rest_something
from bt_dualarm.world.cameras.lens import bend_something
from bt_dualarm.world.cameras.shutter import move_past_something
from bt_dualarm.world.grippers.carrying import carry_something
from bt_dualarm.world.grippers.drive import finger_something
from bt_dualarm.world.grippers.tactile import feel_something
from bt_dualarm.world.hardware.arm_hardware import sense_something
from bt_dualarm.world.rendering.raycast import draw_something
from bt_dualarm.world.touches import touch_something


def compile_kernels() -> None:
    """See to it that the machine code of all kernels is there; logs a line where that takes time.

    Harmless when repeated: once on a machine it does something.
    """
    cameras = draw_something, bend_something, move_past_something, detect_something
    world = sense_something, touch_something, bound_something
    vision = predict_something, rest_something, outline_something, swing_something
    motion = move_something, follow_something, time_something, search_something
    grips = carry_something, finger_something, feel_something, grasp_something
    compile_once(
        (*cameras, *world, *vision, *motion, *grips, reserve_something, be_hit_by_something)
    )
