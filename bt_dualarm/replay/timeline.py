"""A record over time: the status changes of its trees, and the world at any moment.

`Timeline` has the trees with the status changes of every node; `Scene` the world at one time:
poses, contacts, gripper states, images.
"""

from __future__ import annotations

import copy
import io
import math
import os
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias

import mujoco
import numpy as np
import PIL.Image

from bt_dualarm.core.later import Later
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.replay.record import Facts, GripperState, Record, ReplayError, check_picture
from bt_dualarm.robots.gripper import FINGERS
from bt_dualarm.robots.mjspec import CUP, PARTS_GROUP, TOOL_SITE, joint_motors
from bt_dualarm.runtime.history_file import Block, HistoryError, blocks_of
from bt_dualarm.runtime.observations import KnownFrame
from bt_dualarm.runtime.recorder import FRAMES
from bt_dualarm.sim.frame import Image, JsonList, Region, enter_blocks
from bt_dualarm.spec.problems import is_name, suggestion

if TYPE_CHECKING:
    import cv2
else:
    cv2 = Later("cv2")

GripperKind: TypeAlias = Literal["fingers", "suction"]


def joints_of(model: mujoco.MjModel, arm: str, dof: int) -> list[int]:
    """Ids of an arm's joints, base to tip, without the fingers of its gripper.

    Raises:
        ReplayError: Their number differs from that of the record.
    """
    joints: list[int] = model.actuator_trnid[joint_motors(model, arm), 0].tolist()
    if len(joints) != dof:
        raise ReplayError(
            f"the record has {dof} joints of {arm}, and {len(joints)} in its model: it is damaged"
        )
    return joints


def finger_joints(model: mujoco.MjModel, arm: str) -> list[int]:
    """Ids of the two joints of an arm's fingers; empty if it has none."""
    kind = mujoco.mjtObj.mjOBJ_JOINT
    found = [mujoco.mj_name2id(model, kind, f"{arm}/{finger}") for finger in FINGERS]
    return [joint for joint in found if joint >= 0]


def gripper_kind(model: mujoco.MjModel, arm: str) -> GripperKind | None:
    """Kind of an arm's gripper; None without one, or if the arm is not in the model."""
    if finger_joints(model, arm):
        return "fingers"
    cup = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, f"{arm}/{CUP}")
    return None if cup < 0 else "suction"


def held_over_time(record: Record, arm: str) -> list[tuple[float, tuple[str, ...]]]:
    """Objects that an arm was assumed to hold, by its gripper or a weld, at each change.

    Returns:
        Simulated time in s and names of the objects, in chronological order; empty if nothing was
        held, and in records of older versions.
    """
    return [
        (float(note["time_s"]), (*note["gripped"], *note["welded"]))
        for note in record.notes
        if note["kind"] == "holds" and note["arm"] == arm
    ]


def gripper_states(record: Record, arm: str) -> Iterator[tuple[int, GripperState, tuple[str, ...]]]:
    """Yields the states of an arm's gripper: number, state and command, objects assumed held."""
    changes = held_over_time(record, arm)
    held: tuple[str, ...] = ()
    for index, time in enumerate(record.times.tolist()):
        while changes and changes[0][0] <= time + 1e-9:
            held = changes.pop(0)[1]
        state = record.gripper(arm, index)
        if state is not None:
            yield index, state, held


def file_part(arm: str) -> str:
    """The name of an arm, safe for use in a file name.

    Raises:
        ReplayError: No tree file can have an arm of this name: the record was tampered with.
    """
    if not is_name(arm):
        raise ReplayError(f"the record names an arm {arm!r}, which no tree file can: not exported")
    return arm


