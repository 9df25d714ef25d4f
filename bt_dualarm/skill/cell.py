"""The cell: signals, rendezvous and claims by which the trees of a file coordinate their arms.

All trees that are due are ticked in one physics step, one after the other. What they do to the
cell in that step takes effect together, after the last of them (`CellState.commit`), so that the
outcome does not depend on the order in which the arms are listed: a value that is written, an
arrival, a claim or a release is visible to every tree from its next tick on. Conflicts within one
step are decided by the names of the arms.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

from bt_dualarm.arm.traffic import BlockedArm, Traffic
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Vector
from bt_dualarm.spec.cell import CellSpec, CellZone
from bt_dualarm.spec.yaml_reader import Data

KEPT_VALUES: Final = 1000
"""Values of a signal that are kept for arms that await every one."""


@dataclass(frozen=True)
class ActiveNode:
    """A running node without running children.

    Attributes:
        path: Path in its arm's tree.
        may_be_halted: Whether a node above it may halt it, whatever it does itself: a timeout, a
            condition that is evaluated again, a parallel with other children.
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
        target: What it waits at or for: ``rendezvous handover``, ``signal ready``, ``zone bin``;
            ``path`` if other arms are in the way of a motion; ``tool arm2`` or ``partner arm2`` if
            it follows that arm's tool, or holds still for it.
        has_timeout: Whether it ends by itself.
        failure: Failure that ends it, None if there is none.
        seen: Number of values of a signal that it has looked at.
        others: Arms that it depended on after the last step; within a step that would depend on
            which of the trees have been ticked already.
        asides: How often its arm can still be asked to move aside while it waits.
        asked_by: Arm for which it is asked to do so now; empty if it is not.
        is_over: Whether it had ended after the last step, as far as `CellState.on_wait` knows.
    """

    arm: str
    path: str
    since: float
    target: str
    has_timeout: bool
    failure: Failure | None = None
    seen: int = 0
    others: tuple[str, ...] = ()
    asides: int = 0
    asked_by: str = ""
    is_over: bool = False


@dataclass(eq=False)
class Attendance(CellWait):
    """One participant's wait at a rendezvous.

    Attributes:
        has_met: Whether it has taken place.
        is_aside: Whether the arm has moved aside: it does not take place before it is back.
    """

    has_met: bool = False
    is_aside: bool = False


@dataclass(eq=False)
class Request(CellWait):
    """A claim, which waits until it is granted."""

    resources: tuple[str, ...] = ()
    granted_s: float | None = None


class JointAction:
    """Leaves of several arms that act together, and their messages to one another.

    A leaf's message becomes visible to the others in their next tick, so that the order in which
    trees are ticked does not matter.

    Args:
        members: Names of the arms.

    Attributes:
        changes: Number of steps in which a message was sent or an arm left.
        completed: Names of the arms that have completed their part.
    """

    def __init__(self, members: Sequence[str]) -> None:
        self.members = tuple(members)
        self._messages: dict[str, dict[str, Any]] = {arm: {} for arm in members}
        self._new: list[tuple[str, dict[str, Any]]] = []
        self._left: dict[str, str] = {}
        self.changes = 0
        self.completed: set[str] = set()

    def send(self, arm: str, facts: Mapping[str, Any]) -> None:  # Any: facts of the skills
        """Send facts to the others, by name; visible from their next tick on."""
        self._new.append((arm, dict(facts)))

    def messages(self, arm: str) -> Mapping[str, Any]:  # Any: as in `send`
        """Returns the visible messages of an arm so far, by name."""
        return self._messages[arm]

    @property
    def left(self) -> Mapping[str, str]:
        """Why each arm that takes part no longer has left, as a clause: ``was halted``."""
        return self._left

    def commit(self, left: Mapping[str, str]) -> None:
        """Make the messages of this step visible, and which arms have left in it."""
        self.changes += bool(self._new or left)
        for arm, facts in self._new:
            self._messages[arm].update(facts)
        self._new.clear()
        for arm, why in left.items():
            self._left.setdefault(arm, why)


@dataclass(eq=False)
class Appointment(CellWait):
    """One arm's part in a joint action: at first a wait for the other members.

    Attributes:
        members: Names of all arms of the action.
        action: The action, None until all members have joined.
        awaited: Members that it waits for during the action; none while it acts itself.
        moves_aside: Whether it moves aside for members whose path it blocks while it waits.
        is_completed: Whether it ended before it began: all have completed an earlier action of
            these members, whose end this arm has missed, and they do not join it again.
    """

    members: tuple[str, ...] = ()
    action: JointAction | None = None
    awaited: tuple[str, ...] = ()
    moves_aside: bool = False
    is_completed: bool = False


@dataclass(eq=False)
class Obstruction(CellWait):
    """A motion that waits for other arms to leave its path.

    Which arms are in its way is known from its last try; ``confirmed_by`` is the number of the try
    that decides whether they still are when nothing else can continue. ``why`` is what that try
    met, as a clause. ``has_other_path`` is that of `BlockedArm`.
    """

    blockers: frozenset[str] = frozenset()
    has_other_path: bool = True
    tries: int = 0
    why: str = ""
    confirmed_by: int | None = None


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
    if kind == "motion":
        return f"waits for the next motion of {listed} since {since:.2f} s"
    if kind == "tool":
        return f"follows the tool of {listed} since {since:.2f} s"
    if kind == "partner":
        return f"holds still for {listed} since {since:.2f} s"
    if kind == "joint":
        return f"waits for {listed or 'the next tick'} in {name} since {since:.2f} s"
    if kind == "path":
        return f"waits for {listed} to leave its path since {since:.2f} s" if others else ""
    held = f", claimed by {listed}," if others else ""
    return f"waits for {target}{held} since {since:.2f} s"


@dataclass(frozen=True, eq=False)
class Return:
    """Return that an arm that has made room is still to make.

    Attributes:
        place: Configuration of shape (dof,), rad, in which it has begun to wait.
        made_room_for: Name of the arm for which it has moved aside.
    """

    place: Vector
    made_room_for: str


class CellState:
    """State that the trees of one run share.

    Args:
        spec: Declarations of the file.
        clock: Simulated time in seconds.
        traffic: Arms that others are in the way of; none if left out.

    Attributes:
        on_wait: Receiver of every new wait, of those that depend on other arms than before, and of
            those that have ended.
        returning: Names of the arms that return to where they have waited, but need not. Of arms
            that wait for each other, they give up first.
        unreturned: Returns that are still to be made, by arm: others stay where it has waited.
    """

    def __init__(
        self, spec: CellSpec, clock: Callable[[], float], traffic: Traffic | None = None
    ) -> None:
        self.spec = spec
        self.clock = clock
        self.traffic = traffic or Traffic(clock)
        self.returning: set[str] = set()
        self.unreturned: dict[str, Return] = {}
        self._obstructed: dict[str, Obstruction] = {}
        self._in_step: dict[str, CellWait] = {}
        self.on_wait: Callable[[CellWait], object] = lambda _: None
        self._signals = {name: _Signal(signal.initial) for name, signal in spec.signals.items()}
        self._written: list[tuple[str, str, Data]] = []
        self._attending: dict[str, list[Attendance]] = {name: [] for name in spec.rendezvous}
        self._left: dict[str, list[tuple[str, str]]] = {}
        self._appointments: list[Appointment] = []
        self._parted: list[tuple[Appointment, str]] = []
        self._missed: list[tuple[str, str, JointAction]] = []
        self._requests: list[Request] = []
        self._asked: list[Request] = []
        self._waits: dict[tuple[str, str], CellWait] = {}
        self._noted: dict[tuple[str, str], tuple[CellWait, float]] = {}
        self._gone: dict[str, str] = {}
        self._ended: frozenset[str] = frozenset()
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

    def is_awaited(self, attendance: Attendance) -> bool:
        """Whether all other participants wait at the rendezvous of an arm."""
        name = attendance.target.partition(" ")[2]
        there = {one.arm for one in self._attending[name] if not one.is_aside}
        return there | {attendance.arm} >= set(self.spec.rendezvous[name])

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

    def join(self, arm: str, path: str, label: str, members: Sequence[str]) -> Appointment:
        """Join a joint action, which begins when all members have joined.

        Args:
            arm: Name of the arm.
            path: Path of the node in its tree.
            label: Displayed name of the action, the same for all members: ``the handover of 'cube'
                from arm1 to arm2``.
            members: Names of all arms of the action, in the same order for all of them.
        """
        one = Appointment(arm, path, self.clock(), f"joint {label}", has_timeout=False)
        one.members = tuple(members)
        self._appointments.append(one)
        self._begin(one)
        return one

    def await_members(self, one: Appointment, awaited: Sequence[str]) -> None:
        """Record the members for which an arm waits during a joint action; none while it acts."""
        if one.action is not None:
            self.looked(one, one.action.changes)
        if one.awaited == tuple(awaited):
            return
        one.awaited = tuple(awaited)
        if awaited:
            one.since = self.clock()
            self._begin(one)
        else:
            self.end(one)

    def part(self, one: Appointment, why: str) -> None:
        """Leave a joint action, begun or not; the other members learn why in their next tick."""
        self.end(one)
        self._parted.append((one, why))

    def miss_end(self, one: Appointment) -> None:
        """Record that an arm leaves an action without its end, although its part is complete."""
        if one.action is not None:
            self._missed.append((one.arm, one.target, one.action))

    def await_signal(self, arm: str, path: str, name: str, *, has_timeout: bool) -> CellWait:
        """Begin to wait for a signal."""
        wait = CellWait(arm, path, self.clock(), f"signal {name}", has_timeout)
        self._begin(wait)
        return wait

    def depend(self, arm: str, path: str, target: str, *, has_timeout: bool) -> CellWait:
        """Begin to depend on another arm, until `end`.

        Args:
            arm: Name of the arm that depends on it.
            path: Path of its node.
            target: ``tool arm2`` if it follows that arm's tool, ``partner arm2`` if it holds still
                for that arm.
            has_timeout: Whether it ends by itself.
        """
        wait = CellWait(arm, path, self.clock(), target, has_timeout)
        self._begin(wait)
        return wait

    def has_ended(self, arm: str) -> bool:
        """Whether the tree of an arm has ended, or the arm was removed, as far as visible."""
        return arm in self._ended

    def looked(self, wait: CellWait, count: int) -> None:
        """Record that a wait has looked at the first ``count`` values of its signal."""
        if wait.seen != count:
            wait.seen = count
            self._is_changed = True

    def note_change(self) -> None:
        """Record that a node's status has changed: a deadlock search may have other results."""
        self._is_changed = True

    # What the run does

    def arm_gone(self, arm: str, why: str) -> None:
        """Record that an arm's tree has ended, or the arm was removed: ``its tree ended …``."""
        self._gone[arm] = why
        self._is_changed = True

    def arm_back(self, arm: str) -> None:
        """Record that an arm was spawned, with its tree at the beginning."""
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
        if self._appointments:
            self._commit_appointments()
        if self._asked or (self._is_changed and self._requests):
            self._commit_claims()
        if self._is_changed:
            self._refuse_signals_without_writers()
        self._note_obstructions(self.traffic.blocked)
        if self.traffic.waiting_motions or self._in_step:
            self.traffic.start_motions()
            self._note_waiting_motions()
        if self._is_changed:
            self._note_waits()
            if self._waits:
                self._find_deadlock(trees)
        self._ended = frozenset(self._gone)
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
        if isinstance(wait, Obstruction):
            return tuple(sorted(wait.blockers))
        kind, _, name = wait.target.partition(" ")
        if kind in ("tool", "motion", "partner"):
            return (name,)
        if isinstance(wait, Appointment):
            if wait.action is not None:
                return wait.awaited
            present = {one.arm for one in self._with(wait)}
            return tuple(arm for arm in wait.members if arm not in present)
        if isinstance(wait, Request):
            return tuple(sorted({holder.arm for holder in self._in_front_of(wait)}))
        if kind == "rendezvous":
            there = {one.arm for one in self._attending[name] if not one.is_aside} | {wait.arm}
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

    def _note_waits(self) -> None:
        """Pass on which waits have ended, and which depend on other arms than before."""
        for key, (wait, _) in [*self._noted.items()]:
            if self._waits.get(key) is not wait:
                del self._noted[key]
                wait.others = ()
                if wait.failure is None:  # otherwise it is what the node waited for when it failed
                    wait.is_over = True
                    self.on_wait(wait)
        for wait in self.waits():
            key = wait.arm, wait.path
            others = self.waited_for(wait)
            has_begun_anew = key in self._noted and self._noted[key][1] != wait.since
            if others != wait.others or has_begun_anew:
                wait.others = others
                wait.is_over = False
                self._noted[key] = wait, wait.since
                self.on_wait(wait)

    def _note_obstructions(self, blocked: Iterable[BlockedArm]) -> None:
        """Store which arms are in the way of which."""
        now = {one.arm: one for one in blocked}
        for arm, wait in [*self._obstructed.items()]:
            if arm not in now or now[arm].path != wait.path:
                del self._obstructed[arm]
                self.end(wait)
        for arm, one in now.items():
            known = self._obstructed.get(arm)
            if known is None:
                known = Obstruction(arm, one.path, one.since, "path", has_timeout=False)
                self._obstructed[arm] = known
                self._begin(known)
            if known.tries != one.tries:
                known.tries = one.tries
                known.has_other_path = one.has_other_path
                known.why = one.why
                if known.failure is not None:  # it has got its failure, and tries another path
                    known.confirmed_by = None
                    known.failure = None
                self._is_changed = True
            if known.blockers != one.blockers:
                known.blockers = one.blockers
                known.confirmed_by = None
                known.failure = None
                self._is_changed = True

    def _note_waiting_motions(self) -> None:
        """Store which motions wait for the next motion of another arm."""
        now = {(one.arm, one.path): one for one in self.traffic.waiting_motions}
        for arm, wait in [*self._in_step.items()]:
            one = now.get((arm, wait.path))
            if one is None or one.since != wait.since:
                del self._in_step[arm]
                self.end(wait)
        for (arm, path), one in now.items():
            if arm not in self._in_step:
                wait = CellWait(arm, path, one.since, f"motion {one.other}", has_timeout=False)
                self._in_step[arm] = wait
                self._begin(wait)

    def step_failure(self, arm: str) -> Failure | None:
        """Why the motion of an arm waits forever for that of another one; None if it does not."""
        return self._in_step[arm].failure if arm in self._in_step else None

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
            elif present.issuperset(participants) and not any(one.is_aside for one in there):
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

    def _with(self, one: Appointment) -> list[Appointment]:
        """Returns the appointments for an action that has not begun, by the order of members."""
        coming = [
            other
            for other in self._appointments
            if other.action is None
            and other.failure is None
            and (other.target, other.members) == (one.target, one.members)
        ]
        return sorted(coming, key=lambda other: one.members.index(other.arm))

    def _commit_appointments(self) -> None:
        left: dict[JointAction, dict[str, str]] = {}
        for one, why in self._parted:
            self._appointments.remove(one)
            if one.action is not None:
                gone = self._gone.get(one.arm, "")
                left.setdefault(one.action, {})[one.arm] = gone if "removed" in gone else why
        self._parted.clear()
        for action in {id(one.action): one.action for one in self._appointments}.values():
            if action is not None:
                before = action.changes
                action.commit(left.get(action, {}))
                self._is_changed = self._is_changed or action.changes != before
        for one in self._appointments:
            if one.action is not None or one.failure is not None:
                continue
            coming = self._with(one)
            if {other.arm for other in coming} == set(one.members):
                action = JointAction(one.members)
                for other in coming:
                    other.action = action
                    self.end(other)
                continue
            missing = [arm for arm in self.waited_for(one) if arm in self._gone]
            if missing and not self._completes(one):
                one.failure = Failure(
                    "PARTNER_GONE", f"{self._sentence(one)}: {missing[0]} {self._gone[missing[0]]}"
                )
                self.end(one)

    def _completes(self, wait: CellWait) -> bool:
        """End a wait for members that do not come, if its arm has missed the end of an action.

        A leaf that is halted when its part is complete, while the others end theirs, begins anew in
        vain. It waits first, as the others may begin another action.

        Returns:
            Whether it has ended.
        """
        if not isinstance(wait, Appointment) or wait.action is not None:
            return False
        for missed in self._missed:
            arm, target, action = missed
            if (arm, target) == (wait.arm, wait.target) and action.completed == {*action.members}:
                self._missed.remove(missed)
                wait.is_completed = True
                self.end(wait)
                return True
        return False

    def _commit_claims(self) -> None:
        # First come, first served: no arm overtakes an earlier one that requests any of the same,
        # so none starves. Arms that ask in one step are served by their names.
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

    def _refuse_signals_without_writers(self) -> None:
        """Fail waits for signals whose writers have all ended, also those that have a timeout."""
        for wait in self.waits():
            kind, _, name = wait.target.partition(" ")
            if kind != "signal" or wait.failure is not None:
                continue
            is_new = self._signals[name].count != wait.seen  # it will see that in its next tick
            if not is_new and all(arm in self._gone for arm in self.waited_for(wait)):
                wait.failure = self._partner_gone(wait)

    def _partner_gone(self, wait: CellWait) -> Failure:
        why = "; ".join(
            f"{arm} {self._gone.get(arm, 'was never spawned')}" for arm in self.waited_for(wait)
        )
        return Failure("PARTNER_GONE", f"{self._sentence(wait)}: {why}")

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

        An arm can continue if any of its active nodes can: one that waits for no other arm, one
        that is going to be halted or to end by itself, or one that waits for arms that can
        continue. The others wait forever. Of these, the one that began to wait last fails, which
        lets the rest continue; its tree may try again.
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
        doubtful = []
        for blocked in self._obstructed.values():
            if blocked not in stuck:
                blocked.confirmed_by = None
            elif blocked.confirmed_by is None or blocked.tries < blocked.confirmed_by:
                blocked.confirmed_by = blocked.confirmed_by or blocked.tries + 1
                doubtful.append(blocked.arm)
        for arm in doubtful:
            self.traffic.look_again(arm)
        if doubtful or not stuck:
            return
        if self._ask_to_make_room(stuck, active):
            return
        self._refuse(stuck, active)
        for wait in stuck:
            if isinstance(wait, Obstruction) and wait.failure is not None:
                self.traffic.refuse(wait.arm, wait.failure)

    def _ask_to_make_room(
        self, stuck: Sequence[CellWait], active: Mapping[str, Sequence[ActiveNode]]
    ) -> bool:
        """Ask an arm that only waits to move out of the path of one that it waits for.

        Returns:
            Whether there is one that was not asked too often.
        """
        for blocked in stuck:
            if not isinstance(blocked, Obstruction):
                continue
            for wait in stuck:
                only_waits = len(active[wait.arm]) == 1
                if wait.arm in blocked.blockers and wait.asides > 0 and only_waits:
                    wait.asides -= 1
                    wait.asked_by = blocked.arm
                    return True
        return False

    def made_room(self, wait: CellWait, *, moved: bool) -> None:
        """Record that an arm has moved aside, or cannot; the blocked one looks again at once.

        Args:
            wait: Wait of the arm that was asked.
            moved: Whether it has moved.
        """
        blocked = self._obstructed.get(wait.asked_by)
        if blocked is not None and moved:
            blocked.confirmed_by = None
        wait.asked_by = ""
        if not moved:
            wait.asides = 0
        self._is_changed = True

    def resume(self, wait: CellWait) -> None:
        """Begin a wait again whose node has shown another one meanwhile, as of a motion."""
        if wait.failure is None:
            self._begin(wait)

    def _refuse(self, stuck: Sequence[CellWait], active: Collection[str]) -> None:
        """Fail some of the waits that cannot end otherwise."""
        if any(self._completes(wait) for wait in stuck):
            return
        hopeless = [wait for wait in stuck if not set(self.waited_for(wait)) & set(active)]
        if hopeless:  # they wait only for arms that have ended
            for wait in hopeless:
                wait.failure = self._partner_gone(wait)
            return
        last = max(stuck, key=lambda one: (one.arm in self.returning, one.since, one.arm, one.path))
        members = "; ".join(f"{one.arm} {self._sentence(one)}" for one in stuck)
        last.failure = Failure(
            "DEADLOCK",
            f"these arms wait for each other indefinitely: {members}; {last.arm} yields, as it "
            f"began to wait last{_remedy(stuck)}",
        )

    def _can_go_on(
        self,
        arm: str,
        node: ActiveNode,
        live: set[str],
        active: Mapping[str, Sequence[ActiveNode]],
    ) -> bool:
        wait = self._waits.get((arm, node.path))
        if wait is None or wait.failure is not None:
            return True
        if isinstance(wait, Obstruction) and wait.blockers and wait.blockers <= self._gone.keys():
            return False  # they stay there, whatever ends its wait later
        if wait.has_timeout or node.may_be_halted:
            return True
        if wait.asked_by:
            return True  # it is moving aside
        if isinstance(wait, Obstruction):
            theirs = [self._obstructed[one] for one in wait.blockers if one in self._obstructed]
            if theirs and any(one.has_other_path for one in (wait, *theirs)):
                return True  # of motions that are in each other's way, one moves aside
        kind, _, name = wait.target.partition(" ")
        if kind == "signal" and self._signals[name].count != wait.seen:
            return True  # it will see the new value in its next tick
        if isinstance(wait, Appointment) and wait.action is not None:
            is_new = wait.action.changes != wait.seen  # likewise, it will see the new message
            if wait.moves_aside or is_new:
                return True
        others = self.waited_for(wait)
        if not others:
            return True
        # An arm that was never in the world may be spawned by any other one that can continue.
        may_come = [
            other in live or (other not in active and other not in self._gone and bool(live))
            for other in others
        ]
        # It is not always known which of several arms is in the way: any of them may leave.
        return any(may_come) if kind in ("signal", "path") else all(may_come)


