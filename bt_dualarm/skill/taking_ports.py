"""Ports of skills that take something with a gripper."""

from __future__ import annotations

from bt_dualarm.arm.grip_limit import UNKNOWN_KG
from bt_dualarm.pose import Vector
from bt_dualarm.skill.directions import unit_vector
from bt_dualarm.spec.ports import PortModel, port
from bt_dualarm.spec.values import Speed, Vector3


class TakingPorts(PortModel):
    """How something is taken: ways, forces, and what the grip has to bear."""

    approach: Vector3 | None = port(
        None, "way of the straight approach, world axes, within 30°; by default the best one"
    )
    standoff: float = port(0.08, "length of the straight approach", unit="m", ge=0.01, le=0.3)
    lift: float = port(0.04, "height of the lift that tests the hold", unit="m", ge=0, le=0.5)
    force: float | None = port(
        None,
        "force of each pad, or of a cup; by default what the load asks for",
        unit="N",
        gt=0,
        le=5000,
    )
    most_force: float | None = port(
        None, "force of each pad, or of a cup, that the object bears", unit="N", gt=0, le=5000
    )
    mass: float | None = port(
        None, "mass to reckon with; by default what is known of it", unit="kg", gt=0, le=100
    )
    shake: float = port(
        8.0, "acceleration of the tool that the grip has to bear", unit="m/s²", ge=0, le=50
    )
    margin: float = port(1.5, "load that the grip has to bear", unit="times the load", ge=1, le=10)
    touch: float = port(40.0, "force that ends the approach", unit="N", ge=1, le=200)
    speed: Speed = port(0.5, "share of the arm's limits on the way there")
    approach_speed: Speed = port(0.15, "share of the arm's limits on the straight parts")

    @property
    def along(self) -> Vector | None:
        """Unit vector of the approach, of shape (3,), where one is given.

        Raises:
            Failure: ``INVALID_TARGET`` where it has no length.
        """
        return None if self.approach is None else unit_vector(self.approach)

    def mass_of(self, told: float | None) -> float:
        """Mass in kg to reckon with.

        Args:
            told: The mass that the arm is told, kg; None where it is not.
        """
        return self.mass or told or UNKNOWN_KG