@dataclass(frozen=True, eq=False)
class RecordedFrame:
    """A camera frame stored in a record, as it was exposed.

    Attributes:
        arm: Name of the camera's arm.
        time: Simulated time of the exposure in s.
        stamp: Time in s by the camera's clock.
        region: Exposed region of the image.
        stride: Edge in pixels of the blocks that share a sample.
        size: Width and height of the whole image in pixels.
        jpeg: The region, one pixel per block, as JPEG.
    """

    arm: str
    time: float
    stamp: float
    region: Region
    stride: int
    size: tuple[int, int]
    jpeg: bytes

    @property
    def image(self) -> Image:
        """RGB image, of shape (height, width, 3), black outside the region."""
        width, height = self.size
        image = np.zeros((height, width, 3), np.uint8)
        part = cv2.imdecode(np.frombuffer(self.jpeg, np.uint8), cv2.IMREAD_COLOR_RGB)
        if part is not None:
            enter_blocks(image, self.region, self.stride, np.asarray(part, np.uint8))
        return image

    @property
    def whole(self) -> bytes:
        """The whole image as JPEG."""
        if self.stride == 1 and self.region == (0, 0, *self.size):
            return self.jpeg
        bgr = np.ascontiguousarray(self.image[:, :, ::-1])
        return bytes(cv2.imencode(".jpg", bgr, (cv2.IMWRITE_JPEG_QUALITY, 92))[1].tobytes())


def recorded_frames(record: Record) -> Iterator[RecordedFrame]:
    """Yields the stored frames in order, up to the end of the complete part of the file.

    Raises:
        HistoryError: The file exists but is not a frame file, or a frame contradicts its facts.
    """
    path = record.folder / FRAMES
    if os.path.lexists(path):
        for number, block in enumerate(blocks_of(path)):
            if block.kind == "picture":
                try:
                    yield _frame_of(block, record)
                except ValueError as error:
                    raise HistoryError(f"{path}: picture {number}: {error}") from error


