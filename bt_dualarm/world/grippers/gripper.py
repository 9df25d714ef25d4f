"""A gripper as everybody works with it: what it can do, and what it consists of."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from bt_dualarm.pose import Matrix, Pose, Vector

PALM: Final = "gripper/palm"
"""Link that a gripper adds to its arm; no link of a URDF has a slash in its name."""

CLOSED_M: Final = 0.001
"""Opening in metres at which fingers are closed, or more where their encoder is coarser."""

FINGERS: Final = ("gripper/left", "gripper/right")
"""Bodies and joints of the two fingers, below the palm."""


@dataclass(frozen=True, eq=False)
class Solid:
    """One shape of a gripper.

    Attributes:
        kind: ``box``, ``cylinder``, ``sphere`` or ``mesh``.
        size: Full lengths of a box, radius and length of a cylinder, radius of a sphere (m); the
            scale of a mesh.
        pose: Pose in its part.
        mesh: File of a mesh.
    """

    kind: str
    size: tuple[float, ...]
    pose: Pose
    mesh: Path | None = None


@dataclass(frozen=True, eq=False)
class RigidPart:
    """A rigid part of a gripper, in its own frame.

    Attributes:
        mass: Mass in kg.
        center: Centre of mass, of shape (3,), m.
        inertia: Inertia about the centre of mass, of shape (3, 3), kg m².
        collision: Shapes that touch things.
        visual: Shapes that people see; those that touch where there are none.
    """

    mass: float
    center: Vector
    inertia: Matrix
    collision: tuple[Solid, ...]
    visual: tuple[Solid, ...]


@dataclass(frozen=True, eq=False)
class Finger:
    """A finger that slides in the palm.

    Attributes:
        part: What it consists of.
        pose: Pose of its frame in the palm when the gripper is closed.
        axis: Direction in the palm in which it opens, of unit length, of shape (3,).
        pad: Box that takes hold of things, in the finger.
    """

    part: RigidPart
    pose: Pose
    axis: Vector
    pad: Solid


@dataclass(frozen=True)
class Cup:
    """A suction cup; its rim lies in the tool frame's plane.

    Attributes:
        radius: Radius of its rim in m.
        depth: Depth of its lip in m.
        seal: Share of the rim that has to lie on a thing so that it seals.
    """

    radius: float
    depth: float
    seal: float


@dataclass(frozen=True)
class Tactile:
    """What feels the force on each pad.

    Attributes:
        rate: Readings a second, Hz.
        noise: Deviation of a reading in each direction, N.
        gain: Half-width of the share by which a pad's sensor reads too much or too little.
    """

    rate: float
    noise: float
    gain: float


@dataclass(frozen=True)
class Span:
    """What a gripper can be asked for: from the least to the most."""

    least: float
    most: float

    def clipped(self, value: float) -> float:
        """The nearest value that it can do."""
        return min(max(value, self.least), self.most)


@dataclass(frozen=True, eq=False)
class Gripper:
    """A gripper of the catalogue, SI units.

    Attributes:
        name: Name in the catalogue.
        title: Name for people.
        mount: Pose of the palm in the robot's flange, whose z axis points away from the arm.
        tool: Tool frame in the palm: between the pads, or in the cup's rim. Its z axis points out
            of the gripper, its y axis along the way of the fingers.
        stroke: Distance of the pads when it is open, m; 0 for a cup.
        force: Force of each pad on what is between them, N; of a cup, that which pulls it off.
        speed: Speed of the opening, of both fingers together, m/s; zeros for a cup.
        payload: Most that it may hold, kg.
        resolution: Step of its opening's encoder, m; 0 for none.
        friction: Least coefficient of friction of its pads or cup, whatever the thing has.
        palm: All of it that does not move in it.
        fingers: Two fingers, or none.
        cup: Suction cup, if it has one.
        drive_mass: What a finger's drive adds to its inertia, kg.
        tactile: What feels the force on each pad, if anything does.
        color: RGBA of its shapes.
    """

    name: str
    title: str
    mount: Pose
    tool: Pose
    stroke: float
    force: Span
    speed: Span
    payload: float
    resolution: float
    friction: float
    palm: RigidPart
    fingers: tuple[Finger, ...]
    cup: Cup | None
    drive_mass: float
    tactile: Tactile | None
    color: tuple[float, float, float, float]

    @property
    def kind(self) -> str:
        """``"fingers"`` or ``"suction"``."""
        return "fingers" if self.fingers else "suction"

    @property
    def closed_width(self) -> float:
        """Opening in m below which nothing is between the fingers: two steps of the encoder."""
        return max(CLOSED_M, 2.0 * self.resolution)

    @property
    def moved_mass(self) -> float:
        """What the drive moves with a finger, and of itself, kg."""
        return self.drive_mass + sum(finger.part.mass for finger in self.fingers[:1])

    @property
    def mass(self) -> float:
        """Mass of all of it, kg."""
        return self.palm.mass + sum(finger.part.mass for finger in self.fingers)