def _remedy(stuck: Sequence[CellWait]) -> str:
    """What was in the way of arms that wait for each other, and what to change; or nothing."""
    waiting = {wait.arm for wait in stuck if not isinstance(wait, Obstruction)}
    found = []
    for wait in stuck:
        if not isinstance(wait, Obstruction):
            continue
        why = f": {wait.why}" if wait.why else ""
        in_the_way = sorted(wait.blockers & waiting)
        holding = [one.arm for one in stuck if one.target == f"partner {wait.arm}"]
        if in_the_way:
            advice = f"Let {' and '.join(in_the_way)} wait elsewhere, for example after `go_home`, "
            advice += f"or come there only when {wait.arm} is done"
            if in_the_way == holding:
                advice = f"Let {holding[0]} hold still elsewhere, or in another posture; "
                advice += (
                    f"a skill whose `into` names what {holding[0]} holds may come nearer to that"
                )
            found.append(f"; {wait.arm} cannot go on{why}. {advice}")
        elif not wait.has_other_path:
            found.append(f"; {wait.arm} cannot leave its prescribed path{why}")
    return "".join(found)


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

    @property
    def zones(self) -> Mapping[str, CellZone]:
        """Zones of the cell by name."""
        return self.shared.spec.zones

    @classmethod
    def alone(cls) -> CellAccess:
        """Returns the access to a cell without signals, zones or rendezvous."""
        return cls(CellState(CellSpec(), lambda: 0.0), "")
