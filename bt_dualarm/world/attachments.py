"""Attachments: welds between an arm's tool and objects, one a pair, as many as wanted."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import mujoco

from bt_dualarm.pose import Pose
from bt_dualarm.world import welds
from bt_dualarm.world.weak_callback import weakly


@dataclass(frozen=True, eq=False)
class Attachment:
    """An object held by an arm.

    Attributes:
        relative: Pose of the object in the arm's tool link at the moment of attaching, by the
            arm's encoders; of one that was seen, by where it was seen.
        since: Simulated time in seconds.
        was_seen: Whether that pose is by sight, and not the true one.
        by_gripper: Whether fingers or a cup hold it, and no weld: then it is only believed.
        most_force: Force of each pad, or of a cup, that it may be held with at most, N.
        lay: Pose in the world at which fingers or a cup were believed to take it.
        is_told: Whether the file tells its mass, where arms are told any: it was taken by name.
    """

    arm: str
    object: str
    relative: Pose
    since: float
    was_seen: bool = False
    by_gripper: bool = False
    most_force: float = math.inf
    is_told: bool = True
    lay: Pose | None = None

    @property
    def name(self) -> str:
        """Name of the weld in the model."""
        return f"{self.arm}+{self.object}"


class Attachments:
    """The registry of a world's attachments.

    Args:
        spec: MjSpec of the world.
        recompile: Method of the world that takes up a change of the spec.
        rebind: Method of the world that takes up a change of what is held, and of nothing else.
    """

    def __init__(
        self, spec: mujoco.MjSpec, recompile: Callable[[], None], rebind: Callable[[], None]
    ) -> None:
        self._spec = spec
        self._recompile, self._rebind = weakly(recompile), weakly(rebind)
        self._held: dict[tuple[str, str], Attachment] = {}

    def __iter__(self) -> Iterator[Attachment]:
        return iter(self._held.values())

    def __len__(self) -> int:
        return len(self._held)

    def attached_to(self, arm: str) -> tuple[str, ...]:
        """Objects that the arm holds, in the order in which they were attached."""
        return tuple(a.object for a in self._held.values() if a.arm == arm)

    def find(self, arm: str, thing: str) -> Attachment | None:
        """The attachment of this pair, if there is one."""
        return self._held.get((arm, thing))

    def gripped_by(self, arm: str) -> tuple[Attachment, ...]:
        """What the arm's fingers or cup are believed to hold, the first that was taken first."""
        return tuple(a for a in self._held.values() if a.arm == arm and a.by_gripper)

    def attach(self, new: Attachment, link: str, relative: Pose) -> Attachment:
        """Weld an object to an arm's link; a second time changes nothing.

        Args:
            new: What is to be held.
            link: Name of the arm's tool link.
            relative: Pose of the object in it, as it truly is.
        """
        held = self._held.get((new.arm, new.object))
        if held is not None:
            return held
        welds.add_weld(self._spec, new.name, link, new.object, relative)
        self._held[new.arm, new.object] = new
        self._recompile()
        return new

    def hold(self, new: Attachment) -> None:
        """Believe that a gripper holds an object; what was believed of the pair is replaced.

        What is welded to the arm stays so: nothing holds more firmly.
        """
        held = self._held.get((new.arm, new.object))
        if held is not None and not held.by_gripper:
            return
        self._held[new.arm, new.object] = new
        self._rebind()

    def detach(self, arm: str, thing: str) -> bool:
        """Release an object; returns whether it was held."""
        held = self._held.pop((arm, thing), None)
        if held is None:
            return False
        if held.by_gripper:
            self._rebind()
        else:
            welds.remove_weld(self._spec, held.name)
            self._recompile()
        return True

    def forget(self, name: str) -> None:
        """Take away every weld of an arm or object that is about to leave (no recompilation)."""
        for key, held in list(self._held.items()):
            if name in key:
                if not held.by_gripper:
                    welds.remove_weld(self._spec, held.name)
                del self._held[key]