def _frame_of(block: Block, record: Record) -> RecordedFrame:
    """A frame; the size of its JPEG is checked before decoding, which could take any memory.

    Raises:
        ValueError: The size differs, or a fact is missing or of a wrong type.
    """
    facts: Any = block.data
    check_picture(facts)
    if facts["arm"] not in record.arms:
        raise ValueError(f"there is no arm {facts['arm']!r}")
    jpeg = block.arrays.get("jpeg")
    if jpeg is None or jpeg.dtype != np.uint8 or jpeg.ndim != 1:
        raise ValueError("expected an array of bytes `jpeg`")
    left, top, right, bottom = facts["region"]
    stride = facts["stride"]
    expected = -(-(right - left) // stride), -(-(bottom - top) // stride)
    try:
        with PIL.Image.open(io.BytesIO(jpeg.tobytes()), formats=("JPEG",)) as image:
            size = image.size
    except (OSError, SyntaxError, ValueError, PIL.Image.DecompressionBombError) as error:
        raise ValueError(f"its bytes are not a JPEG image: {error}") from error
    if size != expected:
        raise ValueError(f"is of {size[0]} by {size[1]} pixels; expected {expected}")
    width, height = facts["size"]
    return RecordedFrame(
        facts["arm"],
        float(facts["time_s"]),
        float(facts["stamp"]),
        (left, top, right, bottom),
        int(facts["stride"]),
        (width, height),
        jpeg.tobytes(),
    )


def known_frames(record: Record, until: float) -> dict[str, dict[float, KnownFrame]]:
    """Frames captured before a time in s with the findings in them, by arm and stamp.

    A resumed run need not render them. Frames of older records, without a stride, are skipped.
    """
    answers: dict[tuple[str, float], dict[str, JsonList]] = defaultdict(dict)
    for note in record.notes:
        if note["kind"] == "found":
            answers[note["arm"], note["stamp"]][note["asked"]] = note["answer"]
    found: dict[str, dict[float, KnownFrame]] = defaultdict(dict)
    for note in record.notes:
        if note["kind"] == "frame" and "stride" in note and note["time_s"] < until:
            left, top, right, bottom = note["region"]
            arm = note["arm"]
            stamp = note["stamp"]
            found[arm][stamp] = KnownFrame(
                (left, top, right, bottom), note["stride"], note["crc"], answers[arm, stamp]
            )
    return found


_MARGIN_M = 1e-3
"""Relative tolerance by which a ray must end before an object to be blocked by another one."""


@dataclass(frozen=True)
class ContactPoint:
    """Two bodies in contact.

    Attributes:
        own: Body of the arm, or the object that it holds.
        other: The other body.
        depth_m: Penetration depth in m.
    """

    own: str
    other: str
    depth_m: float


@dataclass(frozen=True)
class CameraSight:
    """Visibility of an object for a camera.

    Attributes:
        state: ``seen``, ``hidden`` or ``outside``.
        hidden_by: Body that hides the largest part of it, also if it is ``seen``; empty if none.
        off_axis_deg: Angle between the view axis and the object's center.
        half_view_deg: Angle between the view axis and the upper edge of the image.
        distance_m: Distance from the camera in m.
    """

    state: str
    hidden_by: str
    off_axis_deg: float
    half_view_deg: float
    distance_m: float


class Scene:
    """The world at one of the recorded times.

    It has the simulator's ground truth, for diagnosis after the run; arms never see it.

    Args:
        record: The record.
        time: Simulated time in s; the last state at or before it is used.
    """

    def __init__(self, record: Record, time: float) -> None:
        self._record = record
        moment = record.moment(record.index_at(min(max(time, 0.0), record.until)))
        self.time = moment.time
        self.model = record.model(moment.generation)
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = moment.qpos
        self.data.qvel[:] = moment.qvel
        self.data.time = moment.time
        mujoco.mj_fwdPosition(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def has(self, name: str) -> bool:
        """Whether an object is in the world."""
        return self._body(name) >= 0

    def position(self, name: str) -> Vector:
        """Position of an object's center, of shape (3,), m."""
        found: Vector = self.data.xpos[self._body(name)].copy()
        return found

    def tool(self, arm: str) -> Vector | None:
        """Position of an arm's tool, of shape (3,), m; None if it is not in the world."""
        site = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, f"{arm}/{TOOL_SITE}")
        if site < 0:
            return None
        found: Vector = self.data.site_xpos[site].copy()
        return found

    def pose_in(self, arm: str, name: str) -> Pose:
        """Pose of an object in the tool frame of an arm that is in the world."""
        data = self.data
        site = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, f"{arm}/{TOOL_SITE}")
        turn = np.empty(4)
        mujoco.mju_mat2Quat(turn, data.site_xmat[site])
        body = self._body(name)
        tool = Pose(data.site_xpos[site].copy(), turn)
        return tool.inverse @ Pose(data.xpos[body].copy(), data.xquat[body].copy())

    def ahead(self, seconds: float) -> Scene:
        """The world a moment later, if all velocities stayed as they are.

        It shows a contact that begins and ends between two recorded states.
        """
        later = copy.copy(self)
        later.time = self.time + seconds
        later.data = mujoco.MjData(self.model)
        later.data.qpos[:] = self.data.qpos
        later.data.eq_active[:] = self.data.eq_active
        mujoco.mj_integratePos(self.model, later.data.qpos, self.data.qvel, seconds)
        mujoco.mj_fwdPosition(self.model, later.data)
        return later

    def held(self, arm: str) -> list[str]:
        """Objects that an arm holds: those that are welded to it, and those assumed gripped."""
        changes = [held for time, held in held_over_time(self._record, arm) if time <= self.time]
        names = list(changes[-1]) if changes else []
        welds = self.model.eq_type == mujoco.mjtEq.mjEQ_WELD
        for weld in np.flatnonzero(welds & (self.data.eq_active != 0)):
            pair = {self._name(int(self.model.eq_obj1id[weld])): 0}
            pair[self._name(int(self.model.eq_obj2id[weld]))] = 1
            if any(name.startswith(f"{arm}/") for name in pair):
                names += [name for name in pair if "/" not in name and name not in names]
        return names

    def holders(self, name: str) -> list[str]:
        """Arms that hold an object, in the order of the file."""
        return [arm for arm in self._record.arms if name in self.held(arm)]

    def beside(self, name: str, within: float) -> list[tuple[str, float]]:
        """Other objects within a distance in m of one, with their distances in m, nearest first."""
        others = [other for other in self._record.start["objects"] if self.has(other)]
        own, *bodies = (self._solid_geoms(each) for each in (name, *others))
        gaps = (
            min(
                mujoco.mj_geomDistance(self.model, self.data, one, geom, 2.0 * within, None)
                for one in own
                for geom in geoms
            )
            for geoms in bodies
        )
        found = [
            (other, max(float(gap), 0.0))
            for other, gap in zip(others, gaps, strict=True)
            if other != name and gap <= within
        ]
        return sorted(found, key=lambda pair: pair[1])

    def touches(self, arm: str) -> list[ContactPoint]:
        """Contacts of the arm and of the objects that it holds."""
        own = {*self.held(arm)}
        found = []
        for contact in self.data.contact[: self.data.ncon]:
            names = [self._owner(int(geom)) for geom in contact.geom]
            mine = [name.startswith(f"{arm}/") or name in own for name in names]
            if mine[0] != mine[1] and contact.dist <= 0.0:
                first, second = names if mine[0] else reversed(names)
                found.append(ContactPoint(first, second, float(-contact.dist)))
        return found

    def near(self, point: Vector, within: float) -> list[str]:
        """Bodies whose bounding boxes are within a distance in m of a point, nearest first."""
        in_geom = np.einsum(
            "gji,gj->gi", self.data.geom_xmat.reshape(-1, 3, 3), point - self.data.geom_xpos
        )
        boxes = self.model.geom_aabb
        distance = np.linalg.norm(
            np.maximum(np.abs(in_geom - boxes[:, :3]) - boxes[:, 3:], 0.0), axis=1
        )
        order = np.argsort(distance)
        names = (self._owner(int(geom)) for geom in order if distance[geom] <= within)
        return list(dict.fromkeys(names))

    def sight(self, arm: str, name: str) -> CameraSight | None:
        """Visibility of an object for the camera of an arm; None if either is missing."""
        camera = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_CAMERA, f"{arm}/camera")
        if camera < 0 or not self.has(name):
            return None
        eye = self.data.cam_xpos[camera]
        axes = self.data.cam_xmat[camera].reshape(3, 3)
        points = self._points(name)
        seen = (points - eye) @ axes  # x right, y up, z backward
        depth = -seen[:, 2]
        half = math.radians(float(self.model.cam_fovy[camera])) / 2.0
        width, height = self._record.arms[arm]["camera"]["resolution"]
        wide = math.atan(math.tan(half) * width / height)
        inside = (depth > 0.0) & (np.abs(seen[:, 0]) < depth * math.tan(wide))
        inside &= np.abs(seen[:, 1]) < depth * math.tan(half)
        distance = float(np.linalg.norm(seen[0]))
        angle = math.degrees(math.acos(max(-1.0, min(1.0, float(depth[0]) / distance))))
        if not inside.any():
            return CameraSight("outside", "", angle, math.degrees(half), distance)
        blockers = [self._blocker(camera, eye, point, name) for point in points[inside]]
        hiding = [blocker for blocker in blockers if blocker]
        most = max(hiding, key=hiding.count, default="")
        state = "seen" if 3 * (len(blockers) - len(hiding)) > len(blockers) else "hidden"
        return CameraSight(state, most, angle, math.degrees(half), distance)

    def _points(self, name: str) -> Matrix:
        """The center of an object and points near its corners in the world, of shape (9, 3), m."""
        geoms = self._solid_geoms(name)
        rotation = self.data.geom_xmat[geoms[0]].reshape(3, 3)
        low = np.full(3, np.inf)
        high = np.full(3, -np.inf)
        for geom in geoms:  # bounding box in the axes of the first one
            turn = rotation.T @ self.data.geom_xmat[geom].reshape(3, 3)
            box = self.model.geom_aabb[geom]
            middle = self.data.geom_xpos[geom] @ rotation + turn @ box[:3]
            half = np.abs(turn) @ box[3:]
            low = np.minimum(low, middle - half)
            high = np.maximum(high, middle + half)
        corners = np.array([(0, 0, 0), *_CORNERS]) * 0.45 * (high - low) + 0.5 * (low + high)
        found: Matrix = corners @ rotation.T
        return found

    def _solid_geoms(self, name: str) -> list[int]:
        """Ids of the geoms of an object's parts; its first geom always is one."""
        body = self._body(name)
        first = int(self.model.body_geomadr[body])
        count = int(self.model.body_geomnum[body])
        solid = [geom for geom in range(first, first + count) if self.model.geom_contype[geom]]
        return solid or [first]

    def _blocker(self, camera: int, eye: Vector, point: Vector, name: str) -> str:
        """Body that a ray from the camera meets before a point of an object; empty if none."""
        ray = point - eye
        groups = np.array([group != PARTS_GROUP for group in range(6)], np.uint8)
        hit = np.full(1, -1, np.int32)
        own = int(self.model.cam_bodyid[camera])
        far = mujoco.mj_ray(self.model, self.data, eye, ray, groups, 1, own, hit)
        if hit[0] < 0 or far > 1.0 + _MARGIN_M:
            return ""
        owner = self._owner(int(hit[0]))
        return "" if owner == name else owner

    def _body(self, name: str) -> int:
        return int(mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, name))

    def _name(self, body: int) -> str:
        return str(mujoco.mj_id2name(self.model, mujoco.mjtObj.mjOBJ_BODY, body) or "")

    def _owner(self, geom: int) -> str:
        """Name of a geom's body, or of the geom itself if it is fixed to the world."""
        body = int(self.model.geom_bodyid[geom])
        if body:
            return self._name(body)
        return str(mujoco.mj_id2name(self.model, mujoco.mjtObj.mjOBJ_GEOM, geom) or "the scene")


