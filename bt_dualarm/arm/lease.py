"""The right to move an arm: one leaf has it at a time."""

from __future__ import annotations

import threading
from collections.abc import Callable

from bt_dualarm.errors import Failure, SkillError


class Lease:
    """Shared by all leaves of one arm; each of them has a `Leaseholder` of its own.

    Args:
        arm: Name of the arm.
        at_rest: Whether the arm stands still; then its lease is free to be taken over.
    """

    def __init__(self, arm: str, at_rest: Callable[[], bool]) -> None:
        self._arm = arm
        self._at_rest = at_rest
        self._holder: Leaseholder | None = None

    def for_leaf(self, leaf: str) -> Leaseholder:
        """A new holder, who has nothing yet; two of one name are two."""
        return Leaseholder(self, leaf)

    def is_held_by(self, holder: Leaseholder) -> bool:
        """Whether this one has it."""
        return self._holder is holder

    def refuse_others_than(self, holder: Leaseholder) -> None:
        """Look whether this one may move the arm.

        Raises:
            Failure: ``BUSY`` when another one has the lease and the arm is not at rest.
        """
        other = self._holder
        if other is not None and other is not holder and not self._at_rest():
            raise Failure("BUSY", f"{other.leaf} is moving {self._arm} already", owner=other.leaf)

    def take(self, holder: Leaseholder) -> None:
        """Give it to this one; again changes nothing.

        Raises:
            Failure: ``BUSY``, as `refuse_others_than`.
        """
        self.refuse_others_than(holder)
        self._holder = holder

    def give_back(self, holder: Leaseholder) -> bool:
        """Let it be free if this one has it; whether it had."""
        held = self.is_held_by(holder)
        if held:
            self._holder = None
        return held


class Leaseholder:
    """A leaf that may move the arm, as its lease sees it.

    Only the thread that ticks the leaf may drive the arm: what another one does comes at a moment
    that no seed decides.

    Args:
        lease: Lease of the arm.
        leaf: Path of the leaf in its tree, for sentences.

    Attributes:
        intrusion: Sentence on another thread that has tried, for the leaf to fail with.
    """

    def __init__(self, lease: Lease, leaf: str) -> None:
        self.leaf = leaf
        self.intrusion = ""
        self._lease = lease
        self._thread: int | None = None

    @property
    def has_it(self) -> bool:
        """Whether this leaf has the lease."""
        return self._lease.is_held_by(self)

    def enter(self, *, anew: bool) -> None:
        """Note that this thread ticks or halts the leaf.

        Args:
            anew: Whether a new run of the leaf begins, which has nothing to do with earlier ones.
        """
        self._thread = threading.get_ident()
        if anew:
            self.intrusion = ""

    def refuse_other_threads(self) -> None:
        """Look whether the thread that asks is the one that ticks the leaf.

        Raises:
            SkillError: Another one asks; the leaf will fail with it, too.
        """
        if self._thread not in (None, threading.get_ident()):
            self.intrusion = (
                f"{self.leaf} drives its arm from the thread {threading.current_thread().name!r}: "
                "a skill drives it in its own ticks only; let run() yield, and start no thread"
            )
            raise SkillError(self.intrusion)

    def refuse_if_busy(self) -> None:
        """Look whether this leaf may move the arm.

        Raises:
            Failure: ``BUSY`` when another leaf moves it.
            SkillError: The thread that asks is not the one that ticks the leaf.
        """
        self.refuse_other_threads()
        self._lease.refuse_others_than(self)

    def take(self) -> None:
        """Take the lease; again changes nothing.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm.
            SkillError: The thread that asks is not the one that ticks the leaf.
        """
        self.refuse_other_threads()
        self._lease.take(self)

    def give_back(self) -> bool:
        """Give the lease back; whether this leaf had it.

        Raises:
            SkillError: The thread that asks is not the one that ticks the leaf.
        """
        self.refuse_other_threads()
        return self._lease.give_back(self)
