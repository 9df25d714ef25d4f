"""The cell: signals, rendezvous and claims by which the trees of a file coordinate their arms.

All trees that are due are ticked in one physics step, one after the other. What they do to the
cell in that step takes effect together, after the last of them (`CellState.commit`), so that the
outcome does not depend on the order in which the arms are listed: a value that is written, an
arrival, a claim or a release is visible to every tree from its next tick on. Conflicts within one
step are decided by the names of the arms.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Protocol

from bt_dualarm.core.errors import Failure
from bt_dualarm.spec.cell import CellSpec
from bt_dualarm.spec.yaml_reader import Data

KEPT_VALUES: Final = 1000
"""Values of a signal that are kept for arms that await every one."""


@dataclass(frozen=True)
class ActiveNode:
    """A running node without running children.

    Attributes:
        path: Path in its arm's tree.
        may_be_halted: Whether a node above it may halt it, whatever it does itself: a timeout, a
            condition that is asked again, a parallel with other children.
    """

    path: str
    may_be_halted: bool


class CellTree(Protocol):
    """An arm's tree, as the search for deadlocks sees it."""

    def active(self) -> Iterable[ActiveNode]:
        """Yields the running nodes without running children."""


@dataclass(eq=False)
class CellWait:
    """A node that waits for other arms.

    Attributes:
        arm: Arm whose tree waits.
        path: Path of the node.
        since: Simulated time in seconds at which it began to wait.
        target: What it waits at or for: ``rendezvous handover``, ``signal ready``, ``zone bin``.
        has_timeout: Whether it ends by itself.
        failure: Failure that ends it, None if there is none.
        seen: Number of values of a signal that it has looked at.
        others: Arms that it depended on after the last step; within a step that would depend on
            which of the trees have been ticked already.
    """

    arm: str
    path: str
    since: float
    target: str
    has_timeout: bool
    failure: Failure | None = None
    seen: int = 0
    others: tuple[str, ...] = ()


@dataclass(eq=False)
class Attendance(CellWait):
    """One participant's wait at a rendezvous."""

    has_met: bool = False


@dataclass(eq=False)
class Request(CellWait):
    """A claim, which waits until it is granted."""

    resources: tuple[str, ...] = ()
    granted_s: float | None = None


@dataclass
class _Signal:
    """Values of one signal; ``count`` is the number of values written so far."""

    value: Data
    count: int = 0
    kept: deque[Data] = field(default_factory=lambda: deque(maxlen=KEPT_VALUES))


def waiting_sentence(target: str, others: Sequence[str], since: float) -> str:
    """Returns a clause on a wait: ``waits at 'handover' for arm2 since 1.20 s``.

    Args:
        target: Target of the wait.
        others: Names of the arms that it depends on.
        since: Simulated time in seconds at which it began.
    """
    kind, _, name = target.partition(" ")
    listed = " and ".join(others)
    if kind == "rendezvous":
        return f"waits at '{name}' for {listed or 'the next tick'} since {since:.2f} s"
    if kind == "signal":
        return f"waits for signal '{name}' of {listed} since {since:.2f} s"
    held = f", claimed by {listed}," if others else ""
    return f"waits for {target}{held} since {since:.2f} s"


