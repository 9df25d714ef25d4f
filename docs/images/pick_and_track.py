"""Draw the picture of the README: the main job in its last curve, and what arm2 sees then.

Needs OpenGL for its shadows (see docs/dependencies.md); runs themselves do not.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import cv2
import mujoco
import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.runtime.parts import IdleObserver
from bt_dualarm.runtime.run import Run
from bt_dualarm.share import share_dir
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.load import load_tree_file
from bt_dualarm.tree.report import StatusChange
from bt_dualarm.world.rendering.gl_context import open_context
from bt_dualarm.world.rendering.opengl import GlRenderer
from bt_dualarm.world.rendering.renderer import Exposure, Image
from bt_dualarm.world.rendering.viewpoint import Viewpoint
from bt_dualarm.world.robots.geom_groups import PICTURE_GROUPS
from bt_dualarm.world.world import World

TARGET: Final = Path(__file__).with_suffix(".png")
SIZE: Final = (1280, 640)
INSET: Final = (320, 240)
VIEWPOINT: Final = Viewpoint(
    eye=np.array([1.75, 1.80, 1.35]), look_at=np.array([0.76, 0.0, 0.57]), fov_deg=34.0
)
CURVE: Final = "lissajous"
MOMENT: Final = 0.93
"""Share of the curve after which the picture is taken."""

CUBE_TRAIL: Final = (240, 190, 0)
TOOL_TRAIL: Final = (40, 110, 220)


@dataclass
class Film(IdleObserver):
    """An observer that keeps the joint positions of the world every tenth step."""

    world: World
    times: list[float] = field(default_factory=list)
    states: list[Vector] = field(default_factory=list)
    curve: list[float] = field(default_factory=list)

    def on_event(self, change: StatusChange) -> None:
        """Note when the curve begins and ends."""
        if change.kind == CURVE:
            self.curve.append(change.time)

    def after_step(self, time: float) -> None:
        """Keep every tenth state."""
        if round(time / self.world.timestep) % 10 == 0:
            self.times.append(time)
            self.states.append(self.world.data.qpos.copy())

    def until_the_moment(self) -> list[Vector]:
        """States from the begin of the curve to the moment of the picture."""
        begin, end = self.curve[0], self.curve[-1]
        last = begin + MOMENT * (end - begin)
        pairs = zip(self.times, self.states, strict=True)
        return [state for moment, state in pairs if begin <= moment <= last]


def film_the_job(file: TreeFile, registry: Registry) -> Film:
    """Run the main job as ``bt-run`` does."""
    with Run(file, registry) as opened:
        film = Film(opened.world)
        opened.watch(film)
        opened.finish()
    return film


def draw_trail(image: Image, points: Matrix, color: tuple[int, int, int]) -> None:
    """Draw a polyline through world points of shape (n, 3)."""
    pixels = np.round(VIEWPOINT.pixels(points, *SIZE) * 16).astype(np.int32)
    cv2.polylines(image, [pixels], False, color, 3, cv2.LINE_AA, shift=4)


def paint(world: World, states: list[Vector]) -> Image:
    """The scene in the last of the states, the ways of cube and tool, the image of arm2."""
    cube, tool = [], []
    for state in states:
        world.data.qpos[:] = state
        mujoco.mj_kinematics(world.model, world.data)
        cube.append(world.object_pose("cube").position)
        tool.append(world.arms["arm2"].tool_pose.position)
    mujoco.mj_camlight(world.model, world.data)
    renderer = GlRenderer(open_context(*SIZE), samples=8, effects=True)
    camera = world.arms["arm2"].camera_id
    inset = renderer.render(
        world.model, world.data, Exposure(camera, *INSET, groups=PICTURE_GROUPS)
    )
    image = from_outside(renderer, world, camera)
    draw_trail(image, np.array(cube), CUBE_TRAIL)
    draw_trail(image, np.array(tool), TOOL_TRAIL)
    place(image, inset)
    return image


def from_outside(renderer: GlRenderer, world: World, camera: int) -> Image:
    """The whole scene; the camera of the arm is borrowed and moved for it."""
    data: Any = world.data
    data.cam_xpos[camera] = VIEWPOINT.eye
    data.cam_xmat[camera] = VIEWPOINT.axes.ravel()
    world.model.cam_fovy[camera] = VIEWPOINT.fov_deg
    return renderer.render(world.model, data, Exposure(camera, *SIZE, groups=PICTURE_GROUPS))


def place(image: Image, inset: Image) -> None:
    """Put the small image into the lower right corner, in a frame."""
    width, height = INSET
    margin, frame = 16, 3
    top, left = SIZE[1] - margin - height, SIZE[0] - margin - width
    image[top - frame : top + height + frame, left - frame : left + width + frame] = 255
    image[top : top + height, left : left + width] = inset


def main() -> None:
    """Run the job, draw, write the file."""
    registry = Registry.load()
    file = load_tree_file(share_dir("trees") / "pick_and_track.yaml", registry.kinds)
    film = film_the_job(file, registry)
    world = World(file, file.world.seed, visuals=True)
    image = paint(world, film.until_the_moment())
    cv2.imwrite(
        str(TARGET), cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_PNG_COMPRESSION, 9]
    )


if __name__ == "__main__":
    main()
