"""Grasps of an arm on an object at its pose: which one is wanted, and which are possible."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.payload import UNKNOWN_KG, cup_measures, jaw_measures
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.grasping.candidates import (
    CLEAR,
    TOUCHING,
    Obstacle,
    RankedGrasp,
    clearances,
    cup_grasps,
    jaw_grasps,
    least_width,
    ranked,
)
from bt_dualarm.grasping.grasp import (
    Box,
    Capsule,
    CupMeasures,
    Cylinder,
    Grasp,
    JawMeasures,
    Load,
    MeshSolid,
    Solid,
)
from bt_dualarm.sim.composition import name_of_geom
from bt_dualarm.sim.object_body import body_of, unit_ball
from bt_dualarm.sim.world import World
from bt_dualarm.skill.articulated import JointPath
from bt_dualarm.skill.placing import LEAST_ROOM_M
from bt_dualarm.skill.skill import unit_vector
from bt_dualarm.skill.symmetry import goals_alike
from bt_dualarm.spec.node_types import PortModel, port
from bt_dualarm.spec.values import Direction, PartName, Speed


class TakingPorts(PortModel):
    """Ports of skills that pick: approach, forces, and the load for which the grip is designed."""

    approach: Direction | None = port(
        None, "direction of the straight approach, world axes, within 30°; by default the best one"
    )
    part: PartName | None = port(
        None, "part of a compound object at which it is picked; by default any"
    )
    standoff: float = port(0.08, "length of the straight approach", unit="m", ge=0.01, le=0.3)
    lift: float = port(0.04, "height of the lift that tests the grip", unit="m", ge=0, le=0.5)
    force: float | None = port(
        None,
        "force of each pad, or of a cup; by default what the load needs",
        unit="N",
        gt=0,
        le=5000,
    )
    most_force: float | None = port(
        None,
        "largest force of each pad, or of a cup, that the object withstands",
        unit="N",
        gt=0,
        le=5000,
    )
    mass: float | None = port(
        None, "assumed mass; by default the one that the arm knows", unit="kg", gt=0, le=100
    )
    shake: float = port(
        8.0, "acceleration of the tool that the grip must withstand", unit="m/s²", ge=0, le=50
    )
    margin: float = port(1.5, "safety factor of the grip", unit="times the load", ge=1, le=10)
    touch: float = port(40.0, "contact force at which the approach stops", unit="N", ge=1, le=200)
    speed: Speed = port(0.5, "fraction of the arm's limits up to the standoff")
    approach_speed: Speed = port(
        0.15, "fraction of the arm's limits where the gripper may touch something"
    )

    @property
    def along(self) -> Vector | None:
        """Unit vector of the approach in the world, of shape (3,), if one is given.

        Raises:
            Failure: ``INVALID_TARGET``: it has no length.
        """
        return None if self.approach is None else unit_vector(self.approach)

    def mass_of(self, known: float | None) -> float:
        """Assumed mass, kg.

        Args:
            known: Mass that the arm knows, kg; None if it knows none.
        """
        return self.mass or known or UNKNOWN_KG


_PULLED_KG = 1.0
"""Mass, kg, that stands for the pull at something that moves on a joint, whose weight the joint
supports. `operate` closes firmer, by its port ``force``."""

GRAVITY = 9.81
"""Acceleration of gravity in m/s²."""

LIGHT_KG = 1e-6
"""Mass that any grasp bears, kg."""

_WIDE = 50.0  # m: half the edge of the box that stands for a plane
_ALONG = 0.99  # cosine above which fingers close along the given width
_AS_ASKED = math.cos(math.radians(30.0))  # largest angle to the given approach
_OTHER = math.radians(45.0)  # rotation of a grasp that counts as another one
_HALF_TURN = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, math.pi))
_OFF_POINT_M = 0.02  # largest distance of a grasp from the requested point
_SAME_POINT_M = 0.005  # difference of these distances that does not count
_NEAR = 0.5  # m; objects farther away than this do not obstruct the fingers


@dataclass(frozen=True, eq=False)
class WantedGrasp:
    """Specification of a grasp: the object, and the load for which the grip is designed.

    Attributes:
        name: Name of the declared object; with ``edges`` that of the object assumed at the pose,
            or None.
        object_pose: Estimated pose of the object in the world.
        mass: Assumed mass, kg.
        shake: Largest acceleration of the tool, m/s².
        margin: Safety factor of the grip.
        most_force: Force of each pad, or of a cup, that the object withstands, N.
        edges: Edges, m, of the box that stands for an undeclared object, of which fingers close
            along the second; None for a declared one.
        undeclared_friction: Coefficient of friction of an undeclared object.
        along: Direction of the straight approach in the world, of unit length, of shape (3,), kept
            within 30°; None for any.
        unlike: Pose of the tool in the object's frame from which the grasp has to differ by at
            least 45°, also after half a turn about the tool axis; None for any.
        section: Piece of the object at which it is grasped, whose pose is ``object_pose``; None for
            all.
        part: Name of the declared part at which it is grasped; None for any.
        point: Point in the object's frame at which it is grasped, of shape (3,), m; None for any.
        opening: Opening of the fingers during the approach, m; None for the widest.
        onward: Path along which the arm has to be able to move the object once it holds it; None
            for any.
        goal: Pose in the world at which the arm has to be able to set the object down; None for
            any.
        mass_is_assumed: Whether the mass is neither declared nor a port.
        between: Whether fingers approach in the directions halfway between the usual ones.
    """

    name: str | None
    object_pose: Pose
    mass: float
    shake: float
    margin: float
    most_force: float = math.inf
    edges: tuple[float, float, float] | None = None
    undeclared_friction: float = 0.0
    along: Vector | None = None
    unlike: Pose | None = None
    section: Solid | None = None
    part: str | None = None
    point: Vector | None = None
    opening: float | None = None
    onward: JointPath | None = None
    goal: Pose | None = None
    mass_is_assumed: bool = False
    between: bool = False

    def off_point(self, grasp: Grasp) -> float:
        """Distance of the point from the line along which a grasp closes or pulls, m.

        Args:
            grasp: Grasp in the object's frame.
        """
        if self.point is None:
            return 0.0
        # Fingers close along the tool's y axis, and a cup pulls along its z axis.
        axis = grasp.tool.rotation_matrix[:, 1 if grasp.width > 0.0 else 2]
        offset = self.point - grasp.tool.position
        return float(np.linalg.norm(offset - (offset @ axis) * axis))

    @classmethod
    def named(
        cls,
        arm: Arm,
        name: str,
        ports: TakingPorts,
        object_pose: Pose | None,
        unlike: Pose | None = None,
    ) -> WantedGrasp:
        """Specification for a declared object.

        Args:
            arm: Arm that picks it.
            name: Name of the object.
            ports: Approach and load.
            object_pose: Estimated pose in the world; by default the true one.
            unlike: As the attribute.

        Raises:
            Failure: ``NOT_THERE``, or ``INVALID_TARGET`` if it is fixed or has no such part.
        """
        world = arm.world
        world.objects.require(name)
        name = world.part_owner(name, ports.part)
        if world.objects[name].fixed:
            raise Failure("INVALID_TARGET", world.fixed_reason(name))
        if ports.part is not None and body_of(world.objects[name]).part(ports.part) is None:
            raise Failure("INVALID_TARGET", f"object {name!r} has no part {ports.part!r}")
        hung = world.objects[name].joint
        known = arm.known.mass(name)
        if hung is not None:  # its joint supports the weight: the grip must pull it
            known = _PULLED_KG
        return cls(
            name,
            object_pose or (world.object_pose(name) if hung is None else arm.known.pose(name).pose),
            ports.mass_of(known),
            ports.shake,
            ports.margin,
            ports.most_force or math.inf,
            along=ports.along,
            unlike=unlike,
            part=ports.part,
            mass_is_assumed=ports.mass is None and known is None,
        )

    @property
    def weight(self) -> str:
        """The mass in messages."""
        assumed = " (assumed, as `mass` is not given)" if self.mass_is_assumed else ""
        return f"{self.mass:.3g} kg{assumed}"

    @property
    def evidence(self) -> dict[str, float]:
        """The mass in the numbers of failures, kg: as ``assumed_kg``, too, if nothing states it."""
        return {"mass_kg": self.mass} | ({"assumed_kg": self.mass} if self.mass_is_assumed else {})

    @property
    def label(self) -> str:
        """The object in messages."""
        if self.edges is not None:
            return "the object at this pose"
        return repr(self.name) if self.part is None else f"{self.part!r} of {self.name!r}"

    def solid(self, world: World) -> Solid:
        """Shape of the object, or of the part at which it is grasped.

        Raises:
            Failure: ``NOT_THERE`` if the object has been removed meanwhile.
        """
        if self.section is not None:
            return self.section
        if self.name is None or self.edges is not None:
            return Box(0.5 * np.array(self.edges))
        piece = None if self.part is None else body_of(world.objects[self.name]).part(self.part)
        return world.object_solid(self.name) if piece is None else piece

    def center(self, world: World) -> Vector:
        """Center of mass in the frame of its shape, of shape (3,), m."""
        if self.section is not None or self.name is None or self.edges is not None:
            return np.zeros(3)
        if world.objects[self.name].joint is not None:
            return self._pulled_at(world)
        return world.loaded_center(self.name)

    def _pulled_at(self, world: World) -> Vector:
        """Point at which something on a joint is pulled, of shape (3,), m.

        That is where it is to be grasped, by default the center of the part: the joint bears what
        a weight beside the hand would turn.
        """
        if self.point is not None:
            return self.point
        body = body_of(world.objects[self.name or ""])
        its = [one for one in body.parts if self.part in (None, one.name)]
        weights = np.array([one.weight for one in its])
        centers = np.array([one.pose.position for one in its])
        center: Vector = weights @ centers / weights.sum()
        return center

    def friction(self, world: World) -> float:
        """Coefficient of friction of the object, as declared or as given by the tree."""
        given = self.undeclared_friction if self.name is None or self.edges else None
        return world.objects[self.name or ""].friction if given is None else given

    @property
    def request(self) -> str:
        """What `allows` asks of a grasp, in messages."""
        asked = []
        if self.along is not None:
            asked.append(f"within {math.degrees(math.acos(_AS_ASKED)):.0f}° of `approach`")
        if self.edges is not None:
            asked.append("across its `width`")
        if self.unlike is not None:
            asked.append(f"{math.degrees(_OTHER):.0f}° or more from the present one")
        return " and ".join(asked) or "of the requested kind"

    def allows(self, grasp: Grasp) -> bool:
        """Whether a grasp agrees with ``edges``, ``along`` and ``unlike``."""
        if self.edges is None and self.along is None and self.unlike is None:
            return True
        axes = grasp.tool.rotation_matrix
        if self.edges is not None and grasp.width > 0.0 and abs(float(axes[1, 1])) <= _ALONG:
            return False
        if self.along is not None and self.object_pose.turn(axes[:, 2]) @ self.along < _AS_ASKED:
            return False
        if self.unlike is None:
            return True
        # Half a turn about the tool axis exchanges the fingers: that is the same grasp.
        angle = self.unlike.angle(grasp.tool)
        other_angle = (self.unlike @ _HALF_TURN).angle(grasp.tool)
        return min(angle, other_angle) >= _OTHER


def grasps_on(arm: Arm, wanted: WantedGrasp) -> tuple[RankedGrasp, ...]:
    """Grasps of an arm's gripper on an object, the best first.

    Fingers close on the edges of a mesh only where they cannot close on its faces. If there is a
    goal, grasps with which the hand has no room there come last.

    Raises:
        Failure: ``TOO_WIDE``, ``TOO_HEAVY``, ``NO_FACE``, or ``OUT_OF_REACH`` if all of them are
            obstructed; each with its numbers.
    """
    found = _grasps_here(arm, wanted)
    if wanted.goal is None or wanted.name is None:
        return found
    goals = goals_with_room(arm, wanted.name, wanted.goal, [one.grasp for one in found])
    # A stable sort: the order remains within each of both.
    order = sorted(range(len(found)), key=lambda index: not goals[index])
    return tuple(found[index] for index in order)


def goals_with_room(
    arm: Arm, name: str, goal: Pose, grasps: Sequence[Grasp]
) -> list[tuple[Pose, ...]]:
    """For each grasp the poses at which the hand has room around an object that is set down.

    The hand counts as its enclosing shapes, as where it picks: it may fit in less room.

    Args:
        arm: Arm with the gripper.
        name: Name of the object.
        goal: Pose at which it is to be set down.
        grasps: Grasps on it.

    Returns:
        For each grasp those poses of the object in the world that look like the goal.
    """
    description = arm.gripper.description
    spec = arm.world.declared_objects[name]
    alike = [pose for _, pose in goals_alike(arm.world, name, goal)]
    obstacles = obstacles_around(arm, name, goal.apply(body_of(spec).middle))
    hand: JawMeasures | CupMeasures
    if description.fingers:
        widest = max((grasp.width for grasp in grasps), default=0.0) + 2.0 * LEAST_ROOM_M
        hand = jaw_measures(description, spec.friction)
        hand = replace(hand, widest_opening=min(widest, hand.widest_opening))
    else:
        hand = cup_measures(description, spec.friction)
    rooms = clearances(grasps, alike, hand, obstacles)
    return [
        tuple(pose for pose, room in zip(alike, column, strict=True) if room >= -TOUCHING)
        for column in rooms.T.tolist()
    ]


def _grasps_here(arm: Arm, wanted: WantedGrasp) -> tuple[RankedGrasp, ...]:
    """Grasps as `grasps_on`, whether they suit the goal or not."""
    center = wanted.object_pose.apply(wanted.center(arm.world))
    obstacles = obstacles_around(arm, wanted.name, center)
    try:
        return _grasps_on(arm, wanted, obstacles, on_edges=False)
    except Failure as failure:
        if arm.gripper.description.fingers and wanted.point is None:
            with suppress(Failure):
                return _grasps_on(arm, wanted, obstacles, on_edges=True)
        raise failure.with_traceback(None) from None


_BESIDE_M = 0.006  # clearance on each side of an object that half-open fingers approach


def half_open(arm: Arm, wanted: WantedGrasp) -> WantedGrasp | None:
    """The same specification with fingers that open little wider than the object's narrowest side.

    Fully open fingers tolerate errors of the object's pose, but collide with obstacles beside it.

    Args:
        arm: Arm with the gripper.
        wanted: Specification of a grasp.

    Returns:
        The specification; None if its opening is given, or the fingers would open as wide.
    """
    description = arm.gripper.description
    if not description.fingers or wanted.opening is not None:
        return None
    try:
        widths = [one.grasp.width for one in _grasps_on(arm, wanted, (), on_edges=False)]
    except Failure:
        return None
    opening = min(widths) + 2.0 * _BESIDE_M
    return replace(wanted, opening=opening) if opening < description.stroke else None


def _grasps_on(
    arm: Arm, wanted: WantedGrasp, obstacles: Sequence[Obstacle], *, on_edges: bool
) -> tuple[RankedGrasp, ...]:
    """Grasps as `grasps_on`, beside obstacles, of faces or of edges."""
    description = arm.gripper.description
    solid = wanted.solid(arm.world)
    friction = wanted.friction(arm.world)
    # Rotations of a round object about its axis are equivalent: grasps are generated relative to
    # the arm's base, so that they do not depend on the declared rotation.
    symmetry = _turned_to(arm.kinematics.base.position, wanted.object_pose, solid)
    object_pose = wanted.object_pose @ symmetry
    gravity = object_pose.rotation_matrix.T @ np.array([0.0, 0.0, -GRAVITY])
    load = Load(wanted.margin * wanted.mass, gravity, wanted.shake, wanted.center(arm.world))
    _refuse_weight(arm, wanted)
    point = None if wanted.point is None else symmetry.inverse.apply(wanted.point)
    jaw: JawMeasures | None = None
    cup: CupMeasures | None = None
    if description.fingers:
        jaw = jaw_measures(description, friction)
        jaw = replace(jaw, most_force=min(jaw.most_force, wanted.most_force))
        if wanted.opening is not None:
            jaw = replace(jaw, widest_opening=min(jaw.widest_opening, wanted.opening))
        _refuse_width(solid, jaw, wanted)
    else:
        cup = cup_measures(description, friction)
        cup = replace(cup, most_force=min(cup.most_force, wanted.most_force))

    def bearing(load: Load, asked: WantedGrasp = wanted) -> tuple[tuple[Grasp, ...], int]:
        """Grasps that bear a load, as requested, and how many there are of any kind."""
        found: tuple[Grasp, ...] = ()
        if jaw is not None:
            found = jaw_grasps(
                solid, jaw, load, jaw.friction,
                point=point, on_edges=on_edges, between=wanted.between,
            )  # fmt: skip
        elif cup is not None:
            found = cup_grasps(solid, cup, load, point=point)
        if not found:
            raise _no_grasp(solid, jaw, arm, wanted, point)
        found = tuple(replace(one, tool=symmetry @ one.tool) for one in found)
        count = len(found)
        found = tuple(one for one in found if asked.allows(one))
        return (found if asked.point is None else _at_point(found, asked)), count

    here = arm.tool_pose

    def free(found: Sequence[Grasp], of: Sequence[Obstacle]) -> tuple[RankedGrasp, ...]:
        return ranked(
            found, wanted.object_pose, jaw or cup, of, lambda tool: _rotation_cost(tool, here)
        )

    found, of_any_kind = bearing(load)
    if not found:
        lighter = bool(bearing(replace(load, mass=LIGHT_KG))[0])
        bears = f"bears {wanted.weight}" if lighter else "is possible"
        do = "do" if lighter else "are"
        raise Failure(
            "TOO_HEAVY" if lighter else "OUT_OF_REACH",
            f"no grasp of {wanted.label} {wanted.request} {bears}; {of_any_kind} others {do}",
            **wanted.evidence,
            grasps=0,
            other_grasps=of_any_kind,
        )
    order = free(found, obstacles)
    if not order:
        reason = f"the gripper has no room around {wanted.label}"
        if obstacles:
            names = dict.fromkeys(obstacle.name for obstacle in obstacles)
            left = {
                name: len(free(found, [o for o in obstacles if o.name == name])) for name in names
            }
            worst = sorted(left, key=lambda name: left[name])
            # What leaves no grasp by itself is the reason, else the two that leave fewest.
            worst = worst[: 1 if left[worst[0]] == 0 else 2]
            if free(bearing(replace(load, mass=LIGHT_KG))[0], obstacles):
                raise Failure(
                    "TOO_HEAVY",
                    f"the grasps with which {description.name} bears {wanted.weight} of "
                    f"{wanted.label} have no room beside {' and '.join(worst)}",
                    **wanted.evidence,
                    grasps=len(found),
                )
            near = f"{' and '.join(worst)} {'is' if len(worst) == 1 else 'are'} too near"
            elsewhere = free(bearing(load, replace(wanted, along=None))[0], obstacles)
            if elsewhere:
                raise Failure(
                    "OUT_OF_REACH",
                    f"no grasp of {wanted.label} {wanted.request} has room: {near}; "
                    f"{len(elsewhere)} others have",
                    grasps=len(found),
                    other_grasps=len(elsewhere),
                )
            reason = f"the gripper has no room around {wanted.label}: {near}"
        raise Failure("OUT_OF_REACH", reason, grasps=len(found))
    return order


def _at_point(found: tuple[Grasp, ...], wanted: WantedGrasp) -> tuple[Grasp, ...]:
    """Grasps nearest to the requested point of the object.

    Raises:
        Failure: ``NO_FACE`` if none is near it.
    """
    off = [wanted.off_point(one) for one in found]
    nearest = min(off, default=math.inf)
    if nearest > _OFF_POINT_M:
        raise Failure(
            "NO_FACE",
            f"no grasp of {wanted.label} is within {1e3 * _OFF_POINT_M:.0f} mm of `point`"
            + (f"; the nearest is {1e3 * nearest:.0f} mm from it" if found else ""),
            point_off_m=min(nearest, 1e3),
        )
    return tuple(one for one, d in zip(found, off, strict=True) if d <= nearest + _SAME_POINT_M)


def _turned_to(base: Vector, object_pose: Pose, solid: Solid) -> Pose:
    """Symmetry rotation of a solid after which its x axis points away from an arm's base.

    Args:
        base: Position of the base in the world, of shape (3,), m.
        object_pose: Pose of the solid in the world.
        solid: The solid; the identity is returned for one that is not round.
    """
    identity = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    if not isinstance(solid, Cylinder | Capsule):
        return identity
    z = np.array((0.0, 0.0, 1.0))
    if not (isinstance(solid, Capsule) and solid.half_length == 0.0):
        z = object_pose.rotation_matrix[:, 2]
    away = object_pose.position - base
    for direction in (away, np.eye(3)[0], np.eye(3)[2]):  # the first that is not parallel to z
        x = direction - (direction @ z) * z
        if np.linalg.norm(x) > 0.1 * np.linalg.norm(direction):
            break
    x /= np.linalg.norm(x)
    turned = Pose.from_axes(np.zeros(3), np.column_stack((x, np.cross(z, x), z)).tolist())
    return Pose(np.zeros(3), object_pose.inverse.quaternion) @ turned


def obstacles_around(arm: Arm, name: str | None, position: Vector) -> list[Obstacle]:
    """Simple shapes of the world near an object, without it and the arms.

    Args:
        arm: Arm by whose sensors they are known.
        name: Name of the object, if it is declared.
        position: Position of its center in the world, of shape (3,), m.
    """
    world = arm.world
    model = arm.world.model
    own = {*world.object_geoms(name)} if name else set[int]()
    arms = set[int]().union(*(body.geom_ids for body in world.arms.values()))
    found = []
    for geom in range(model.ngeom):
        counts = model.geom_contype[geom] or model.geom_conaffinity[geom]
        if not counts or geom in own or geom in arms:
            continue
        solid = _solid_of_geom(model, geom)
        if solid is None:
            continue
        axes = world.sensed.geom_xmat[geom].reshape(3, 3)
        pose = Pose.from_axes(world.sensed.geom_xpos[geom].copy(), axes.tolist())
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            pose = pose @ Pose.from_rpy((0.0, 0.0, -_WIDE))
        if solid.distance(pose.inverse.apply(position[None]))[0] < _NEAR:
            found.append(Obstacle(solid, pose, name_of_geom(model, geom)))
    return found


def _solid_of_geom(model: mujoco.MjModel, geom: int) -> Solid | None:
    kinds = mujoco.mjtGeom
    kind = int(model.geom_type[geom])
    size = model.geom_size[geom]
    if kind == kinds.mjGEOM_ELLIPSOID:
        return MeshSolid.hull_of(size * unit_ball())
    if kind == kinds.mjGEOM_MESH:  # its hull, with which MuJoCo collides as well
        mesh = int(model.geom_dataid[geom])
        first = int(model.mesh_vertadr[mesh])
        corners = model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])]
        return MeshSolid.hull_of(corners.astype(float))
    if kind == kinds.mjGEOM_PLANE:
        return Box(np.full(3, _WIDE))
    if kind == kinds.mjGEOM_BOX:
        return Box(size.copy())
    if kind == kinds.mjGEOM_CYLINDER:
        return Cylinder(float(size[0]), float(size[1]))
    if kind == kinds.mjGEOM_CAPSULE:
        return Capsule(float(size[0]), float(size[1]))
    return Capsule(float(size[0])) if kind == kinds.mjGEOM_SPHERE else None


def _rotation_cost(tool: Pose, here: Pose) -> float:
    """Rotation of the tool as a fraction of 180°, plus a penalty for approaches from below."""
    upward = max(0.0, float(tool.rotation_matrix[2, 2]))
    return tool.angle(here) / math.pi + upward


def _refuse_weight(arm: Arm, wanted: WantedGrasp) -> None:
    gripper = arm.gripper.description
    most = gripper.payload
    if wanted.mass > most:
        raise Failure(
            "TOO_HEAVY",
            f"{wanted.label} weighs {wanted.weight}; {gripper.name} may hold {most:g} kg",
            **wanted.evidence,
            payload_kg=most,
        )


def _refuse_width(solid: Solid, jaw: JawMeasures, wanted: WantedGrasp) -> None:
    least = least_width(solid) if wanted.edges is None else wanted.edges[1]
    if least > jaw.widest_opening - 2.0 * CLEAR:
        raise Failure(
            "TOO_WIDE",
            f"{wanted.label} is {1e3 * least:.0f} mm wide; the fingers open to "
            f"{1e3 * jaw.widest_opening:.0f} mm",
            width_m=least,
            opening_m=jaw.widest_opening,
        )


def _no_grasp(
    solid: Solid, jaw: JawMeasures | None, arm: Arm, wanted: WantedGrasp, point: Vector | None
) -> Failure:
    """Failure that states why there is no grasp, or none at a point: the mass or the shape."""
    light = Load(LIGHT_KG, np.array([0.0, 0.0, -GRAVITY]), 0.0, np.zeros(3))
    description = arm.gripper.description
    friction = wanted.friction(arm.world)
    where = "" if point is None else " at `point`"
    for_light: tuple[Grasp, ...]
    if jaw is None:
        for_light = cup_grasps(solid, cup_measures(description, friction), light, point=point)
    else:
        for_light = jaw_grasps(solid, jaw, light, jaw.friction, point=point)
    if for_light:
        return Failure(
            "TOO_HEAVY",
            f"no grasp of {description.name}{where} bears {wanted.weight} of {wanted.label} with "
            f"{min(description.force.most, wanted.most_force):g} N and friction {friction:g}",
            **wanted.evidence,
            force_n=min(description.force.most, wanted.most_force),
            friction=friction,
        )
    if jaw is None:
        wide = 2e3 * cup_measures(description, friction).radius
        reason = (
            f"{wanted.label} has no face on which the cup seals{where}: "
            f"it needs a flat one {wide:.0f} mm wide"
        )
    else:
        reason = f"{wanted.label} has no two sides between which the fingers fit{where}"
    return Failure("NO_FACE", reason)
