"""Arrays of the kernels: rays, shapes, lights and hits; columns of sensors, drives and fingers."""

from __future__ import annotations

from typing import Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Vector

Numbers: TypeAlias = npt.NDArray[np.int64]

HULL: Final = 0
PLANE: Final = 1
SPHERE: Final = 2
CYLINDER: Final = 3
CAPSULE: Final = 4

NOTHING: Final = -1
"""Face index of a ray that hits nothing."""


class Fan(NamedTuple):
    """Rays from one point, on a grid of image cells.

    Attributes:
        eye: Origin of the rays in the world, of shape (3,), m.
        axes: Camera's x (right), y (up) and z (backward) as columns in the world.
        rays: Unit vectors in these axes, of shape (3, rows, columns); each passes through some
            point of its cell.
        spacing: Distance of neighboring cells at a depth of 1 m.
        center: Column and row of the camera's axis on the grid.
    """

    eye: Vector
    axes: Matrix
    rays: npt.NDArray[np.float64]
    spacing: float
    center: tuple[float, float]


class Hits(NamedTuple):
    """First intersections of the rays of a fan.

    Attributes:
        geoms: Id of each geom, -1 for none, of shape (rows, columns).
        distances: Distance from the eye in m, inf for none, of shape (rows, columns).
        normals: Outward unit normals in the world, zero for none, of shape (3, rows, columns).
    """

    geoms: npt.NDArray[np.int32]
    distances: npt.NDArray[np.float64]
    normals: npt.NDArray[np.float64]

    @classmethod
    def none(cls, fan: Fan) -> Hits:
        """Hits of rays that hit nothing."""
        grid = fan.rays.shape[1:]
        return cls(np.full(grid, -1, np.int32), np.full(grid, np.inf), np.zeros((3, *grid)))


class Marks(NamedTuple):
    """First intersections in the compact form that the kernels fill, from which `Hits` follow.

    Attributes:
        faces: Index of a face among all faces of the shapes; for a curved shape -2 minus its index;
            -1 for none. Of shape (rows, columns).
        distances: Distance from the eye in m, inf for none, of shape (rows, columns).
        normals: Outward unit normals in the world of the faces that were tested, (f + n, 3).
        eyes: Position of the eye in the frame of each shape that was tested, of shape (n, 3), m.
        turns: The camera's axes as columns in that frame, of shape (n, 3, 3).
    """

    faces: npt.NDArray[np.int32]
    distances: npt.NDArray[np.float64]
    normals: Matrix
    eyes: Matrix
    turns: npt.NDArray[np.float64]


class Shapes(NamedTuple):
    """Shapes of n geoms; the hulls share one array of corners and one of triangles.

    Attributes:
        geoms: Ids of the geoms in the model, of shape (n,).
        kinds: `HULL`, `PLANE`, `SPHERE`, `CYLINDER` or `CAPSULE`, of shape (n,).
        sizes: Half lengths of a plane along x and y (inf: infinite); radius and half length of the
            others, of shape (n, 3), m.
        radii: Radii of bounding spheres about the geoms' centers, inf for planes, (n,), m.
        corners: Corners of all hulls, of shape (c, 3), m.
        triangles: Indices of their corners, of shape (f, 3).
        normals: Outward unit normals of the triangles, of shape (f, 3).
        offsets: Distances of the triangles' planes from the geom's origin, of shape (f,), m.
        mesh_ranges: First and end corner, first and end triangle of each geom, of shape (n, 4).
        owners: Id of the geom of each face, of shape (f + n,): of each triangle, then of each shape
            as a whole (the one face of a plane).
    """

    geoms: Numbers
    kinds: Numbers
    sizes: Matrix
    radii: Vector
    corners: Matrix
    triangles: Numbers
    normals: Matrix
    offsets: Vector
    mesh_ranges: Numbers
    owners: Numbers


class Lights(NamedTuple):
    """Colors and lights of a model, each color as red, green, blue from 0 to 1.

    Attributes:
        base: Color of each geom, the sky's in the last row, of shape (ngeom + 1, 3).
        ambient: Ambient light, of shape (3,).
        head: Head light, which shines from the eye, of shape (3,).
        active: Ids of the active lights, of shape (n,).
        distant: Whether they are directional, of shape (n,).
        diffuse: Their diffuse colors, of shape (n, 3).
    """

    base: Matrix
    ambient: Vector
    head: Vector
    active: Numbers
    distant: npt.NDArray[np.bool_]
    diffuse: Matrix


class Skins(NamedTuple):
    """Textures of geoms: images that repeat over their surfaces, projected from six sides.

    A point of the surface takes the axis of the texture's frame that is nearest to its normal, and
    the image along the two others, upright from the sides; from above as on a page with y up.

    Attributes:
        numbers: Number of the skin of each geom, -1 for none, of shape (ngeom,).
        geoms: Id of the geom of each skin, of shape (n,).
        tiles: Width and height of the image in the projections along x, y and z, (n, 6), m.
        turns: Rotations from the frames of the geoms to those of the textures, (n, 3, 3).
        shifts: Positions of the geoms' origins in the frames of the textures, of shape (n, 3), m.
        images: Index of the first texel, rows and columns of each image, of shape (n, 3).
        texels: Red, green and blue of the texels from the top left, of shape (t, 3), from 0 to 1.
    """

    numbers: Numbers
    geoms: Numbers
    tiles: Matrix
    turns: npt.NDArray[np.float64]
    shifts: Matrix
    images: Numbers
    texels: npt.NDArray[np.float32]


