"""Image speed of objects, compared with MuJoCo's own velocities."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from bt_dualarm.core.pose import Vector
from bt_dualarm.sim.ray_trace_kernels import Bodies, fastest
from tests.plain_kernels import plain

FOCAL_PX = 200.0
SIZE = (320, 240)
WHOLE = (0, 0, 320, 240)


def scene(seed: int) -> tuple[Any, Any, list[int]]:
    """A camera on the second link of a free body, in front of other bodies with links.

    Returns:
        Model, data, and ids of the bodies in view.
    """
    rng = np.random.default_rng(seed)
    spec = mujoco.MjSpec()
    names = []
    for name in ("eye", "one", "other"):
        body = spec.worldbody.add_body(name=name, pos=3.0 * rng.normal(size=3))
        body.add_freejoint()
        link = body.add_body(name=f"{name} link", pos=rng.normal(size=3))
        link.add_joint(axis=rng.normal(size=3))
        for part in (body, link):
            part.add_geom(size=(0.1, 0.1, 0.1))
        if name == "eye":
            link.add_camera(pos=rng.normal(size=3), quat=rng.normal(size=4))
        else:
            names += [name, f"{name} link"]
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qvel[:] = rng.normal(size=model.nv)
    mujoco.mj_forward(model, data)
    return model, data, [model.body(name).id for name in names]


def by_mujoco(model: Any, data: Any, body: int) -> float:
    """Image speed of a body in pixels per second; 0 behind the camera."""
    own = np.zeros(6)
    its = np.zeros(6)
    kinds = mujoco.mjtObj
    mujoco.mj_objectVelocity(model, data, kinds.mjOBJ_CAMERA, 0, own, 1)
    mujoco.mj_objectVelocity(model, data, kinds.mjOBJ_XBODY, body, its, 0)
    axes = data.cam_xmat[0].reshape(3, 3)
    position: Vector = (data.xpos[body] - data.cam_xpos[0]) @ axes
    along = its[3:] @ axes - own[3:] - np.cross(own[:3], position)
    if position[2] > 0.0:
        return 0.0
    pixels = [along[i] - position[i] * along[2] / position[2] for i in range(2)]
    return float(FOCAL_PX * np.hypot(*pixels) / -position[2])


@pytest.mark.parametrize("kernel", [fastest, plain(fastest)])
@pytest.mark.parametrize("seed", range(10))
def test_largest_image_speed_agrees_with_mujoco(seed: int, kernel: Any) -> None:
    model, data, names = scene(seed)
    bodies = Bodies(data.xpos, data.cvel, data.subtree_com, model.body_rootid.copy())
    axes = data.cam_xmat[0].reshape(3, 3)

    def fastest_within(radius: float) -> float:
        radii = np.full(len(names), radius)
        where = int(model.cam_bodyid[0]), bodies, data.cam_xpos[0], axes
        return float(kernel(np.array(names), radii, *where, FOCAL_PX, SIZE, WHOLE))

    everything = [by_mujoco(model, data, body) for body in names]
    assert fastest_within(1e9) == pytest.approx(max(everything), rel=1e-9)
    assert fastest_within(-1e9) == 0.0, "none of them can be in the image"
