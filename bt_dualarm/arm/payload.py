"""What an arm can carry: its payload, its joints' efforts and the friction of its grip."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np

from bt_dualarm.arm.passengers import slowed_for_passengers
from bt_dualarm.arm.time_scale import largest_scale, link_motion
from bt_dualarm.control.dynamics import ArmDynamics, refuse_overload, within_efforts
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.grasping.grasp import (
    SHAKE_DIRECTIONS,
    CupMeasures,
    JawMeasures,
    pinching_forces,
    suction_forces,
)
from bt_dualarm.robots.gripper import Gripper, GripperShape
from bt_dualarm.robots.meshes import mesh_shapes
from bt_dualarm.sim.arm_models import NominalLoad
from bt_dualarm.sim.grippers import Attachment
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.set_points import at_scale
from bt_dualarm.trajectory.trajectory import Trajectory

IN_HAND: Final = 1.2
"""Safety factor of the grip force over the force that a motion needs."""

UNKNOWN_KG: Final = 1.0
"""Mass in kg that is assumed until it is declared or estimated."""

_HARDLY_MORE: Final = 1.05
"""Ratio of the grip force that a motion needs to the one needed at rest. Up to it the motion is not
slowed, even if the grip is too weak for both, as slowing would not help."""

_GRAVITY: Final = np.array([0.0, 0.0, -9.81])
_LEVER_M: Final = 0.005  # effective radius of a pad's torsional friction about its normal
_THICK_M: Final = 0.02  # assumed of a finger whose shape is a mesh


class PayloadCheck:
    """Check of one arm's load against its payload, its joints' efforts and its grip.

    Args:
        world: World that the arm is in.
        name: Name of the arm.

    Attributes:
        grip_speed_scale: Time scale, up to 1, to which the grip limited the last motion.
    """

    def __init__(self, world: World, name: str) -> None:
        self._world = world
        self._name = name
        self._loads: tuple[NominalLoad, ...] | None = None
        self.grip_speed_scale = 1.0

    def within_efforts(self, motion: Trajectory) -> Trajectory:
        """Slow a motion to what the joints' efforts, the grip and passengers allow, if necessary.

        Raises:
            Failure: ``OVERLOADED`` if the joints' efforts do not suffice at any speed.
        """
        nominal = self._world.nominal[self._name]
        feasible = within_efforts(motion, nominal.robot, self.dynamics)
        self.grip_speed_scale = grip_speed_scale(feasible, self._world, self._name)
        if self.grip_speed_scale < 1.0:
            feasible = at_scale(feasible, self.grip_speed_scale)
        return slowed_for_passengers(feasible, self._world, self._name)

    @property
    def dynamics(self) -> ArmDynamics:
        """Dynamics of the arm with its load."""
        nominal = self._world.nominal[self._name]
        if self._loads is not nominal.loads:
            self._loads = nominal.loads
            self._dynamics = ArmDynamics(nominal, self._loads)
        return self._dynamics

    def refuse(self, name: str, q: Vector, tool_link: Pose, seen: Pose | None = None) -> None:
        """Check, before an object is picked, whether the arm can hold it, if its mass is known.

        Args:
            name: Name of the object.
            q: Configuration in which it is picked, of shape (dof,), rad.
            tool_link: Pose of the tool's link in that configuration, in the world.
            seen: Estimated pose of the object in the world; its true one by default.

        Raises:
            Failure: ``OVERLOADED`` if it exceeds the arm's payload, or what its joints can hold in
                that configuration.
        """
        world = self._world
        nominal = world.nominal[self._name]
        robot = nominal.robot
        pose = tool_link.inverse @ (seen or world.object_pose(name))
        new = NominalLoad.of(
            name,
            world.objects[name],
            pose,
            known=not nominal.estimates_payload,
            upon=world.placed_on(name),
        )
        loads = (*nominal.loads, new)
        mass = sum(load.borne for load in loads if load.borne is not None)
        if robot.payload is not None and mass > robot.payload:
            raise Failure(
                "OVERLOADED",
                f"{self._name} would hold {mass:.3g} kg; "
                f"the payload of {robot.full_name} is {robot.payload:g} kg",
                mass_kg=mass,
                payload_kg=robot.payload,
            )
        refuse_overload(ArmDynamics(nominal, loads).at_rest(q)[None], robot)


def grip_speed_scale(motion: Trajectory, world: World, arm: str) -> float:
    """Largest uniform time scale of a motion, up to 1, at which friction holds the object.

    The grip has to bear mass times (gravity minus acceleration of the load's center), where the
    acceleration grows with the square of the scale; see `pinching_forces` and `suction_forces` for
    what pads and cup bear. Where it does not even bear the weight, as far as that is known, the
    scale is that at which accelerations hardly add to it.

    Args:
        motion: Motion from rest to rest.
        world: World that the arm is in.
        arm: Name of the arm; without a gripped object the scale is 1.
    """
    scales = [
        _speed_scale(motion, world, held, load)
        for held in world.attachments.gripped_by(arm)
        for load in world.nominal[arm].loads
        if load.object == held.object
    ]
    return min(scales, default=1.0)


def grip_force_for(world: World, held: Attachment, load: NominalLoad, shake: float) -> float:
    """Force in N that holds an estimated load in the tool's current orientation, with `IN_HAND`.

    Args:
        world: World that the arm is in.
        held: Attachment of the load to the gripper.
        load: Load as the arm has estimated it; the upper bound of its mass counts.
        shake: Acceleration that the grip must withstand in any direction, m/s².

    Returns:
        Force of each pad, or of a cup; 0 if the mass is unknown, infinite if no force holds.
    """
    if load.mass is None:
        return 0.0
    nominal = world.nominal[held.arm]
    turn = nominal.tool_link_pose_at(world.hardware[held.arm].q).rotation_matrix
    mass = load.share * (load.mass + load.mass_doubt)
    accelerations = shake * SHAKE_DIRECTIONS
    turns = np.broadcast_to(turn, (len(accelerations), 3, 3))
    return float(_Grip(world, held, load).forces_for(mass, turns, accelerations).max())


def min_grip_force(description: Gripper, friction: float, load: NominalLoad) -> float:
    """Minimum force in N of each pad, or of a cup, that holds a load at rest, with `IN_HAND`.

    Only the mass counts: the estimate of the center is too uncertain for a bound.

    Args:
        description: Description of the gripper.
        friction: Coefficient of friction.
        load: Load; the force is 0 if its mass is unknown.
    """
    weight = -_GRAVITY[2] * (load.borne or 0.0)
    share = (
        2.0 * friction if description.fingers else 1.0
    )  # two pads bear by friction, a cup by suction
    return float(IN_HAND * weight / max(share, 1e-9))


def _speed_scale(motion: Trajectory, world: World, held: Attachment, load: NominalLoad) -> float:
    mass = load.share * (UNKNOWN_KG if load.mass is None else load.mass + load.mass_doubt)
    nominal = world.nominal[held.arm]
    moved = link_motion(motion, nominal, load.pose.position)
    axes = load.pose.rotation_matrix
    moments = moved.moments(mass * (axes * load.gyration) @ axes.T)
    grip = _Grip(world, held, load)

    def needed(scale: float) -> Vector:
        square = scale**2
        return grip.forces_for(mass, moved.turns, square * moved.accelerations, square * moments)

    bearable = np.maximum(grip.force, _HARDLY_MORE * needed(0.0))

    def bears(scale: float) -> bool:
        return bool((needed(scale) <= bearable).all())

    return largest_scale(bears)


class _Grip:
    """A gripper's commanded hold on an object.

    Args:
        world: World that the arm is in.
        held: Attachment of the object to the gripper.
        load: Mass and center of it.

    Attributes:
        force: Commanded force of each pad, or of a cup, N.
    """

    def __init__(self, world: World, held: Attachment, load: NominalLoad) -> None:
        hardware = world.grippers[held.arm]
        description = hardware.gripper
        friction = world.objects[held.object].friction
        self._tool = world.robots[held.arm].tool
        self.force = hardware.commanded.force
        self._offset = (self._tool.inverse @ load.pose).position
        self._width = hardware.width
        self._cup = None if description.fingers else cup_measures(description, friction)
        self._friction = max(description.friction, friction)
        if description.fingers:
            pad_center = jaw_measures(description, friction).pad_center
            self._offset = self._offset - np.array((0.0, 0.0, pad_center))

    def forces_for(
        self,
        mass: float,
        turns: np.ndarray,
        accelerations: Matrix,
        moments: Matrix | None = None,
    ) -> Vector:
        """Forces in N that hold a mass that is accelerated so, with `IN_HAND`, of shape (n,).

        Args:
            mass: Mass in kg.
            turns: Axes of the tool's link in the world at each sample, of shape (n, 3, 3).
            accelerations: Accelerations of the load's center in the world, of shape (n, 3), m/s².
            moments: Moments that turn the load about its center, in the axes of the tool's link,
                of shape (n, 3), N m; none by default.
        """
        in_link = np.einsum("nij,ni->nj", turns, mass * (_GRAVITY - accelerations))
        axes = self._tool.rotation_matrix
        forces = in_link @ axes
        resisting = None if moments is None else -moments @ axes
        if self._cup is not None:
            needed = suction_forces(
                forces, self._offset, np.array((0.0, 0.0, -1.0)), self._cup, resisting
            )
        else:
            closing = np.array((0.0, 1.0, 0.0))
            needed = pinching_forces(
                forces, self._offset, closing, self._width, _LEVER_M, self._friction, resisting
            )
        forces_with_margin: Vector = IN_HAND * needed
        return forces_with_margin


def jaw_measures(description: Gripper, friction: float) -> JawMeasures:
    """Measures of two fingers that decide where they can grasp.

    Args:
        description: Description of the gripper.
        friction: Coefficient of friction of the object.
    """
    finger = description.fingers[0]
    in_tool = description.tool.inverse @ finger.pose
    pad = in_tool @ finger.pad.pose
    width, thickness, length = finger.pad.size
    corners = [_corners(in_tool @ one.pose, one) for one in (finger.pad, *finger.part.collision)]
    points = np.vstack([one for one in corners if one is not None])
    # More than the pad's own eight corners: the finger has a shape that is not a mesh.
    outside = float(np.abs(points[:, 1]).max()) if len(points) > 8 else thickness + _THICK_M
    return JawMeasures(
        least_opening=0.0,
        widest_opening=description.stroke,
        pad_length=length,
        pad_width=width,
        palm=_palm_depth(description),
        tip=float(points[:, 2].max()),
        thickness=outside,
        least_force=description.force.least,
        most_force=description.force.most,
        friction=max(description.friction, friction),
        pad_center=float(pad.position[2]),
    )


@lru_cache(maxsize=64)  # each run reads a user's own grippers again
def _palm_depth(description: Gripper) -> float:
    """Distance from the tool frame back to what an object between open pads would meet, m.

    That is the origin of the fingers, or what the palm's shapes have before it between the pads:
    the face of a Franka Hand is 7 mm nearer.
    """
    finger = description.fingers[0]
    between = 0.5 * np.array((finger.pad.size[0], description.stroke))
    depth = -float((description.tool.inverse @ finger.pose).position[2])
    for shape in description.palm.collision:
        in_tool = description.tool.inverse @ shape.pose
        points = _corners(in_tool, shape)
        if points is None and shape.mesh is not None:
            parts = mesh_shapes(shape.mesh, shape.size).parts
            points = in_tool.apply(np.vstack([part.vertices for part in parts]))
        if points is None:
            continue
        least = points[:, :2].min(axis=0)
        most = points[:, :2].max(axis=0)
        if (least < between).all() and (most > -between).all():
            depth = min(depth, round(-float(points[:, 2].max()), 6))
    return depth


def cup_measures(description: Gripper, friction: float) -> CupMeasures:
    """Measures of a suction cup that decide where it can grasp.

    Args:
        description: Description of the gripper.
        friction: Coefficient of friction of the object.

    Raises:
        ValueError: It has no cup.
    """
    if description.cup is None:
        raise ValueError(f"{description.name} has no cup")
    return CupMeasures(
        radius=description.cup.radius,
        bends=1e-3,
        most_force=description.force.most,
        friction=max(description.friction, friction),
        length=-float((description.mount @ description.tool).inverse.position[2]),
    )


def _corners(pose: Pose, solid: GripperShape) -> Vector | None:
    """Corners of the box around a shape, of shape (8, 3), m; None for a mesh."""
    if solid.kind == "mesh":
        return None
    size = solid.size
    if solid.kind == "box":
        half = 0.5 * np.asarray(size)
    else:
        half = np.array([size[0], size[0], 0.5 * size[1] if len(size) > 1 else size[0]])
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners: Vector = pose.apply(signs * half)
    return corners
