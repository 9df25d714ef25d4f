"""One arm as its skills see it: where it is, how it moves, what it holds and sees."""

from __future__ import annotations

from bt_dualarm.arm_travel import ArmTravel


class Arm(ArmTravel):
    """Handed to every skill; what it can do stands in the classes that it is built on.

    `ArmState` says where it is and what it sees, `ArmMotion` moves it, `ArmPlanning` finds its
    motions, `ArmTravel` gets it past other arms. Only one leaf can move the arm at a time;
    ``release`` stops what this leaf has begun.
    """

    def attach(self, thing: str) -> None:
        """Weld an object to the tool as it lies now; again changes nothing."""
        self.world.attach(self.name, thing)

    def detach(self, thing: str) -> bool:
        """Let go of an object; whether it was held."""
        return self.world.attachments.detach(self.name, thing)
