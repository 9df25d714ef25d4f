"""The gripper of an arm as skills use it: its abilities, sensors and commands."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from bt_dualarm.arm.known_objects import KnownObjects
from bt_dualarm.arm.payload import jaw_measures
from bt_dualarm.arm.state import Leaseholder
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.grasping.candidates import least_width
from bt_dualarm.grasping.grasp import JawMeasures
from bt_dualarm.robots.gripper import Gripper
from bt_dualarm.sim.grippers import SPEED_S, GripperCommand, GripperHardware
from bt_dualarm.sim.world import World

LOST_S: Final = 0.04
"""Seconds for which a sign of grasp loss has to last: a single reading may be wrong."""

OTHER_WIDTH_M: Final = 0.006
"""Largest difference of the opening from the width of the object that is held."""

# Signs of slip and grasp loss. Changes of the opening also have to exceed some encoder steps.
_SLID_M: Final = 0.003  # change of the opening: another part of the object is between the pads
_SLID_STEPS: Final = 3.0
_GIVES_M: Final = 0.0015  # decrease of the opening just before the object is lost
_GIVES_STEPS: Final = 1.5
_LEAKS: Final = 0.9  # below this fraction of the largest vacuum so far, the cup leaks
_SEALS: Final = 0.5  # below this fraction of the commanded vacuum, the cup does not seal

# Rest, opening and contact
_REST_MPS: Final = 0.003  # speed of fingers at rest; encoder noise is allowed for in addition:
_REST_STEPS: Final = 2.5  # encoder steps within the window of the speed measurement
_OPEN_M: Final = 1e-3  # tolerance of the opening, in addition to an encoder step
_NO_VACUUM: Final = 0.01
_VENTED_S: Final = 0.15  # time in which the rest of a vacuum no longer holds 3 g
_GRAVITY: Final = 9.81  # m/s²
_VENTING_S: Final = 0.05  # time constant of a vacuum
_STARTS_S: Final = 0.1  # time in which fingers begin to move
_TIMEOUT_S: Final = 1.0  # timeout in addition to twice the nominal opening time
_CLOSING_SHARE: Final = 1.5  # time limit of a closing motion over its time at constant speed
_DECIDED_S: Final = 1.0  # time for fingers to open or build up force
_FELT: Final = 0.1  # fraction of the minimum commandable force; the fingers' own friction is less
_PRESSING: Final = 0.8  # fraction of the commanded force

# Identification of the object
_AWAY_M: Final = 0.015  # largest distance of pads or cup from the object that they hold
_PAD_POINTS: Final = 5  # samples along each edge of a pad
_CHORD_M: Final = 5e-4  # sampling distance from one pad to the other


class ArmGripper:
    """A gripper with two fingers or a suction cup, as one leaf uses it.

    What it holds is a belief from commands and sensors: ``holding`` is what it senses now, ``held``
    names the objects that the nominal model attaches to it.

    Args:
        world: World that the arm is in.
        arm: Name of the arm.
        lease: Lease of the arm, as the leaf holds it.
        known: Where the arm believes objects to be.
    """

    def __init__(self, world: World, arm: str, lease: Leaseholder, known: KnownObjects) -> None:
        self._world = world
        self._arm = arm
        self._lease = lease
        self._known = known

    @property
    def description(self) -> Gripper:
        """Description of the gripper: stroke, force, speed, tool frame."""
        return self._hardware.gripper

    @property
    def width(self) -> float:
        """Opening between the pads from the encoder, m; 0 for a cup."""
        return self._hardware.width

    @property
    def speed(self) -> float:
        """Speed of the opening, m/s; positive while it opens."""
        return self._hardware.speed

    @property
    def force(self) -> float:
        """Force of a pad by the motor, positive where it closes, or force of a cup's vacuum, N."""
        return self._hardware.force

    @property
    def load(self) -> Vector | None:
        """Force of the held object on both pads together, of shape (3,), N, in the world.

        By the tactile sensors of the fingers; None without them.
        """
        sensors = self._hardware.tactile
        if sensors is None:
            return None
        tool = self._world.nominal[self._arm].tool_pose_at(self._world.hardware[self._arm].q)
        load: Vector = tool.turn(sensors.forces.sum(axis=0))
        return load

    @property
    def touch(self) -> float:
        """Largest force on one of the fingertips from their sensors, N.

        Without tactile sensors, that of the drive once the fingers are at rest on something; for a
        cup, the force of its vacuum.
        """
        sensors = self._hardware.tactile
        if sensors is not None:
            return float(np.linalg.norm(sensors.forces, axis=1).max())
        if self.description.fingers and not (self.at_rest and self.width > self.closed_width):
            return 0.0
        return max(self.force, 0.0)

    @property
    def vacuum(self) -> float:
        """Measured fraction of the full vacuum of a cup, from 0 to 1; 0 for fingers."""
        return self._hardware.vacuum

    @property
    def commanded(self) -> GripperCommand:
        """Last command."""
        return self._hardware.commanded

    @property
    def at_rest(self) -> bool:
        """Whether the fingers are at rest; always true for a cup."""
        return abs(self.speed) < max(_REST_MPS, _REST_STEPS * self.description.resolution / SPEED_S)

    @property
    def closed_width(self) -> float:
        """Opening, m, below which nothing is between the fingers."""
        return self.description.closed_width

    @property
    def holding(self) -> bool:
        """Whether it holds something, from its sensors.

        Fingers hold when they press with the commanded force, are at rest and are not closed. A cup
        holds when it is commanded to suck and has built up the commanded force.
        """
        presses = self.force >= _PRESSING * self.commanded.force
        if not self.description.fingers:
            return self.commanded.width <= 0.0 and presses
        return self.at_rest and presses and self.width > self.closed_width

    def closing_limit_s(self, least: float) -> float:
        """Time after a command to close until which the fingers have to hold something, s.

        Args:
            least: Limit for fingers that are fast enough, s; slow or wide open ones get more.
        """
        return max(least, _CLOSING_SHARE * self.width / max(self.commanded.speed, 1e-3))

    @property
    def is_lost(self) -> bool:
        """Whether the held object is lost: from the sensors, fingers have shut or the cup leaks."""
        return is_lost(self.description, self.width, self.vacuum, self.commanded.force)

    def until_decided(self) -> Iterator[None]:
        """Wait until the sensors confirm or refute the believed hold; once per tick.

        A leaf that was halted may have left the fingers in motion, and after a command to press
        harder they do not count as holding until the force has built up.
        """
        began = self._world.time
        while self.held and not self.holding and self._world.time - began < _DECIDED_S:
            if self._is_open and self.commanded.width > 0.0:
                break
            yield None
        self.forget_released()

    @property
    def held(self) -> tuple[str, ...]:
        """Names of the objects that it is believed to hold."""
        return tuple(one.object for one in self._world.attachments.gripped_by(self._arm))

    def command(
        self, width: float | None = None, speed: float | None = None, force: float | None = None
    ) -> None:
        """Command an opening, or closing if none is given; it holds until the next command.

        The fingers move at the speed until they meet resistance, and then keep up the force. A cup
        sucks if the width is 0 or not given, and releases if it is not 0. The arm's model bears
        nothing of a held object from the command to open on: once the object is free, a light wrist
        whose controller still believes in the inertia of a beam would swing ever faster.

        Args:
            width: Opening, m; None to close with the force.
            speed: Speed of the opening, m/s; by default the largest.
            force: Largest force of each pad, N; by default the largest of the gripper.

        Raises:
            Failure: ``INVALID_TARGET`` if one of them is beyond the gripper's range.
            SkillError: The calling thread is not the one that ticks the leaf.
        """
        self._lease.refuse_other_threads()
        description = self.description
        _refuse_beyond(description, width, speed, force)
        self._hardware.command(
            GripperCommand(
                0.0 if width is None else width,
                description.speed.most if speed is None else speed,
                description.force.most if force is None else force,
            )
        )
        closed = self.width + _OPEN_M + description.resolution if description.fingers else 0.0
        opens = width is not None and width > closed
        self._world.attachments.release(self._arm, opens=opens)

    def until_open(self, settle: float = 0.0) -> Iterator[float]:
        """Wait until the fingers are at the commanded opening, or a cup's vacuum is gone.

        Yields the progress once per tick. What a cup is commanded to release is detached at once:
        with the last of the vacuum the object is free.

        Args:
            settle: Simulated seconds for which it has to stay open.

        Raises:
            Failure: ``NOT_OPEN``: something blocks the fingers.
        """
        began = self._world.time
        asked = self.commanded
        if not self.description.fingers and asked.width > 0.0:
            for name in self.held:
                settle = max(settle, self._vented_s(name))
                self.let_go(name)
        travel = abs(asked.width - self.width) if self.description.fingers else 0.0
        longest = _TIMEOUT_S + 2.0 * travel / max(asked.speed, 1e-3) + settle
        since: float | None = None
        while True:
            now = self._world.time
            since = None if not self._is_open else now if since is None else since
            if since is not None and now - since >= settle:
                return
            if now - began > longest:
                self._world.attachments.release(self._arm, opens=False)
                apart = f"the fingers are {1e3 * self.width:.1f} mm apart"
                raise Failure("NOT_OPEN", apart, width_m=self.width, force_n=self.force)
            yield (now - began) / longest

    def _vented_s(self, name: str) -> float:
        """Time in s for the rest of a vacuum, which no sensor shows, to decay to half a weight."""
        world = self._world
        if name not in world.objects:  # removed meanwhile
            return 0.0
        if world.nominal[self._arm].estimates_payload:
            return _VENTED_S
        weight = _GRAVITY * world.loaded_mass(name)
        rest = _NO_VACUUM * self.description.force.most
        return float(np.clip(_VENTING_S * np.log(2.0 * rest / weight), 0.0, _VENTED_S))

    def until_let_go(self) -> Iterator[None]:
        """Wait until what it was told to release is free; once per tick, and 1 s at most.

        A vacuum lasts for 0.2 s: an arm that moves before drags along what is below the cup. Plans
        are for fingers as far apart as they are: those that open around an object have no room yet.
        """
        if self._is_open:
            return
        began = closed = self._world.time
        settle = 0.0 if self.description.fingers else _VENTED_S
        while self.commanded.width > 0.0 and self._world.time - began <= _TIMEOUT_S:
            waited = self._world.time - began
            if self._is_open and self._world.time - closed >= settle:
                return
            if self.description.fingers and waited > _STARTS_S and self.at_rest:
                return  # blocked
            if not self._is_open:
                closed = self._world.time
            yield

    @property
    def _is_open(self) -> bool:
        if not self.description.fingers:
            return self.vacuum < _NO_VACUUM
        error = abs(self.width - self.commanded.width)
        return self.at_rest and error <= _OPEN_M + self.description.resolution

    def between_the_pads(self, pose: Pose, meant: Pose | None = None) -> Pose:
        """Estimated pose of an object after the pads have closed on it, which centers it.

        Args:
            pose: Estimated pose in the world before.
            meant: Planned pose of the tool in the object's frame; by default the pads close on
                the object's center.

        Returns:
            The pose, shifted along the closing direction; unchanged for a cup.
        """
        if not self.description.fingers:
            return pose
        q = self._world.hardware[self._arm].q
        tool = self._world.nominal[self._arm].tool_pose_at(q)
        in_tool = tool.inverse @ pose
        along = 0.0 if meant is None else float(meant.inverse.position[1])
        x, _, z = in_tool.position
        return tool @ Pose(np.array((x, along, z)), in_tool.quaternion)

    def meant_around(self, name: str, pose: Pose) -> Pose | None:
        """Pose of the tool in an object's frame, with the pads around the middle of what they hold.

        Args:
            name: Name of an object in the world.
            pose: Estimated pose of it in the world, between the pads.

        Returns:
            The pose; None for a convex object, whose center pads close on, and for a cup.
        """
        declared = self._world.objects[name]
        if not self.description.fingers or declared.shape not in ("compound", "mesh"):
            return None
        in_tool = self._pose_in_tool(pose)
        points = self._between_pads(jaw_measures(self.description, declared.friction))
        distances = self._world.object_solid(name).distance(in_tool.inverse.apply(points))
        inside = points[distances < 0.0, 1]
        if inside.size == 0:
            return None
        middle = np.array((0.0, 0.5 * float(inside.min() + inside.max()), 0.0))
        return in_tool.inverse @ Pose(middle, np.array((1.0, 0.0, 0.0, 0.0)))

    def _pose_in_tool(self, pose: Pose) -> Pose:
        """A pose in the world, in the frame of the tool by the encoders."""
        q = self._world.hardware[self._arm].q
        return self._world.nominal[self._arm].tool_pose_at(q).inverse @ pose

    def _between_pads(self, jaw: JawMeasures) -> Matrix:
        """Points between the open pads, of shape (n, 3), tool frame, m, line by line."""
        across, between, along = (
            np.linspace(-0.5, 0.5, count) * length
            for count, length in (
                (_PAD_POINTS, jaw.pad_width),
                (round(self.description.stroke / _CHORD_M) + 1, self.description.stroke),
                (_PAD_POINTS, jaw.pad_length),
            )
        )
        grid = np.stack(np.meshgrid(across, along + jaw.pad_center, between, indexing="ij"), -1)
        points: Matrix = grid[..., [0, 2, 1]].reshape(-1, 3)
        return points

    def why_not(self, name: str, pose: Pose) -> str | None:
        """Reason why the object that is held cannot be a named one, by its distance and width.

        Args:
            name: Name of an object in the world.
            pose: Estimated pose of it in the world; the fingers may have moved it along their
                closing direction.

        Returns:
            A sentence; None if it can be this object.
        """
        declared = self._world.objects[name]
        solid = self._world.object_solid(name)
        in_tool = self._pose_in_tool(pose)
        if not self.description.fingers:
            away = float(solid.distance(in_tool.inverse.apply(np.zeros((1, 3))))[0])
            return _too_far(name, away, "cup")
        points = self._between_pads(jaw_measures(self.description, declared.friction))
        distances = solid.distance(in_tool.inverse.apply(points))
        too_far = _too_far(name, float(distances.min()), "pads")
        if too_far is not None:
            return too_far
        closing = in_tool.rotation_matrix.T[:, 1]
        most = solid.reach(closing) + solid.reach(-closing)
        inside = distances.reshape(_PAD_POINTS**2, -1) < 0.0
        least = min(least_width(solid), float(inside.sum(axis=1).max()) * _CHORD_M)
        if least - OTHER_WIDTH_M <= self.width <= most + OTHER_WIDTH_M:
            return None
        return (
            f"the fingers are {1e3 * self.width:.1f} mm apart, but {name!r} would be "
            f"{1e3 * least:.0f} to {1e3 * most:.0f} mm wide"
        )

    def hold(
        self,
        name: str,
        pose: Pose,
        most_force: float = math.inf,
        *,
        mass_declared: bool = True,
        share: float = 1.0,
    ) -> None:
        """Attach an object to the gripper in the nominal model: it moves with the tool from now on.

        Args:
            name: Name of the object.
            pose: Estimated pose of the object in the world.
            most_force: Force in N of each pad, or of a cup, that the object withstands.
            mass_declared: Whether the arm may use the declared mass, if the file discloses it.
            share: Share of the weight that the arm bears, if another one holds the object, too.
        """
        self._lease.refuse_other_threads()
        self._world.hold(
            self._arm, name, pose, most_force, mass_declared=mass_declared, share=share
        )
        self._known.took(name)

    def refuse_other(self, wanted: str | None = None) -> None:
        """Check that it holds nothing but the named object; a lost object is detached first.

        Args:
            wanted: Name of an object that it may already hold.

        Raises:
            Failure: ``GRIPPER_FULL``, by ``held`` or, if that is empty, from the sensors.
        """
        self.forget_lost()
        held = self.held
        if held and held != (wanted,):
            other = next(name for name in held if name != wanted)
            raise self._full(
                f"{self.description.name} holds {other!r}: `place` or `release` it first"
            )
        if self.holding and not held:
            what = (
                f"something {1e3 * self.width:.1f} mm wide"
                if self.description.fingers
                else "something"
            )
            raise self._full(
                f"{self.description.name} holds {what} without a name: `release` it first"
            )

    def refuse_full(self, wanted: str | None = None) -> None:
        """Like `refuse_other`; also checks that nothing is attached to the tool.

        Args:
            wanted: Name of an object that it may already hold.

        Raises:
            Failure: ``GRIPPER_FULL``.
        """
        self.refuse_other(wanted)
        for one in self._world.attachments:
            if one.arm == self._arm and not one.by_gripper:
                raise self._full(f"{one.object!r} is attached to the tool: `detach` it first")

    def _full(self, sentence: str) -> Failure:
        return Failure("GRIPPER_FULL", sentence, width_m=self.width, force_n=self.force)

    def forget_lost(self) -> None:
        """Detach a lost object: from the sensors, fingers have shut or the cup leaks."""
        self._known.dropped = None
        if self.is_lost:
            self.forget_released()

    def forget_released(self) -> None:
        """Detach the released object, unless the sensors still show something in the gripper."""
        felt = self.description.fingers and self.force > _FELT * self.description.force.least
        if self.is_lost or not (self.holding or felt):
            for name in self.held:
                self.let_go(name)

    def let_go(self, name: str, *, stands: bool = False) -> bool:
        """Detach an object in the nominal model; returns whether it was believed to be held.

        Args:
            name: Name of the object.
            stands: Whether it stands on something, and does not fall to another arm that holds it.
        """
        self._lease.refuse_other_threads()
        if name not in self.held:
            return False
        # A cup that was commanded to release has no vacuum either, like one that has lost its
        # object.
        if self.commanded.width > 0.0 or not self.is_lost:
            self._known.left(name)
        return self._world.attachments.detach(self._arm, name, stands=stands)

    @property
    def _hardware(self) -> GripperHardware:
        return self._world.grippers[self._arm]