class CellState:
    """State that the trees of one run share.

    Args:
        spec: Declarations of the file.
        clock: Simulated time in seconds.

    Attributes:
        on_wait: Receiver of every new wait, and of those that depend on other arms than before.
    """

    def __init__(self, spec: CellSpec, clock: Callable[[], float]) -> None:
        self.spec = spec
        self.clock = clock
        self.on_wait: Callable[[CellWait], object] = lambda _: None
        self._signals = {name: _Signal(signal.initial) for name, signal in spec.signals.items()}
        self._written: list[tuple[str, str, Data]] = []
        self._attending: dict[str, list[Attendance]] = {name: [] for name in spec.rendezvous}
        self._left: dict[str, list[tuple[str, str]]] = {}
        self._requests: list[Request] = []
        self._asked: list[Request] = []
        self._waits: dict[tuple[str, str], CellWait] = {}
        self._gone: dict[str, str] = {}
        self._is_changed = False

    # What nodes do in a tick

    def written(self, name: str) -> int:
        """Returns how often a signal was written, as far as that is visible."""
        return self._signals[name].count

    def value(self, name: str) -> tuple[Data, bool]:
        """Returns the latest visible value of a signal, and whether there is one."""
        signal = self._signals[name]
        return signal.value, signal.count > 0 or self.spec.signals[name].initial is not None

    def values_since(self, name: str, count: int) -> tuple[list[Data], int]:
        """Returns the values after the first ``count``, and how many of them are lost."""
        signal = self._signals[name]
        new = signal.count - count
        kept = [*signal.kept][-new:] if new else []
        return kept, new - len(kept)

    def write(self, arm: str, name: str, value: Data) -> None:
        """Write a signal; visible from the next tick of each reader on."""
        self._written.append((arm, name, value))

    def arrive(self, arm: str, path: str, name: str, *, has_timeout: bool) -> Attendance:
        """Wait at a rendezvous until all participants do."""
        target = f"rendezvous {name}"
        attendance = Attendance(arm, path, self.clock(), target, has_timeout)
        self._attending[name].append(attendance)
        self._begin(attendance)
        return attendance

    def leave(self, attendance: Attendance, why: str) -> None:
        """End a wait at a rendezvous; if it has not taken place, the others' waits fail."""
        self.end(attendance)
        name = attendance.target.partition(" ")[2]
        if attendance in self._attending[name]:
            self._attending[name].remove(attendance)
            self._left.setdefault(name, []).append((attendance.arm, why))

    def claim(self, arm: str, path: str, resources: Sequence[str], *, has_timeout: bool) -> Request:
        """Ask for everything that a claim names; granted together, first come, first served."""
        target = " and ".join(resources)
        request = Request(arm, path, self.clock(), target, has_timeout)
        request.resources = tuple(resources)
        self._asked.append(request)
        self._begin(request)
        return request

    def release(self, request: Request) -> None:
        """Give up a claim, granted or not."""
        self.end(request)
        for requests in (self._requests, self._asked):
            if request in requests:
                requests.remove(request)
        self._is_changed = True

    def await_signal(self, arm: str, path: str, name: str, *, has_timeout: bool) -> CellWait:
        """Begin to wait for a signal."""
        wait = CellWait(arm, path, self.clock(), f"signal {name}", has_timeout)
        self._begin(wait)
        return wait

    def looked(self, wait: CellWait, count: int) -> None:
        """Note that a wait has looked at the first ``count`` values of its signal."""
        if wait.seen != count:
            wait.seen = count
            self._is_changed = True

    def note_change(self) -> None:
        """Note that a node's status has changed: a search for deadlocks may find other results."""
        self._is_changed = True

    # What the run does

    def arm_gone(self, arm: str, why: str) -> None:
        """Note that an arm's tree has ended, or that the arm was removed: ``its tree ended …``."""
        self._gone[arm] = why
        self._is_changed = True

    def arm_back(self, arm: str) -> None:
        """Note that an arm was spawned, with its tree at the beginning."""
        self._gone.pop(arm, None)
        self._is_changed = True

    def commit(self, trees: Mapping[str, CellTree]) -> None:
        """Let everything of this step's ticks take effect.

        Args:
            trees: Running trees by the arm's name.
        """
        if self._written:
            self._commit_values()
        if self._left or self._is_changed:
            self._commit_meetings()
        if self._asked or (self._is_changed and self._requests):
            self._commit_claims()
        if self._is_changed and self._waits:
            for wait in self.waits():
                others = self.waited_for(wait)
                if others != wait.others:
                    wait.others = others
                    self.on_wait(wait)
            self._find_deadlock(trees)
        self._is_changed = False

    def waiting(self, arm: str, path: str) -> str:
        """Returns a sentence on what a node waits for; empty if it waits for nothing."""
        wait = self._waits.get((arm, path))
        return "" if wait is None else self._sentence(wait)

    def waits(self) -> tuple[CellWait, ...]:
        """Returns all current waits, by the time of their start."""
        return tuple(sorted(self._waits.values(), key=lambda one: (one.since, one.arm, one.path)))

    def claims(self) -> tuple[Request, ...]:
        """Returns all claims, granted or waiting, in the order in which they are served."""
        return tuple(self._requests)

    def waited_for(self, wait: CellWait) -> tuple[str, ...]:
        """Returns the names of the arms that a wait depends on."""
        kind, _, name = wait.target.partition(" ")
        if isinstance(wait, Request):
            return tuple(sorted({holder.arm for holder in self._in_front_of(wait)}))
        if kind == "rendezvous":
            there = {one.arm for one in self._attending[name]}
            return tuple(arm for arm in self.spec.rendezvous[name] if arm not in there)
        return self.spec.signals[name].written_by

    def _begin(self, wait: CellWait) -> None:
        self._waits[wait.arm, wait.path] = wait
        self._is_changed = True

    def end(self, wait: CellWait) -> None:
        """End a wait; no effect on one that has ended."""
        if self._waits.get((wait.arm, wait.path)) is wait:
            del self._waits[wait.arm, wait.path]
            self._is_changed = True

    def _commit_values(self) -> None:
        # By the names of the arms, so that of two values in one step the same one is the latest.
        for _, name, value in sorted(self._written, key=lambda one: one[0]):
            signal = self._signals[name]
            signal.value = value
            signal.count += 1
            signal.kept.append(value)
        self._written.clear()

    def _commit_meetings(self) -> None:
        for name, participants in self.spec.rendezvous.items():
            there = self._attending[name]
            left = sorted(self._left.get(name, ()))
            present = {one.arm for one in there}
            if left:
                arm, why = left[0]
                self._break_up(name, f"{arm} {why}")
            elif present.issuperset(participants):
                for one in there:
                    one.has_met = True
                    self.end(one)
                there.clear()
            elif present:
                gone = [arm for arm in participants if arm in self._gone and arm not in present]
                if gone:
                    self._break_up(name, f"{gone[0]} {self._gone[gone[0]]}")
        self._left.clear()

    def _break_up(self, name: str, why: str) -> None:
        """Fail all waits at a rendezvous."""
        for one in self._attending[name]:
            waited = self.clock() - one.since
            one.failure = Failure(
                "PARTNER_GONE", f"{why}; '{name}' had been waited for {waited:.2f} s"
            )
            self.end(one)
        self._attending[name].clear()

    def _commit_claims(self) -> None:
        # First come, first served; nobody overtakes one in front that wants any of the same, so
        # nobody starves. Arms that ask in one step are served by their names.
        self._asked.sort(key=lambda one: (one.arm, one.path))
        self._requests += self._asked
        self._asked.clear()
        taken: set[str] = set()
        for request in self._requests:
            if request.granted_s is not None:
                taken.update(request.resources)
        for request in self._requests:
            if request.granted_s is None:
                if taken.isdisjoint(request.resources):
                    request.granted_s = self.clock()
                    self.end(request)
                taken.update(request.resources)

    def _in_front_of(self, request: Request) -> list[Request]:
        """Returns the claims that one waits for: those granted, and those that came before it."""
        found = []
        is_before = True
        for other in self._requests:
            is_before = is_before and other is not request
            shares = not set(other.resources).isdisjoint(request.resources)
            if other is not request and shares and (is_before or other.granted_s is not None):
                found.append(other)
        return found

    def _sentence(self, wait: CellWait) -> str:
        return waiting_sentence(wait.target, self.waited_for(wait), wait.since)

    # Deadlocks

    def _find_deadlock(self, trees: Mapping[str, CellTree]) -> None:
        """Fail one of the arms that wait for each other, if there are such.

        An arm can go on if any of its active nodes can: one that waits for no other arm, one that
        is going to be halted or to end by itself, or one that waits for arms that can go on. The
        others wait for good. Of these, the one that began to wait last fails, which lets the rest
        go on; its tree may try again.
        """
        active = {arm: tuple(tree.active()) for arm, tree in trees.items()}
        live: set[str] = set()
        while True:
            can_go_on = {
                arm
                for arm, nodes in active.items()
                if arm not in live
                and (not nodes or any(self._can_go_on(arm, node, live, active) for node in nodes))
            }
            if not can_go_on:
                break
            live |= can_go_on
        stuck = [wait for wait in self.waits() if wait.arm in active and wait.arm not in live]
        if not stuck:
            return
        hopeless = [wait for wait in stuck if not set(self.waited_for(wait)) & set(active)]
        if hopeless:  # they wait for arms that have ended, and for nobody else
            for wait in hopeless:
                why = "; ".join(
                    f"{arm} {self._gone.get(arm, 'was never spawned')}"
                    for arm in self.waited_for(wait)
                )
                wait.failure = Failure("PARTNER_GONE", f"{self._sentence(wait)}: {why}")
            return
        last = max(stuck, key=lambda one: (one.since, one.arm, one.path))
        members = "; ".join(f"{one.arm} {self._sentence(one)}" for one in stuck)
        last.failure = Failure(
            "DEADLOCK",
            f"these arms wait for each other for good: {members}; {last.arm} gives way, as it "
            "began to wait last",
        )

    def _can_go_on(
        self,
        arm: str,
        node: ActiveNode,
        live: set[str],
        active: Mapping[str, Sequence[ActiveNode]],
    ) -> bool:
        wait = self._waits.get((arm, node.path))
        if wait is None or wait.has_timeout or wait.failure is not None or node.may_be_halted:
            return True
        kind, _, name = wait.target.partition(" ")
        if kind == "signal" and self._signals[name].count != wait.seen:
            return True  # it looks at a new value in its next tick
        others = self.waited_for(wait)
        if not others:
            return True
        # An arm that was never in the world may be spawned by any other one that can go on.
        may_come = [
            other in live or (other not in active and other not in self._gone and bool(live))
            for other in others
        ]
        return any(may_come) if kind == "signal" else all(may_come)


@dataclass
class CellAccess:
    """A cell as the nodes of one arm use it.

    Attributes:
        shared: The cell.
        arm: Name of the arm.
        taken: Number of values of each signal that the arm has taken one by one.
    """

    shared: CellState
    arm: str
    taken: dict[str, int] = field(default_factory=dict)

    @classmethod
    def alone(cls) -> CellAccess:
        """Returns the access to a cell without signals, zones or rendezvous."""
        return cls(CellState(CellSpec(), lambda: 0.0), "")
