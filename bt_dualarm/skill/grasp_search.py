"""Grasps of one arm on an object where that lies: those with room around, the best first."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.measured_gripper import cup_measures, jaw_measures
from bt_dualarm.errors import Failure
from bt_dualarm.motion.grasping.grasp import Grasp
from bt_dualarm.motion.grasping.gripper_measures import JawMeasures, Load
from bt_dualarm.motion.grasping.jaw_grasps import CLEAR, jaw_grasps, least_width
from bt_dualarm.motion.grasping.ranking import Obstacle, RankedGrasp, ranked
from bt_dualarm.motion.grasping.solids import Box, Capsule, Cylinder, Solid, solid_of
from bt_dualarm.motion.grasping.suction import cup_grasps
from bt_dualarm.pose import Pose, Vector
from bt_dualarm.skill.taking_ports import TakingPorts
from bt_dualarm.world.world import World

GRAVITY = 9.81
"""Acceleration of gravity in m/s²."""

_WIDE = 50.0  # m: half of a plane
_ALONG = 0.99  # cosine
_AS_TOLD = math.cos(math.radians(30.0))
_OTHER = math.radians(45.0)
_HALF_TURN = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, math.pi))
_NEAR = 0.5  # m: what is farther from the object is in no finger's way


@dataclass(frozen=True, eq=False)
class WantedGrasp:
    """What is to be taken, and what the grip has to bear.

    Attributes:
        name: Name of the object, whose shape and friction the file declares; of what has no name
            that of what is known to lie there, if anything is.
        lies: Pose of it in the world, as it is believed.
        mass: Mass in kg to reckon with.
        shake: Largest acceleration of the tool in m/s² to reckon with.
        margin: Factor of the force that the grip is to have in hand.
        most_force: Force in N of each pad, or of a cup, that the object bears.
        edges: Edges in m of the box that counts for it where it has no name: fingers close along
            the second; None where it has one.
        rubs: Coefficient of friction of it then.
        along: Way of the straight approach in the world, of unit length, of shape (3,), within
            30°; None for any.
        unlike: Pose of the tool in the object's frame from which it has to be turned by 45° at
            least, or by what is short of half a turn by as much; None for any.
    """

    name: str | None
    lies: Pose
    mass: float
    shake: float
    margin: float
    most_force: float = math.inf
    edges: tuple[float, float, float] | None = None
    rubs: float = 0.0
    along: Vector | None = None
    unlike: Pose | None = None

    @classmethod
    def named(
        cls, arm: Arm, name: str, ports: TakingPorts, lies: Pose | None, unlike: Pose | None = None
    ) -> WantedGrasp:
        """An object of the file.

        Args:
            arm: Arm that is to take it.
            name: Name of the object.
            ports: What its grip has to bear, and how it is to be taken.
            lies: Pose of it in the world; None for where plans know it.
            unlike: As the attribute.

        Raises:
            Failure: ``NOT_THERE``, or ``INVALID_TARGET`` where it is fixed.
        """
        world = arm.world
        if name not in world.objects:
            raise Failure("NOT_THERE", f"object {name!r} is not in the world")
        if world.objects[name].fixed:
            raise Failure("INVALID_TARGET", f"object {name!r} is fixed: no arm can carry it")
        told = None if world.nominal[arm.name].weighs else world.objects[name].mass
        bearing = (ports.mass_of(told), ports.shake, ports.margin)
        bears = ports.most_force or math.inf
        lies = lies or world.object_pose(name)
        return cls(name, lies, *bearing, bears, along=ports.along, unlike=unlike)

    @property
    def label(self) -> str:
        """The object in a sentence."""
        return repr(self.name) if self.edges is None else "what lies there"

    def solid(self, world: World) -> Solid:
        """Its shape."""
        if self.name is None or self.edges is not None:
            return Box(0.5 * np.array(self.edges))
        thing = world.objects[self.name]
        return solid_of(thing.shape, thing.size)

    def friction(self, world: World) -> float:
        """Its coefficient of friction, as the file or the tree tells it."""
        told = self.rubs if self.name is None or self.edges else None
        return world.objects[self.name or ""].friction if told is None else told

    def allows(self, grasp: Grasp) -> bool:
        """Whether fingers close where its width was told, and the tool comes as it is to come."""
        if self.edges is None and self.along is None and self.unlike is None:
            return True
        axes = grasp.tool.rotation_matrix
        if self.edges is not None and grasp.width > 0.0 and abs(float(axes[1, 1])) <= _ALONG:
            return False
        if self.along is not None and self.lies.turn(axes[:, 2]) @ self.along < _AS_TOLD:
            return False
        if self.unlike is None:
            return True
        turned = self.unlike.angle(grasp.tool), (self.unlike @ _HALF_TURN).angle(grasp.tool)
        return min(turned) >= _OTHER


def grasps_on(arm: Arm, wanted: WantedGrasp) -> tuple[RankedGrasp, ...]:
    """Grasps of an arm's gripper on an object, the best first.

    Raises:
        Failure: ``TOO_WIDE``, ``TOO_HEAVY``, or ``OUT_OF_REACH`` where something is in the way of
            all of them; each with its numbers.
    """
    page, solid, rubs = arm.gripper.page, wanted.solid(arm.world), wanted.friction(arm.world)
    # Of something round no turn about its axis is better than another: grasps are looked for from
    # where the arm stands, so that they are the same however it was declared to be turned.
    alike = _turned_to(arm.kinematics.base.position, wanted.lies, solid)
    lies = wanted.lies @ alike
    gravity = lies.rotation_matrix.T @ np.array([0.0, 0.0, -GRAVITY])
    load = Load(wanted.margin * wanted.mass, gravity, wanted.shake, np.zeros(3))
    _refuse_weight(arm, wanted)
    jaw: JawMeasures | None = None
    if page.fingers:
        jaw = jaw_measures(page, rubs)
        jaw = replace(jaw, most_force=min(jaw.most_force, wanted.most_force))
        _refuse_width(solid, jaw, wanted)
        found = jaw_grasps(solid, jaw, load, jaw.friction)
    else:
        cup = cup_measures(page, rubs)
        cup = replace(cup, most_force=min(cup.most_force, wanted.most_force))
        found = cup_grasps(solid, cup, load)
    if not found:
        raise _too_much(solid, jaw, arm, wanted)
    found = tuple(replace(one, tool=alike @ one.tool) for one in found)
    found = tuple(one for one in found if wanted.allows(one))
    here = arm.tool_pose
    order = ranked(
        found, wanted.lies, jaw, obstacles_around(arm, wanted), lambda tool: _turning(tool, here)
    )
    if not order:
        raise Failure(
            "OUT_OF_REACH",
            f"something stands where the fingers would be around {wanted.label}"
            if found
            else f"no grasp of {wanted.label} is of the kind that is asked for",
            grasps=len(found),
        )
    return order


def _turned_to(base: Vector, lies: Pose, solid: Solid) -> Pose:
    """A turn of a solid into itself after which its x axis points away from an arm's base.

    Args:
        base: Place of the base in the world, of shape (3,), m.
        lies: Pose of the solid in the world.
        solid: The solid; of one that is not round the turn is none.
    """
    still = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    if not isinstance(solid, Cylinder | Capsule):
        return still
    z = np.array((0.0, 0.0, 1.0))
    if not (isinstance(solid, Capsule) and solid.half_length == 0.0):
        z = lies.rotation_matrix[:, 2]
    away = lies.position - base
    for way in (away, np.eye(3)[0], np.eye(3)[2]):
        x = way - (way @ z) * z
        if np.linalg.norm(x) > 0.1 * np.linalg.norm(way):
            break
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack((x, np.cross(z, x), z))
    turned = Pose.from_matrix(matrix)
    return Pose(np.zeros(3), lies.inverse.quaternion) @ turned


def obstacles_around(arm: Arm, wanted: WantedGrasp) -> list[Obstacle]:
    """What stands around the object, but for it and the arms: simple shapes of the world."""
    world, model = arm.world, arm.world.model
    own = {world.object_geom(wanted.name)} if wanted.name else set()
    arms = set[int]().union(*(body.geom_ids for body in world.arms.values()))
    found = []
    for geom in range(model.ngeom):
        solid = _solid_of_geom(int(model.geom_type[geom]), model.geom_size[geom])
        counts = model.geom_contype[geom] or model.geom_conaffinity[geom]
        if solid is None or not counts or geom in own or geom in arms:
            continue
        matrix = np.eye(4)
        matrix[:3, :3] = world.sensed.geom_xmat[geom].reshape(3, 3)
        matrix[:3, 3] = world.sensed.geom_xpos[geom]
        pose = Pose.from_matrix(matrix)
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            pose = pose @ Pose.from_rpy((0.0, 0.0, -_WIDE))
        if solid.distance(pose.inverse.apply(wanted.lies.position[None]))[0] < _NEAR:
            found.append(Obstacle(solid, pose))
    return found


def _solid_of_geom(kind: int, size: np.ndarray) -> Solid | None:
    kinds = mujoco.mjtGeom
    if kind == kinds.mjGEOM_PLANE:
        return Box(np.full(3, _WIDE))
    if kind == kinds.mjGEOM_BOX:
        return Box(size.copy())
    if kind == kinds.mjGEOM_CYLINDER:
        return Cylinder(float(size[0]), float(size[1]))
    if kind == kinds.mjGEOM_CAPSULE:
        return Capsule(float(size[0]), float(size[1]))
    return Capsule(float(size[0])) if kind == kinds.mjGEOM_SPHERE else None


def _turning(tool: Pose, here: Pose) -> float:
    """How far the tool is turned, as a share of half a turn; more where it comes from below."""
    upward = max(0.0, float(tool.rotation_matrix[2, 2]))
    return tool.angle(here) / math.pi + upward


def _refuse_weight(arm: Arm, wanted: WantedGrasp) -> None:
    most = arm.gripper.page.payload
    if wanted.mass > most:
        raise Failure(
            "TOO_HEAVY",
            f"{wanted.label} weighs {wanted.mass:.3g} kg; {arm.gripper.page.name} may hold "
            f"{most:g} kg",
            mass_kg=wanted.mass,
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


def _too_much(solid: Solid, jaw: JawMeasures | None, arm: Arm, wanted: WantedGrasp) -> Failure:
    """Why there is no grasp: what it weighs, or its shape."""
    light = Load(1e-6, np.array([0.0, 0.0, -GRAVITY]), 0.0, np.zeros(3))
    page, friction = arm.gripper.page, wanted.friction(arm.world)
    any_at_all: tuple[Grasp, ...]
    if jaw is None:
        any_at_all = cup_grasps(solid, cup_measures(page, friction), light)
    else:
        any_at_all = jaw_grasps(solid, jaw, light, jaw.friction)
    if any_at_all:
        return Failure(
            "TOO_HEAVY",
            f"no grasp of {page.name} bears {wanted.mass:.3g} kg of {wanted.label} with "
            f"{min(page.force.most, wanted.most_force):g} N and friction {friction:g}",
            mass_kg=wanted.mass,
            force_n=min(page.force.most, wanted.most_force),
            friction=friction,
        )
    if jaw is None:
        return Failure("NO_FACE", f"{wanted.label} has no face on which the cup seals")
    return Failure("NO_FACE", f"{wanted.label} has no two sides that the fingers come around")
