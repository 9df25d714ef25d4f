"""The world of a record at one time: where things were, what touched what, what a camera saw.

It looks at the simulator's truth, which no arm ever did: after the run that is what one wants.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.replay.record import Record
from bt_dualarm.world.robots.geom_groups import PARTS_GROUP
from bt_dualarm.world.robots.mjspec import TOOL_SITE

_MARGIN_M = 1e-3
"""How much nearer than an object a ray must end to have met something else."""


@dataclass(frozen=True)
class Touch:
    """Two bodies in contact.

    Attributes:
        own: Body of the arm, or the thing that it holds.
        other: The other body.
        depth_m: How deep they are in each other, in m.
    """

    own: str
    other: str
    depth_m: float


@dataclass(frozen=True)
class Sight:
    """What a camera could see of an object.

    Attributes:
        state: ``seen``, ``hidden`` or ``outside``.
        hidden_by: Body that hides most of it, or empty.
        off_axis_deg: Angle between the view axis and the object's centre.
        half_view_deg: Angle between the view axis and the nearest edge of the picture.
        distance_m: Distance from the camera in m.
    """

    state: str
    hidden_by: str
    off_axis_deg: float
    half_view_deg: float
    distance_m: float


class Scene:
    """The world at one of the times whose state is kept.

    Args:
        record: The record.
        time: Simulated time in s; the state at or before it is taken.
    """

    def __init__(self, record: Record, time: float) -> None:
        self._record = record
        moment = record.moment(record.index_at(min(max(time, 0.0), record.until)))
        self.time = moment.time
        self.model = record.model(moment.generation)
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:], self.data.qvel[:] = moment.qpos, moment.qvel
        self.data.time = moment.time
        mujoco.mj_fwdPosition(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def has(self, name: str) -> bool:
        """Whether an object is in the world."""
        return self._body(name) >= 0

    def position(self, name: str) -> Vector:
        """Position of an object's centre, of shape (3,), m."""
        found: Vector = self.data.xpos[self._body(name)].copy()
        return found

    def tool(self, arm: str) -> Vector | None:
        """Position of an arm's tool, of shape (3,), m; None if it is not in the world."""
        site = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, f"{arm}/{TOOL_SITE}")
        if site < 0:
            return None
        found: Vector = self.data.site_xpos[site].copy()
        return found

    def held(self, arm: str) -> list[str]:
        """Objects that are welded to an arm."""
        welds = self.model.eq_type == mujoco.mjtEq.mjEQ_WELD
        names = []
        for weld in np.flatnonzero(welds & (self.data.eq_active != 0)):
            pair = {self._name(int(self.model.eq_obj1id[weld])): 0}
            pair[self._name(int(self.model.eq_obj2id[weld]))] = 1
            if any(name.startswith(f"{arm}/") for name in pair):
                names += [name for name in pair if "/" not in name]
        return names

    def beside(self, thing: str, within: float) -> list[tuple[str, float]]:
        """Other objects that are so near to one, the nearest first, and how near, in m."""
        others = [name for name in self._record.start["objects"] if self.has(name)]
        own, *geoms = (int(self.model.body_geomadr[self._body(name)]) for name in (thing, *others))
        gaps = (
            mujoco.mj_geomDistance(self.model, self.data, own, geom, 2.0 * within, None)
            for geom in geoms
        )
        found = [
            (name, max(float(gap), 0.0))
            for name, gap in zip(others, gaps, strict=True)
            if name != thing and gap <= within
        ]
        return sorted(found, key=lambda pair: pair[1])

    def touches(self, arm: str) -> list[Touch]:
        """What the arm, and what it holds, is in contact with."""
        own = {*self.held(arm)}
        found = []
        for contact in self.data.contact[: self.data.ncon]:
            names = [self._owner(int(geom)) for geom in contact.geom]
            mine = [name.startswith(f"{arm}/") or name in own for name in names]
            if mine[0] != mine[1] and contact.dist <= 0.0:
                first, second = names if mine[0] else reversed(names)
                found.append(Touch(first, second, float(-contact.dist)))
        return found

    def near(self, point: Vector, within: float) -> list[str]:
        """Bodies whose boxes are so near to a point, of shape (3,), m, the nearest first."""
        inward = np.einsum(
            "gji,gj->gi", self.data.geom_xmat.reshape(-1, 3, 3), point - self.data.geom_xpos
        )
        boxes = self.model.geom_aabb
        away = np.linalg.norm(np.maximum(np.abs(inward - boxes[:, :3]) - boxes[:, 3:], 0.0), axis=1)
        order = np.argsort(away)
        names = (self._owner(int(geom)) for geom in order if away[geom] <= within)
        return list(dict.fromkeys(names))

    def sight(self, arm: str, thing: str) -> Sight | None:
        """What the camera of an arm could see of an object; None where one is not there."""
        camera = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_CAMERA, f"{arm}/camera")
        if camera < 0 or not self.has(thing):
            return None
        eye = self.data.cam_xpos[camera]
        axes = self.data.cam_xmat[camera].reshape(3, 3)
        points = self._points(thing)
        seen = (points - eye) @ axes  # x right, y up, z backward
        depth = -seen[:, 2]
        half = math.radians(float(self.model.cam_fovy[camera])) / 2.0
        width, height = self._record.arms[arm]["camera"]["resolution"]
        wide = math.atan(math.tan(half) * width / height)
        inside = (depth > 0.0) & (np.abs(seen[:, 0]) < depth * math.tan(wide))
        inside &= np.abs(seen[:, 1]) < depth * math.tan(half)
        away = float(np.linalg.norm(seen[0]))
        angle = math.degrees(math.acos(max(-1.0, min(1.0, float(depth[0]) / away))))
        if not inside.any():
            return Sight("outside", "", angle, math.degrees(half), away)
        blockers = [self._blocker(camera, eye, point, thing) for point in points[inside]]
        free = blockers.count("")
        if 3 * free > len(blockers):
            return Sight("seen", "", angle, math.degrees(half), away)
        hiding = [name for name in blockers if name]
        return Sight("hidden", max(hiding, key=hiding.count), angle, math.degrees(half), away)

    def _points(self, thing: str) -> Matrix:
        """The centre of an object and points on its outside, of shape (n, 3)."""
        body = self._body(thing)
        geom = int(self.model.body_geomadr[body])
        turned = self.data.geom_xmat[geom].reshape(3, 3)
        size = self.model.geom_aabb[geom][3:]
        corners = np.array([(0, 0, 0), *_CORNERS]) * 0.9 * size
        found: Matrix = self.data.geom_xpos[geom] + corners @ turned.T
        return found

    def _blocker(self, camera: int, eye: Vector, point: Vector, thing: str) -> str:
        """What a ray from the camera to a point of an object meets before it."""
        way = point - eye
        groups = np.array([group != PARTS_GROUP for group in range(6)], np.uint8)
        hit = np.full(1, -1, np.int32)
        own = int(self.model.cam_bodyid[camera])
        far = mujoco.mj_ray(self.model, self.data, eye, way, groups, 1, own, hit)
        if hit[0] < 0 or far > 1.0 + _MARGIN_M:
            return ""
        name = self._owner(int(hit[0]))
        return "" if name == thing else name

    def _body(self, name: str) -> int:
        return int(mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, name))

    def _name(self, body: int) -> str:
        return str(mujoco.mj_id2name(self.model, mujoco.mjtObj.mjOBJ_BODY, body) or "")

    def _owner(self, geom: int) -> str:
        """Body that a shape belongs to; of what is fixed to the world, the shape's own name."""
        body = int(self.model.geom_bodyid[geom])
        if body:
            return self._name(body)
        return str(mujoco.mj_id2name(self.model, mujoco.mjtObj.mjOBJ_GEOM, geom) or "the scene")


_CORNERS = tuple((x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1))