def has_slipped(description: Gripper, moved: float) -> bool:
    """Whether a change of the opening, m, shows that the object has slid between the pads."""
    return moved > max(_SLID_M, _SLID_STEPS * description.resolution)


def gives(description: Gripper, shrunk: float) -> bool:
    """Whether a decrease of the opening, m, shows that the object is slipping out."""
    return shrunk > max(_GIVES_M, _GIVES_STEPS * description.resolution)


def leaks(vacuum: float, most: float) -> bool:
    """Whether a cup leaks, by its vacuum and the largest one so far, as fractions of a full one."""
    return vacuum < _LEAKS * most


def is_lost(description: Gripper, width: float, vacuum: float, force: float) -> bool:
    """Whether the fingers have shut, or the cup does not seal.

    Args:
        description: Description of the gripper.
        width: Measured opening, m.
        vacuum: Measured fraction of the full vacuum.
        force: Commanded force, N.
    """
    if description.fingers:
        return width <= description.closed_width
    return vacuum < _SEALS * force / description.force.most


def _too_far(name: str, away: float, what: str) -> str | None:
    if away <= _AWAY_M:
        return None
    return f"{name!r} is {1e3 * away:.0f} mm from the {what}"


def _refuse_beyond(
    description: Gripper, width: float | None, speed: float | None, force: float | None
) -> None:
    """Check that a command is within the gripper's range."""
    ranges = [("force", force, description.force.least, description.force.most, "N")]
    if description.fingers:
        ranges = [
            ("width", width, 0.0, description.stroke, "m"),
            ("speed", speed, description.speed.least, description.speed.most, "m/s"),
            *ranges,
        ]
    for what, given, least, most, unit in ranges:
        if given is not None and not least - 1e-9 <= given <= most + 1e-9:
            raise Failure(
                "INVALID_TARGET",
                f"{what} {given:g} {unit}: {description.name} can do {least:g} to {most:g} {unit}",
                asked=given,
                least=least,
                most=most,
            )
