"""A scene for detection: a camera 0.375 m in front of a colored cube that tests move."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pytest

from bt_dualarm.core.errors import RendererError
from bt_dualarm.sim.camera import Camera
from bt_dualarm.sim.frame import Renderer
from bt_dualarm.sim.renderers import choose_renderer
from bt_dualarm.spec.document import CameraSpec

SIDE_M = 0.05
FACE_DISTANCE_M = 0.35

_STUDIO = """
<mujoco>
  <visual>
    <headlight ambient="{ambient} {ambient} {ambient}" diffuse=".55 .55 .55" specular=".1 .1 .1"/>
  </visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".6 .7 .8" rgb2=".2 .3 .4"
             width="64" height="64"/>
  </asset>
  <worldbody>
    <light pos="0 -1 2" dir="0 .5 -1"/>
    <geom type="plane" size="3 3 .1" rgba=".5 .5 .5 1"/>
    <camera name="camera" pos="0 -0.375 0.5" xyaxes="1 0 0 0 0 1" fovy="50"/>
    <body name="cube" mocap="true" pos="0 0 0.5">
      <geom type="box" size=".025 .025 .025" rgba="{rgb} 1"/>
    </body>
    <body name="other" mocap="true" pos="0 -5 0.5">
      <geom type="box" size=".025 .025 .025" rgba="{rgb} 1"/>
    </body>
    <body name="screen" mocap="true" pos="0 -5 1.5">
      <geom type="box" size=".5 .001 .5" rgba=".3 .3 .3 1"/>
    </body>
  </worldbody>
</mujoco>
"""


@dataclass(frozen=True, eq=False)
class Studio:
    """The model, its state and the camera on it; what ``Camera.capture`` calls a world."""

    model: Any
    data: Any
    camera: Camera

    def place(self, x: float, z: float, body: str = "cube", y: float = 0.0) -> None:
        """Put a body to the right of and above the camera's axis, and behind the cube's plane."""
        index = self.model.body(body).mocapid[0]
        self.data.mocap_pos[index] = (x, y, 0.5 + z)

    def at(self, time: float) -> Studio:
        """This studio, with another simulation time."""
        self.data.time = time
        return self


StudioMaker = Callable[..., Studio]


@pytest.fixture(scope="module")
def renderers() -> Iterator[dict[str, Renderer]]:
    """Renderers created so far, by kind: an OpenGL context takes a tenth of a second."""
    created = dict[str, Renderer]()
    yield created
    for renderer in created.values():
        renderer.close()


@pytest.fixture(params=["ray", "gl"])
def renderer(request: pytest.FixtureRequest, renderers: dict[str, Renderer]) -> Renderer:
    """Each renderer that this machine has, in turn."""
    kind = request.param
    if kind not in renderers:
        try:
            renderers[kind] = choose_renderer(kind).create()
        except RendererError as error:
            pytest.skip(str(error))
    return renderers[kind]


@pytest.fixture
def make_studio(renderer: Renderer) -> StudioMaker:
    """Builds studios; arguments are the cube's color, the light and fields of CameraSpec."""

    def make(
        rgb: tuple[float, float, float] = (0.95, 0.85, 0.05), ambient: float = 0.35, **camera: Any
    ) -> Studio:
        text = _STUDIO.format(rgb=" ".join(map(str, rgb)), ambient=ambient)
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        return Studio(model, data, Camera("camera", CameraSpec(**camera), renderer))

    return make


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)
