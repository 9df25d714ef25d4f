"""Piles of every shape under every kind of light, small enough for kernels in plain Python.

As a program, it writes the pickled images of the given seeds to standard output.
"""

from __future__ import annotations

import pickle
import sys
from typing import Any

import mujoco
import numpy as np

from bt_dualarm.sim.frame import Exposure, Viewpoint
from bt_dualarm.sim.renderers import RayRenderer, RayScene, fan_of

WIDTH = 32
HEIGHT = 24
_KINDS = ("sphere", "cylinder", "capsule", "box", "mesh", "sphere", "box", "capsule")
_CORNERS = np.random.default_rng(5).normal(0.0, 0.1, (12, 3))
_ROCK = "  ".join(" ".join(f"{value:.4f}" for value in corner) for corner in _CORNERS)


def pile(seed: int) -> tuple[Any, Any]:
    """A pile of colored or textured shapes on a finite tiled floor."""
    rng = np.random.default_rng(seed)

    def numbers(values: Any) -> str:
        return " ".join(f"{value:.4f}" for value in values)

    geoms = []
    for kind in _KINDS:
        size = 'mesh="rock"' if kind == "mesh" else f'size="{numbers(rng.uniform(0.05, 0.2, 3))}"'
        appearance = rng.choice(["", 'material="tiles"', 'material="steel"'])
        appearance = appearance or f'rgba="{numbers(rng.random(3))} 1"'
        pose = f'pos="{numbers(rng.uniform(-0.4, 0.4, 3))}" quat="{numbers(rng.normal(size=4))}"'
        geoms.append(f'<geom type="{kind}" {size} {appearance} {pose}/>')
    model = mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".6 .7 .8" rgb2=".2 .3 .4"
             width="8" height="8"/>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".4 .4 .45" rgb2=".5 .5 .55"
             width="8" height="8"/>
    <material name="tiles" texture="tiles"/>
    <material name="steel" rgba=".2 .4 .6 1"/>
    <mesh name="rock" vertex="{_ROCK}"/>
  </asset>
  <worldbody>
    <light pos="0 0 3" dir="0 0 -1" diffuse=".5 .5 .5"/>
    <light type="directional" dir="0 1 -1" diffuse=".2 .2 .2"/>
    <geom type="plane" size="1 1.5 .1" pos="0 0 -.5" material="tiles"/>
    <camera name="camera" pos="1.4 0 .3" xyaxes="0 1 0 -.2 0 1" fovy="50"/>
    {"".join(geoms)}
  </worldbody>
</mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def rendered(seed: int) -> tuple[Any, Any, Any]:
    """Geoms and distances hit by rays, and an image with a window and blocks."""
    model, data = pile(seed)
    fan = fan_of(Viewpoint(np.array((1.2, 0.3, 0.5)), np.zeros(3), 45.0), WIDTH, HEIGHT)
    hits = RayScene(model, (0,)).trace(data, fan)
    exposure = Exposure(0, 2 * WIDTH, 2 * HEIGHT, (5, 3, 55, 41), stride=2)
    return hits.geoms, hits.distances, RayRenderer().render(model, data, exposure)


if __name__ == "__main__":
    sys.stdout.buffer.write(pickle.dumps([rendered(int(seed)) for seed in sys.argv[1:]]))
