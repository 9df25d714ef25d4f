"""Attachments: which objects the arms hold, by a weld or by the gripper."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import mujoco

from bt_dualarm.core.pose import Pose
from bt_dualarm.core.share import weakly
from bt_dualarm.sim import composition


@dataclass(frozen=True, eq=False)
class Attachment:
    """An object held by an arm.

    Attributes:
        relative: Pose of the object in the arm's tool link when it was attached, by the arm's
            encoders, and by vision if the object was seen.
        since: Simulated time in seconds.
        was_seen: Whether that pose is estimated from vision, and not the true one.
        by_gripper: Whether a gripper holds the object instead of a weld: it is then only assumed
            to be held.
        most_force: Largest force of each pad, or of a cup, that the object withstands, N.
        lay: Estimated pose in the world at which the gripper picked the object.
        mass_declared: Whether the arm may use the declared mass; it may not for an object that it
            picked without its name.
    """

    arm: str
    object: str
    relative: Pose
    since: float
    was_seen: bool = False
    by_gripper: bool = False
    most_force: float = math.inf
    mass_declared: bool = True
    lay: Pose | None = None

    @property
    def name(self) -> str:
        """Name of the weld in the model."""
        return f"{self.arm}+{self.object}"


class Attachments:
    """The attachments of a world, each with its weld in the world's MjSpec.

    Args:
        spec: MjSpec of the world.
        recompile: Method of the world that compiles a changed spec.
        rebind: Method of the world that updates what depends on attachments, without compiling.
    """

    def __init__(
        self, spec: mujoco.MjSpec, recompile: Callable[[], None], rebind: Callable[[], None]
    ) -> None:
        self._spec = spec
        self._recompile = weakly(recompile)
        self._rebind = weakly(rebind)
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
        """Objects that the gripper is assumed to hold, in the order of picking."""
        return tuple(a for a in self._held.values() if a.arm == arm and a.by_gripper)

    def attach(
        self, new: Attachment, link: str, relative: Pose, tips: Sequence[str] = ()
    ) -> Attachment:
        """Weld an object to an arm's link; does nothing if it is held already.

        Args:
            new: The attachment.
            link: Name of the arm's tool link.
            relative: True pose of the object in that link.
            tips: Names of the fingers that hold it, whose contacts with it are ignored.

        Returns:
            The attachment of this arm and object, new or not.
        """
        held = self._held.get((new.arm, new.object))
        if held is not None:
            return held
        composition.add_weld(self._spec, new.name, link, new.object, relative, tips)
        self._held[new.arm, new.object] = new
        self._recompile()
        return new

    def hold(self, new: Attachment) -> None:
        """Assume that a gripper holds an object; replaces an earlier assumption about the pair.

        An object that is welded to the arm stays welded.
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
            composition.remove_weld(self._spec, held.name)
            self._recompile()
        return True

    def forget(self, name: str) -> None:
        """Remove every attachment of an arm or object that leaves the world, without compiling."""
        for key, held in list(self._held.items()):
            if name in key:
                if not held.by_gripper:
                    composition.remove_weld(self._spec, held.name)
                del self._held[key]
