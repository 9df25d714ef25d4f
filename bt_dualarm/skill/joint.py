"""Joint actions: leaves of several arms that act together on one object.

Each arm has a leaf of its own, in its own tree. They meet, report their progress to one another,
and learn when and why another one has left. `bt_dualarm.skill.cell` has the rules; its waits are
part of the wait-for graph of all arms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any, Final

from bt_dualarm.arm.arm import Arm
from bt_dualarm.collision.distance import HANDS_APART_M, HANDS_M
from bt_dualarm.core.errors import KINEMATIC_CODES, Failure
from bt_dualarm.skill.cell import Appointment
from bt_dualarm.skill.making_room import ASIDES, WaitingPlace
from bt_dualarm.skill.skill import SkillContext

_DONE: Final = "done"  # message of a member that has completed its part


class JointPart:
    """One leaf's part in a joint action; use it in a ``with`` block, whose end leaves the action.

    The others learn why the block ended: the failure, a halt, or that the part is done.

    Args:
        context: Context of the leaf's skill.
        label: Displayed name of the action, the same in all leaves of it.
        members: Names of all arms of the action, in the same order in all leaves.
    """

    def __init__(self, context: SkillContext, label: str, members: Sequence[str]) -> None:
        self._cell = context.cell.shared
        self._own_arm = context.arm
        self._arm = context.arm.name
        self._leaf = context.name
        self._label = label
        self._members = tuple(members)
        self._one: Appointment | None = None
        self._is_complete = False

    def __enter__(self) -> JointPart:
        """Join the action; its other members may join later."""
        self._one = self._cell.join(self._arm, self._leaf, self._label, self._members)
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        """Leave the action and let the others know why."""
        if self._one is None:
            return
        if error is None:
            self.send(done=True)
        elif self._is_complete and isinstance(error, GeneratorExit):
            self._cell.miss_end(self._one)
        self._cell.part(self._one, _reason(self._leaf, error))

    @property
    def others(self) -> tuple[str, ...]:
        """Names of the other members."""
        return tuple(name for name in self._members if name != self._arm)

    def meet(self) -> Iterator[None]:
        """Wait until all members have joined, aside if need be; yields once per tick.

        Nothing is left to be done if the action `is_completed` then.

        Raises:
            Failure: ``PARTNER_GONE`` if a member can no longer join; ``DEADLOCK``.
        """
        one = self._appointment
        one.asides = ASIDES
        place = WaitingPlace(self._own_arm, self._cell)
        while one.action is None and not one.is_completed:
            if one.failure is not None:
                raise one.failure
            if one.asked_by:
                yield from place.make_room(one)
                if one.action is None and not one.is_completed:
                    self._cell.resume(one)
                continue
            yield
        one.asides = 0
        if one.failure is not None:
            raise one.failure

    @property
    def is_completed(self) -> bool:
        """Whether all had completed an earlier run of the action, whose end this leaf has missed.

        It was halted in `complete`, and waited now for others that do not begin anew.
        """
        return self._appointment.is_completed

    def complete(self, *, moves_aside: bool = False) -> Iterator[None]:
        """Report that this arm's part is complete, and wait for the others; once per tick.

        Args:
            moves_aside: As of `until`.

        Raises:
            Failure: ``PARTNER_GONE`` if one of them has left before its part was complete.
        """
        action = self._appointment.action
        if action is None:
            return
        self._is_complete = True
        self.send(done=True)
        action.completed.add(self._arm)
        for other in self.others:
            done = partial(self._is_done, other)
            yield from self.until(done, (other,), moves_aside=moves_aside)

    def send(self, **facts: Any) -> None:  # Any: facts of the skills
        """Send facts to the other members, by name; visible from their next tick on.

        Without effect until all members have joined.
        """
        action = self._appointment.action
        if action is not None:
            action.send(self._arm, facts)

    def messages(self, member: str) -> Mapping[str, Any]:  # Any: as in `send`
        """Returns the messages of a member so far, by name."""
        action = self._appointment.action
        return {} if action is None else action.messages(member)

    def left(self, member: str) -> str:
        """Returns why a member has left before its part was done, as a clause; otherwise empty."""
        action = self._appointment.action
        if action is None or action.messages(member).get(_DONE):
            return ""
        return action.left.get(member, "")

    def check(self) -> None:
        """Check that no other member has left before its part was done.

        Raises:
            Failure: ``PARTNER_GONE`` with who has left, and why.
        """
        for member in self.others:
            why = self.left(member)
            if why:
                raise Failure("PARTNER_GONE", f"{member} {why}")

    def until(
        self,
        fulfilled: Callable[[], bool],
        awaited: Sequence[str] = (),
        *,
        moves_aside: bool = False,
    ) -> Iterator[None]:
        """Wait for other members during the action; yields once per tick.

        Args:
            fulfilled: Whether the wait is over.
            awaited: Names of the members that it depends on; all others by default.
            moves_aside: Whether the caller calls `PastOthers.make_way` in each tick, so that
                members whose path this arm blocks do not wait forever.

        Raises:
            Failure: ``PARTNER_GONE``; ``DEADLOCK`` if they are waiting for this arm.
        """
        one = self._appointment
        try:
            while not fulfilled():
                self.check()
                if one.failure is not None:
                    failure = one.failure
                    one.failure = None  # the action continues if the leaf does
                    raise failure
                one.moves_aside = moves_aside
                self._cell.await_members(one, awaited or self.others)
                yield
        finally:
            one.moves_aside = False
            self._cell.await_members(one, ())

    def _is_done(self, member: str) -> bool:
        return bool(self.messages(member).get(_DONE))

    @property
    def _appointment(self) -> Appointment:
        if self._one is None:
            raise RuntimeError("a joint action is used outside of its `with` block")
        return self._one


def _reason(leaf: str, error: BaseException | None) -> str:
    """Why a leaf has left a joint action, as a clause."""
    if error is None:
        return f"has completed {leaf}"
    if isinstance(error, Failure):
        return f"failed in {leaf} with {error.code}: {error.reason}"
    if isinstance(error, GeneratorExit):
        return f"was halted in {leaf}"
    return f"raised {type(error).__name__} in {leaf}"


@contextmanager
def shared_grasp(arm: Arm, partner: str, obj: str, hands_m: float = HANDS_M) -> Iterator[None]:
    """Let an arm and a partner hold one object together within a ``with`` block.

    It takes effect while both arms are in such a block. Then the hand of one may touch the object
    in the hand of the other, both hands may come nearer to each other than arms otherwise do, and
    a pull at the object does not count as a slip.

    Args:
        arm: Arm of the leaf.
        partner: Name of the other arm.
        obj: Name of the object.
        hands_m: Distance that the hands keep from each other, m.
    """
    attachments = arm.world.attachments
    attachments.consent(arm.name, partner, obj, hands_m)
    try:
        yield
    finally:
        attachments.dissent(arm.name, partner, obj)


@contextmanager
def into_held(arm: Arm, obj: str | None) -> Iterator[None]:
    """Let an arm's hand, and what it holds, come to an object in another hand, within a block.

    The arm that holds the object has to consent, as `hold_still` with a ``partner`` does. Plans
    still avoid contact with the object; they and the guard keep no other distance from it.

    Args:
        arm: Arm of the leaf.
        obj: Name of the object; None for none. Of an object in no other hand nothing changes.

    Raises:
        Failure: As within the block; its reason names an arm that does not consent any more.
    """
    attachments = arm.world.attachments
    holders = [one for one in attachments.holders(obj) if one != arm.name] if obj else []
    with ExitStack() as shared:
        for holder in holders:
            shared.enter_context(shared_grasp(arm, holder, str(obj), HANDS_APART_M))
        try:
            yield
        except Failure as failure:
            sharing = attachments.shared_grasps(arm.name)
            consenting = [one.partner for one in sharing if one.object == obj]
            for holder in holders:
                if holder not in attachments.holders(str(obj)):
                    failure.adding(f"{holder} no longer holds {obj}")
                elif holder not in consenting and failure.code not in KINEMATIC_CODES:
                    failure.adding(
                        f"{holder} holds {obj}, but not in hold_still with partner: {arm.name}"
                    )
            raise
