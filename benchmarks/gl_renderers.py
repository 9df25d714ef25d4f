"""Our OpenGL renderer versus ``mujoco.Renderer``: availability, pixels, cost of a frame.

    python -m benchmarks.gl_renderers

Scene and window are those of `benchmarks.rendering`; times are the best of several, in
milliseconds. MuJoCo chooses its OpenGL library on import, by the environment variable MUJOCO_GL, so
each choice is tried in a separate process.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np

from benchmarks.rendering import WINDOW, best_ms, demo_world
from bt_dualarm.robots.mjspec import LOOP_GROUPS
from bt_dualarm.sim.frame import Exposure, Image
from bt_dualarm.sim.renderers import GlContext, GlRenderer, open_context
from bt_dualarm.sim.world import World

WIDTH, HEIGHT = 320, 240


def memory_mb() -> float:
    """Resident memory of this process in MB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGESIZE") / 2**20


ALONE = """
import mujoco
with mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>")) as renderer:
    print("works" if renderer.render().shape == (240, 320, 3) else "wrong shape")
"""
"""Program that uses only MuJoCo."""


def works(choice: str) -> str:
    """Result of ``mujoco.Renderer`` with this value of MUJOCO_GL."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", ALONE],
        env=os.environ | {"MUJOCO_GL": choice},
        capture_output=True,
        text=True,
        check=False,
    )
    return (done.stdout or done.stderr).strip().splitlines()[-1]


def main() -> None:
    """Print where mujoco.Renderer works, and the pixels and times of both for the same scene."""
    # Before the first context, because the processes would inherit PyOpenGL's choice.
    for choice in ("", "egl", "osmesa"):
        print(f"mujoco.Renderer with MUJOCO_GL={choice}: {works(choice)}")
    context = open_context()
    print(f"our context, without any setting: {context.platform}")

    with demo_world() as world:
        measure(world, context)


def measure(world: World, context: GlContext) -> None:
    """Compare images, times and memory of both renderers in a world."""
    model = world.model
    data = world.data
    camera = world.arms["arm2"].camera_id
    ours = GlRenderer(context)
    exposure = Exposure(camera, WIDTH, HEIGHT)
    part = Exposure(camera, WIDTH, HEIGHT, WINDOW)
    whole = ours.render(model, data, exposure)

    option = mujoco.MjvOption()
    option.sitegroup[:] = 0
    option.geomgroup[:] = 0
    option.geomgroup[list(LOOP_GROUPS)] = 1
    before = memory_mb()
    theirs = mujoco.Renderer(model, HEIGHT, WIDTH)
    theirs.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
    theirs.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0

    def draw() -> Image:
        theirs.update_scene(data, camera, option)
        image: Image = theirs.render()
        return image

    differ = np.abs(whole.astype(int) - draw())
    print(f"pixels that differ: {np.count_nonzero(differ.max(axis=2))}, by at most {differ.max()}")
    print(f"memory of one more mujoco.Renderer: {memory_mb() - before:.0f} MB")

    def draw_resized() -> None:
        with mujoco.Renderer(model, WINDOW[3] - WINDOW[1], WINDOW[2] - WINDOW[0]) as renderer:
            renderer.update_scene(data, camera, option)
            renderer.render()

    for label, action in {
        "ours, whole image 320 x 240": lambda: ours.render(model, data, exposure),
        "mujoco.Renderer, whole image 320 x 240": draw,
        "ours, window 56 x 56 of any position and size": lambda: ours.render(model, data, part),
        "mujoco.Renderer, recreated for a window of another size": draw_resized,
    }.items():
        print(f"{label}: {best_ms(action, 8):.2f} ms")
    side = model.vis.global_.offwidth + 1
    try:
        mujoco.Renderer(model, HEIGHT, side)
    except ValueError as error:
        print(f"image {side} pixels wide: {str(error).strip().splitlines()[0]}")


if __name__ == "__main__":
    main()
