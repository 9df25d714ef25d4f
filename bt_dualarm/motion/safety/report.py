"""What a guard has seen and done, for the summary of a run."""

from __future__ import annotations

from dataclasses import dataclass

from bt_dualarm.errors import Failure, Number


@dataclass
class GuardReport:
    """What a guard has seen and done; distances are of the arm while it moved.

    Attributes:
        nearest_arm_m: Smallest distance to another arm in m, infinite if never within reach.
        nearest_body_m: Smallest distance in m of a link to anything else, infinite if never near;
            what it stands on included.
        nearest_limit_rad: Smallest distance of a joint from its position limit in rad.
        worst_condition: Largest condition number of the Jacobian.
        fastest_share: Largest measured speed of a joint, as a share of the robot's limit.
        saturated: Number of set-points for which the joints' efforts did not suffice.
        slowed: Number of times that it made the arm go slower.
        stopped: Number of times that it stopped the arm.
        last_reason: Reason for the last of these.
    """

    nearest_arm_m: float = float("inf")
    nearest_body_m: float = float("inf")
    nearest_limit_rad: float = float("inf")
    worst_condition: float = 1.0
    fastest_share: float = 0.0
    saturated: int = 0
    slowed: int = 0
    stopped: int = 0
    last_reason: str = ""

    def as_dict(self) -> dict[str, Number]:
        """For the summary; what is infinite is left out."""
        return {name: value for name, value in vars(self).items() if value != float("inf")}

    def slow(self, reason: str) -> None:
        """The arm is made slower."""
        self.slowed += 1
        self.last_reason = reason

    def stop(self, reason: str) -> None:
        """The arm is stopped."""
        self.stopped += 1
        self.last_reason = reason

    def given_up(self, failure: Failure) -> Failure:
        """The motion is given up; returns why."""
        self.stop(failure.reason)
        return failure
