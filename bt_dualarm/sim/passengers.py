"""Objects that stand on or in an object that an arm carries, and ride along with it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.spec.document import ObjectSpec

_FALLS_M: Final = 0.03
"""Largest gap between an object that touches nothing and one that may be lifted, on which it is
about to fall, m: objects are often declared slightly above what they will stand on."""

_INSIDE_M: Final = 1e-4
"""Height above the bottom of an object from which the gap below it is measured, m: less than the
thinnest wall, and more than the rounding of poses."""

_DOWN: Final = np.array((0.0, 0.0, -1.0))

_BEARS: Final = 0.3
"""Vertical component of a contact's normal from which the lower body bears the upper one: about the
steepest slope on which things stay by friction."""


@dataclass(frozen=True, eq=False)
class Passenger:
    """Object that rides on or in a carried one.

    Attributes:
        object: Name of the object.
        relative: Its pose in the frame of the carried object when it was noticed.
        up: Unit vector, in the frame of the carried object, that was vertical then, of shape (3,).
    """

    object: str
    relative: Pose
    up: Vector


class Passengers:
    """The passengers of the objects that arms hold.

    As for obstacles, it is the simulator that tells which objects these are: those that touch the
    held object, or its other passengers, and rest on nothing else.

    Args:
        objects: Objects that are present, by name; the world adds and removes them.
    """

    def __init__(self, objects: Mapping[str, ObjectSpec]) -> None:
        self._objects = objects
        self._upon: dict[str, tuple[Passenger, ...]] = {}
        self._layout: _Layout | None = None

    def of(self, obj: str) -> tuple[Passenger, ...]:
        """Passengers of a held object that are present, as last looked for."""
        upon = self._upon.get(obj, ())
        return tuple(one for one in upon if one.object in self._objects)

    def carrier_of(self, obj: str) -> str:
        """Name of the held object on which an object rides, as last looked for; empty if none."""
        riding = (name for name in self._upon if obj in {one.object for one in self.of(name)})
        return next(riding, "")

    def look(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        held: Iterable[str],
        hands: Collection[int],
    ) -> bool:
        """Look for the passengers of held objects; returns whether anything has changed.

        What rode along and touches nothing now, such as a ball that bounces, still does.

        Args:
            model: Model of the world.
            data: Its state, with current contacts.
            held: Names of the held objects.
            hands: Geoms of the arms' tools: what touches them is not borne by them.
        """
        carried = tuple(name for name in dict.fromkeys(held) if self._objects[name].is_free)
        if not carried and not self._upon:
            return False
        layout = self._layout
        if layout is None or layout.model is not model or layout.held != carried:
            layout = self._layout = _Layout(model, self._objects, carried, hands)
        if not self._upon and not layout.may_ride(data):
            return False
        touching = _Touching(layout, data)
        found: dict[str, tuple[Passenger, ...]] = {}
        taken = set[str]()  # what lies across two held objects rides on the first
        for name in carried:
            before = {one.object: one for one in self.of(name)}
            names = [one for one in touching.upon(name, before) if one not in taken]
            taken.update(names)
            upon = tuple(before.get(one) or _passenger(model, data, name, one) for one in names)
            if upon:
                found[name] = upon
        names_now = {name: {one.object for one in upon} for name, upon in found.items()}
        names_before = {name: {one.object for one in upon} for name, upon in self._upon.items()}
        self._upon = found
        return names_now != names_before

    def would_ride(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        obj: str,
        held: Iterable[str],
        hands: Collection[int],
        known: Iterable[str] = (),
    ) -> tuple[Passenger, ...]:
        """Passengers of an object if it were lifted now.

        Args:
            model: Model of the world.
            data: Its state, with current contacts.
            obj: Name of the object.
            held: Names of the held objects.
            hands: Geoms of the arms' tools.
            known: Objects that rode on it, and do so still if they touch nothing now.
        """
        if not self._objects[obj].is_free:
            return ()
        layout = _Layout(model, self._objects, tuple({*held, obj}), hands)
        names = _Touching(layout, data).upon(obj, known, falling=True)
        return tuple(_passenger(model, data, obj, name) for name in names)


def _passenger(model: mujoco.MjModel, data: mujoco.MjData, obj: str, name: str) -> Passenger:
    carrier, rider = (
        Pose(data.xpos[body].copy(), data.xquat[body].copy())
        for body in (model.body(one).id for one in (obj, name))
    )
    return Passenger(name, carrier.inverse @ rider, carrier.inverse.turn(np.array((0.0, 0.0, 1.0))))


class _Layout:
    """Which bodies of a model are free objects, held ones, and hands; the same for many looks.

    Args:
        model: Model of the world.
        objects: Objects that are present.
        held: Names of the held ones, which ride on nothing.
        hands: Geoms that bear nothing.

    Attributes:
        bodies: Bodies of the free objects, by name.
        names: Names of those that are not held, by body.
        trees: Root body of each geom, of shape (ngeom,): what moves on the joints of a free object
            belongs to its tree.
        is_hand: Whether a geom is one of a hand, of shape (ngeom,).
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        objects: Mapping[str, ObjectSpec],
        held: tuple[str, ...],
        hands: Collection[int],
    ) -> None:
        self.model = model
        self.objects = objects
        self.held = held
        self.bodies = {
            name: int(model.body(name).id) for name, obj in objects.items() if obj.is_free
        }
        self.names = {body: name for name, body in self.bodies.items() if name not in held}
        self.trees: npt.NDArray[np.int32] = model.body_rootid[model.geom_bodyid]
        self.is_hand = np.zeros(model.ngeom, dtype=bool)
        self.is_hand[list(hands)] = True
        # 1 for held objects, 2 for other free ones: two that touch and have both may be a rider.
        self._kinds = np.zeros(model.ngeom, dtype=np.uint8)
        for name, body in self.bodies.items():
            self._kinds[self.trees == body] = 1 if name in held else 2

    def may_ride(self, data: mujoco.MjData) -> bool:
        """Whether anything touches a held object; otherwise nothing begins to ride on one."""
        if not self.names:
            return False
        kinds = self._kinds[data.contact.geom]
        return bool(((kinds[:, 0] | kinds[:, 1]) == 3).any())