_CORNERS = tuple((x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1))


@dataclass(frozen=True)
class Change:
    """A status change of a node.

    Attributes:
        index: Index of the change among all changes of the run.
        time: Simulated time in s.
        new: Status after the change.
        old: Status before the change.
        code: Code of a failure, ``HALTED``, or empty.
        reason: Sentence of a failure, or empty.
        metrics: Metrics of a leaf that has ended.
    """

    index: int
    time: float
    new: str
    old: str
    code: str
    reason: str
    metrics: Mapping[str, object]


_HALTED: Final = ("RUNNING", "INVALID")
"""Statuses before and after a halt."""


def _is_reset(change: Change, halt: Change) -> bool:
    """Whether a node that had ended was reset by a halt of its tree."""
    ended = change.old in ("SUCCESS", "FAILURE") and change.new == "INVALID"
    return ended and change.time == halt.time and change.index < halt.index


@dataclass(frozen=True, eq=False)
class TimelineNode:
    """A node of a tree with its status changes.

    Attributes:
        arm: Name of the arm whose tree it is.
        path: Names from the root down.
        kind: Node type: a control node, decorator or skill.
        ports: Ports given in the file.
        place: File and line.
        children: Nodes below it.
        changes: Its status changes, in order.
    """

    arm: str
    path: str
    kind: str
    ports: Mapping[str, object]
    place: str
    children: tuple[TimelineNode, ...]
    changes: list[Change] = field(default_factory=list)

    def walk(self) -> Iterator[TimelineNode]:
        """This node, then its descendants."""
        yield self
        for child in self.children:
            yield from child.walk()

    def standing_at(self, time: float) -> Mapping[str, Change]:
        """Last change of each node up to a time in s, by path, as in displays; for a root only.

        For a tree that was halted as a whole, changes of nodes that had already ended are skipped:
        the halt resets them too, but only running nodes count as halted.
        """
        last = self._last_until(time)
        halt = last if last is not None and (last.old, last.new) == _HALTED else None
        found: dict[str, Change] = {}
        for node in self.walk():
            changes = [change for change in node.changes if change.time <= time + 1e-9]
            if halt is not None and changes and _is_reset(changes[-1], halt):
                changes.pop()
            if changes:
                found[node.path] = changes[-1]
        return found

    def _last_until(self, time: float) -> Change | None:
        found = [change for change in self.changes if change.time <= time + 1e-9]
        return found[-1] if found else None

    def leaves_at(self, time: float, status: str) -> list[TimelineNode]:
        """Descendant leaves that had this status at a time in s."""
        leaves = (node for node in self.walk() if not node.children)
        return [leaf for leaf in leaves if leaf.status_at(time) == status]

    def at_work(self, time: float) -> list[TimelineNode]:
        """Descendants that ran at a time in s while none of their children did: leaves, waits."""
        return [
            node
            for node in self.walk()
            if node.status_at(time) == "RUNNING"
            and all(child.status_at(time) != "RUNNING" for child in node.children)
        ]

    def last(self, *statuses: str, before: int | None = None) -> Change | None:
        """Its last change to one of the statuses, before the change with index ``before``."""
        found = [
            change
            for change in self.changes
            if change.new in statuses and (before is None or change.index < before)
        ]
        return found[-1] if found else None

    def begun(self, end: Change) -> Change:
        """The change that started the run that ``end`` ended."""
        began = self.last("RUNNING", before=end.index) if end.old == "RUNNING" else None
        return began or end

    def status_at(self, time: float) -> str:
        """Status at a time in s."""
        until = [change for change in self.changes if change.time <= time + 1e-9]
        return until[-1].new if until else "INVALID"


