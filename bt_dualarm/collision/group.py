"""Collision checks of several arms that carry one object."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from bt_dualarm.collision.checker import STANDING, TOUCH, Contact, Marks, ScratchModel, carried_on
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.robots.gripper import FINGERS
from bt_dualarm.sim.composition import name_of_geom
from bt_dualarm.sim.world import World

APART_M = 0.02
"""Distance that the links of the carrying arms keep from each other, m: none of them reacts to the
others during the motion."""


class GroupChecker:
    """Checks configurations of several arms that hold one object, against the world at creation.

    The object moves with the first arm's tool. Hands may touch the object; its contacts with what
    it rests on at creation may continue at their depth. Arms that are not of the group stay where
    they are, and what they hold with them.

    Args:
        world: World to check against; never changed.
        parts: Columns of each arm's joints in a configuration of all, by arm; the first one leads.
        obj: Name of the object.
        grasps: Poses of the tools in the object's frame, by arm.
        margin: Distance to keep from arms that are not of the group, m.
        widths: Openings of the grippers around the object, by arm, m.
    """

    def __init__(
        self,
        world: World,
        parts: Mapping[str, slice],
        obj: str,
        grasps: Mapping[str, Pose],
        margin: float,
        widths: Mapping[str, float],
    ) -> None:
        leader = next(iter(parts))
        body = world.arms[leader]
        # In the link that carries the tool, in which attachments are given as well.
        relative = world.robots[leader].tool @ grasps[leader].inverse
        carried = list(carried_on(world, obj, body.tool_body, relative))
        self._scratch = scratch = ScratchModel(world, list(parts), carried)
        self._columns = [(world.arms[arm].qpos_ids, part) for arm, part in parts.items()]
        geoms = world.payload_geoms(obj)
        own = {arm: scratch.marks(world.arms[arm].geom_ids) for arm in parts}
        payload = scratch.marks(geoms)
        self._payload = payload
        self.moving = np.logical_or.reduce([*own.values(), payload])
        solid = scratch.solid
        scratch.compare(solid & self.moving, solid)
        least = np.zeros((scratch.model.ngeom, scratch.model.ngeom))
        least[payload[:, None] | payload] = -TOUCH
        least[payload[:, None] & payload] = -np.inf  # the object and what rides on it
        self._keep(world, parts, least, own, margin)
        tools = scratch.marks({g for arm in parts for g in world.arms[arm].tool_geom_ids})
        least[(payload[:, None] & tools) | (tools[:, None] & payload)] = -np.inf
        for arm in parts:
            hand = scratch.marks(world.arms[arm].tool_geom_ids)
            least[hand[:, None] & hand] = -np.inf
        self._least = least
        self._boxes = scratch.box_pairs(least, self.moving)
        self._open(world, parts, widths)
        scratch.settle(carrying=False)
        self._let_stand()

    def let_stand(self, q: Vector) -> None:
        """Allow the contacts of the object at ``q`` to continue at their depth.

        The hands may be where they have pressed the object, or have set it down, lower than it is.

        Args:
            q: Joint positions of all arms, side by side, rad: where they are commanded to be.
        """
        self._place(q)
        self._let_stand()

    def contact(self, q: Vector) -> Contact | None:
        """Deepest contact at joint positions of all arms, side by side, rad; None if free."""
        self._place(q)
        worst = self._scratch.worst_violation(self._least, self._boxes)
        if worst is None:
            return None
        pair = sorted(worst.geoms, key=lambda one: not self.moving[one])
        names = [name_of_geom(self._scratch.model, one) for one in pair]
        if self.moving[pair[1]] and "/" not in names[1]:  # name the held object first
            names.reverse()
        return Contact(names[0], names[1], -worst.distance)

    def first_contact(self, rows: Matrix) -> tuple[int, Contact] | None:
        """Index and contact of the first configuration in contact, of rows (n, dof), rad."""
        for i, q in enumerate(rows):
            contact = self.contact(q)
            if contact is not None:
                return i, contact
        return None

    def _keep(
        self,
        world: World,
        parts: Collection[str],
        least: Matrix,
        own: Mapping[str, Marks],
        margin: float,
    ) -> None:
        """Set the distances between arms."""
        scratch = self._scratch
        for name, other in world.arms.items():
            marks = scratch.marks(other.geom_ids)
            if name not in parts:
                scratch.report_gaps(marks, margin)
                least[marks[:, None] | marks] = margin
                continue
            hand = scratch.marks(other.tool_geom_ids)
            scratch.report_gaps(marks, APART_M)
            for partner in own:
                if partner == name:
                    continue
                pairs = (marks[:, None] & own[partner]) | (own[partner][:, None] & marks)
                least[pairs] = APART_M
                hands = scratch.marks(world.arms[partner].tool_geom_ids)
                close = (hand[:, None] & hands) | (hands[:, None] & hand)
                least[close] = 0.25 * APART_M

    def _open(
        self, world: World, parts: Sequence[str] | Mapping[str, slice], widths: Mapping[str, float]
    ) -> None:
        """Set the openings of the grippers in the scratch model."""
        data = self._scratch.data
        for arm in parts:
            gripper = world.grippers.get(arm)
            if gripper is None or not gripper.gripper.fingers:
                continue
            for finger in FINGERS:
                address = int(world.model.joint(f"{arm}/{finger}").qposadr[0])
                data.qpos[address] = 0.5 * widths.get(arm, gripper.width)

    def _place(self, q: Vector) -> None:
        for addresses, part in self._columns:
            self._scratch.data.qpos[addresses] = q[part]
        self._scratch.settle()

    def _let_stand(self) -> None:
        """Let the object stay in contact with what it touches in the current state."""
        found = self._scratch.data.contact
        for (first, second), distance in zip(found.geom.tolist(), found.dist, strict=True):
            touches = self._payload[first] or self._payload[second]
            if touches and -STANDING < distance <= 0.0:
                depth = min(self._least[first, second], float(distance) - TOUCH)
                self._least[first, second] = self._least[second, first] = depth