class _Touching:
    """Which objects touch and bear which, by the current contacts.

    Args:
        layout: Bodies of the model.
        data: State of the world.
    """

    def __init__(self, layout: _Layout, data: mujoco.MjData) -> None:
        self._model = layout.model
        self._data = data
        self._objects = layout.objects
        self._bodies = layout.bodies
        self._names = layout.names
        contact = data.contact
        touch = contact.dist <= 0.0
        geoms = contact.geom[touch]
        trees = layout.trees[geoms]
        self._touched: set[int] = {int(one) for one in trees.flat}
        apart = (trees[:, 0] != trees[:, 1]) & ~layout.is_hand[geoms].any(axis=1)
        self._pairs: npt.NDArray[np.int32] = trees[apart]
        # The normal points from the first geom to the second.
        self._upward: Vector = contact.frame[touch][apart][:, 2]

    def upon(self, obj: str, known: Iterable[str], *, falling: bool = False) -> list[str]:
        """Names of the objects that rest on a free one, or on each other, and on nothing else.

        Args:
            obj: Name of the object.
            known: Objects that rode on it so far: they still do if they touch nothing and are near.
            falling: Whether others that touch nothing, and are about to fall onto it, count.
        """
        base = self._bodies[obj]
        afloat = {body for body in self._names if body not in self._touched and body != base}
        rode = {self._bodies[name] for name in known if name in self._bodies}
        riders = {body for body in rode & afloat if self._is_near(body, base)}
        reached = self._with_touching({base, *riders})
        while falling:  # onto what has been reached, the lowest one first
            onto = {body for body in afloat - reached if self._below(self._names[body]) in reached}
            falling = bool(onto)
            reached |= onto
        return self._without_borne(reached, base)

    def _is_near(self, one: int, other: int) -> bool:
        """Whether the bounding spheres of two free objects meet."""
        reach = [
            float(np.linalg.norm(body_of(self._objects[name]).corners, axis=1).max())
            for name, body in self._bodies.items()
            if body in (one, other)
        ]
        return float(np.linalg.norm(self._data.xpos[one] - self._data.xpos[other])) <= sum(reach)

    def _below(self, name: str) -> int:
        """Root of the body onto which an object that touches nothing falls; -1 if it is far."""
        model = self._model
        body = model.body(name).id
        pose = Pose(self._data.xpos[body].copy(), self._data.xquat[body].copy())
        shape = body_of(self._objects[name])
        down = pose.inverse.turn(_DOWN)
        height = shape.solid.reach(down) - float(down @ shape.center)
        geom = np.full(1, -1, dtype=np.int32)
        # From its bottom, as a container does not fall onto what is in it.
        start = pose.apply(shape.center) + (height - _INSIDE_M) * _DOWN
        gap = mujoco.mj_ray(model, self._data, start, _DOWN, None, 1, body, geom) - _INSIDE_M
        below = int(geom[0])
        if below < 0 or gap > _FALLS_M:
            return -1
        # What is hit upward, too, goes through it, such as the peg in a ring.
        mujoco.mj_ray(model, self._data, start, -_DOWN, None, 1, body, geom)
        return -1 if int(geom[0]) == below else int(model.body_rootid[model.geom_bodyid[below]])

    def _with_touching(self, seeds: set[int]) -> set[int]:
        """Bodies with all that touch them, directly or through each other."""
        pairs = self._pairs.tolist()
        reached = set(seeds)
        grown = True
        while grown:
            grown = False
            for first, second in pairs:
                for one, other in ((first, second), (second, first)):
                    if one in reached and other not in reached and other in self._names:
                        reached.add(other)
                        grown = True
        return reached

    def _without_borne(self, reached: set[int], base: int) -> list[str]:
        """Names of reached bodies, the base aside, that nothing but reached ones bear."""
        pairs = self._pairs.tolist()
        reached = set(reached)
        shrunk = True
        while shrunk:  # what rests on something that does not ride along does not, either
            shrunk = False
            for (first, second), upward in zip(pairs, self._upward.tolist(), strict=True):
                lower, upper = (first, second) if upward > 0.0 else (second, first)
                borne = abs(upward) > _BEARS and upper in reached and lower not in reached
                if borne and upper != base:
                    reached.discard(upper)
                    shrunk = True
        return sorted(self._names[body] for body in reached - {base})