class Timeline:
    """All trees of a record.

    Args:
        record: The record.
        time: Simulated time in s whose trees are used if the file was edited during the run; by
            default the end.

    Attributes:
        roots: Root of each arm's tree, by the arm's name.
        scenes: Cache of the world at some times, for the diagnosis.
    """

    def __init__(self, record: Record, time: float | None = None) -> None:
        trees = {name: arm["tree"] for name, arm in record.arms.items()}
        for note in record.notes:
            if note["kind"] == "edited" and (time is None or note["time_s"] <= time + 1e-9):
                trees[note["arm"]] = note["tree"]
        self.scenes: dict[float, Scene] = {}
        self.roots = {name: node_of(name, tree, tree["name"]) for name, tree in trees.items()}
        self._nodes = {
            (node.arm, node.path): node for root in self.roots.values() for node in root.walk()
        }
        for index, event in enumerate(record.events):
            node = self._nodes.get((event["arm"], event["path"]))
            if node is not None:
                node.changes.append(_change(index, event))

        self._removable = {
            name for name, arm in record.arms.items() if arm.get("removable") is True
        }

    def may_be_removed(self, arm: str) -> bool:
        """Whether the file allows the removal of this arm before its tree has ended."""
        return arm in self._removable

    def removal(self, name: str) -> tuple[TimelineNode, Change] | None:
        """The leaf that removed an arm or object last, and its change; None if it is present."""
        removals = self.ended("remove", name)
        spawns = self.ended("spawn", name)
        if not removals or (spawns and spawns[-1][1].index > removals[-1][1].index):
            return None
        return removals[-1]

    def ended(
        self, kind: str, name: str, arm: str | None = None
    ) -> list[tuple[TimelineNode, Change]]:
        """Leaves of a node type that succeeded with an object or arm, in the order of their ends.

        Args:
            kind: Node type of the leaves.
            name: Name of the object or arm, a value of one of their ports.
            arm: Arm of the leaves; None for all.
        """
        found = [
            (node, change)
            for node in self.leaves()
            if node.kind == kind and name in map(str, node.ports.values())
            if arm in (None, node.arm)
            for change in node.changes
            if change.new == "SUCCESS"
        ]
        return sorted(found, key=lambda pair: pair[1].index)

    def nodes(self) -> Iterator[TimelineNode]:
        """Every node, arm by arm."""
        return iter(self._nodes.values())

    def leaves(self) -> Iterator[TimelineNode]:
        """Every node without children."""
        return (node for node in self._nodes.values() if not node.children)

    def named(self, name: str) -> list[TimelineNode]:
        """Nodes whose path ends with a name, optionally preceded by the arm's name and a colon.

        Raises:
            ReplayError: There is none; the message suggests the nearest.
        """
        arm, _, rest = name.partition(":")
        wanted = rest if arm in self.roots and rest else name
        found = [
            node
            for node in self._nodes.values()
            if (node.path == wanted or node.path.endswith(f"/{wanted}") or node.kind == wanted)
            and (wanted == name or node.arm == arm)
        ]
        if not found:
            names = {node.path.rpartition("/")[2] for node in self._nodes.values()}
            raise ReplayError(f"no node is called {name!r}; {suggestion(name, names, 'node')}")
        return found


def _change(index: int, event: Facts) -> Change:
    return Change(
        index,
        float(event["time_s"]),
        str(event["new"]),
        str(event["old"]),
        str(event["code"]),
        str(event["reason"]),
        dict(event["metrics"]),
    )


def node_of(arm: str, facts: Facts, path: str) -> TimelineNode:
    """A node with its descendants; equal names of siblings are numbered as in the events.

    Args:
        arm: Name of the arm.
        facts: Facts of the node in the record.
        path: Path of the node.
    """
    seen: Counter[str] = Counter()
    children = []
    for child in facts["children"]:
        name = str(child["name"])
        seen[name] += 1
        shown = name if seen[name] == 1 else f"{name}#{seen[name]}"
        children.append(node_of(arm, child, f"{path}/{shown}"))
    return TimelineNode(arm, path, facts["kind"], facts["ports"], facts["place"], tuple(children))
