"""Check whether the gripper holds something."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import Failure, ObjectName, PortModel, Skill, port


class Holding(Skill):
    """Check whether the gripper holds something, from its sensors: a condition for ``guard``."""

    class Ports(PortModel):
        object: ObjectName | None = port(None, "object that must be held; by default any")

    failures = {"NOT_HOLDING": "the gripper holds nothing, or not this object"}
    example = "holding"
    needs_gripper = True
    ports: Ports

    def run(self) -> Iterator[None]:
        """Check width and force, or the vacuum, once."""
        gripper = self.arm.gripper
        wanted = self.ports.object
        self.metrics["width_m"] = gripper.width
        self.metrics["force_n"] = gripper.force
        if not gripper.holding:
            raise Failure(
                "NOT_HOLDING",
                f"{gripper.description.name} holds nothing: {self._sensed()}",
                width_m=gripper.width,
                force_n=gripper.force,
            )
        # What a joint of an object moves is held under a name of its own: `door.hinge`.
        if wanted is not None and not any(
            held == wanted or self.arm.world.moves_on(held, wanted) for held in gripper.held
        ):
            known = ", ".join(gripper.held) or "an object that was not named when it was grasped"
            raise Failure("NOT_HOLDING", f"it holds {known}, not {wanted!r}")
        return
        yield  # makes this a generator, as every skill is one

    def _sensed(self) -> str:
        gripper = self.arm.gripper
        if not gripper.description.fingers:
            return f"its cup has {gripper.vacuum:.0%} of its vacuum"
        force = abs(gripper.force)
        return f"its fingers are {1e3 * gripper.width:.1f} mm apart and press with {force:.0f} N"