# One row per joint, of all arms.


# Encoders, of shape (n, ENCODERS).
RESOLUTION: Final = 0
"""Quantum of the positions, rad; 0 for none."""
OLD_WEIGHT: Final = 1
"""Weight of the previous velocity in the low-pass filter."""
NEW_WEIGHT: Final = 2
"""Weight of the new velocity in the low-pass filter."""
ENCODERS: Final = 3

# Readings, integers of shape (n, COUNTS).
WINDOW: Final = 0
"""Readings over which positions are differenced to a velocity; 0: the true velocity is read."""
COUNT: Final = 1
"""Number of readings so far, up to the window."""
COUNTS: Final = 2

# Friction, of shape (n, FRICTION).
COULOMB: Final = 0
"""Coulomb friction, N m."""
DROP: Final = 1
"""Static friction in excess of Coulomb friction, N m."""
NARROW: Final = 2
"""-1/v_s² with the Stribeck velocity v_s, s²/rad²."""
VISCOUS: Final = 3
"""Viscous friction, N m s/rad."""
RISE: Final = 4
"""Speed over which dry friction builds up, rad/s; 0 for a step."""
OFFSET: Final = 5
"""Offset of the speed in the sigmoid, rad/s."""
FRICTION: Final = 6

# Drives, of shape (n, DRIVES).
PER_STEP: Final = 0
"""Quanta per unit of torque, 1/(N m); 0 without quantization."""
GAIN: Final = 1
"""True torque of a quantum, N m, or factor of the torque without quantization."""
EFFORT: Final = 2
"""Effort limits, N m."""
COMMANDED: Final = 3
"""Commanded torques, quantized and with the gain error, N m."""
TORQUE: Final = 4
"""Applied torques, N m."""
WHOLE: Final = 5
"""Delay in whole physics steps."""
LATE: Final = 6
"""Remaining delay as a fraction of a step."""
SHARE: Final = 7
"""Weight of the commanded torque per step in the first-order lag."""
DRIVES: Final = 8

CREEP: Final = 1e-9
"""Speed in rad/s that is added before dividing by it: at rest the secant becomes the slope."""


# Drive of two fingers, of shape (DRIVE,). Widths are of the opening, forces of each finger.
STIFFNESS: Final = 0
"""Stiffness of the speed loop, N/m."""
DAMPING: Final = 1
"""Damping of the speed loop, N s/m."""
GRIP_GAIN: Final = 2
"""Factor of the applied force."""
MOST: Final = 3
"""Force limit of the motor, N."""
COMMANDED_WIDTH: Final = 4
"""Commanded opening, m; 0 closes."""
COMMANDED_SPEED: Final = 5
"""Commanded speed, m/s."""
COMMANDED_FORCE: Final = 6
"""Commanded force limit, N."""
REFERENCE: Final = 7
"""Reference of the speed loop: the opening that it tracks now, m."""
FORCE: Final = 8
"""Force by the drive's own model, without gain error, N; positive opens."""
DRIVE: Final = 9

WOUND_UP: Final = 1.2
"""Fraction of the commanded force up to which the speed loop winds up. Beyond 1, small motions of a
pressed finger do not change the force."""

SHUT: Final = -1.0
"""Target opening of a closing gripper, m: below 0, so that the fingers keep pressing."""

# Fingers, integers of shape (k, FINGER_NUMBERS): addresses in the plant, and rows of ring buffers.
Q_ADDRESS: Final = 0
"""Address of the position of the first finger; the second one is next to it. -1: not present."""
V_ADDRESS: Final = 1
"""Address of the speed of the first finger."""
MOTOR: Final = 2
"""Address of the motor, which moves both."""
NOISE_ROW: Final = 3
"""Row of the batch of noise for the next reading of the opening."""
NEWEST: Final = 4
"""Row of the latest reading of the opening."""
KEPT: Final = 5
"""Number of readings that are kept, up to all rows."""
PADS: Final = 6
"""Address of the force sensors of both pads; -1: it has none."""
PALM_BODY: Final = 7
"""Body of the palm."""
PADS_ROW: Final = 8
"""Row of the batch of noise for the next reading of the pads."""
FINGER_NUMBERS: Final = 9

# Readings of fingers, of shape (k, FINGER_READINGS).
WIDTH: Final = 0
"""Opening from the encoder, m."""
SPEED: Final = 1
"""Speed of the opening, positive when it opens, m/s."""
PRESSED: Final = 2
"""Force of a pad from the motor's current, positive when it closes, N."""
SENSED_S: Final = 3
"""Simulated time of the reading, s; -1: it is due."""
QUANTUM: Final = 4
"""Resolution of the opening, m; 0 for none."""
PADS_S: Final = 5
"""Simulated time of the reading of the pads, s; -1 before the first."""
PADS_PERIOD: Final = 6
"""Shortest time between two readings of the pads, s."""
FINGER_READINGS: Final = 7
