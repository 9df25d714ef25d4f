"""Monitoring of a held object and of contacts of the tool, by the arm's own sensors."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator, Iterator
from typing import Final

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.gripper import LOST_S, has_slipped
from bt_dualarm.collision.checker import Contact
from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.core.pose import Pose, Vector

_FIRM: Final = (
    4.0  # safety factor of the grip over a contact force, which overshoots while the arm stops
)
_JUDGED_S: Final = 1.0  # time for empty fingers to close


class Grip:
    """Monitor of an object in the gripper.

    Args:
        arm: Arm with the gripper.
        name: Name of the held object.

    Attributes:
        width: Opening when the monitoring began, m.
    """

    def __init__(self, arm: Arm, name: str) -> None:
        self._arm = arm
        self._name = name
        self.width = arm.gripper.width
        self._widths: deque[tuple[float, float]] = deque()

    def look(self) -> None:
        """Check the hold by the gripper's sensors; to be called once per tick.

        Raises:
            Failure: ``SLIPPED`` if the opening has changed, ``DROPPED`` if nothing is between the
                fingers any more or the cup does not seal.
        """
        gripper = self._arm.gripper
        if gripper.is_lost:
            fingers = gripper.description.fingers
            how = "is no longer between the fingers" if fingers else "came off the cup"
            raise self._failure("DROPPED", how)
        if gripper.description.fingers:
            moved = abs(self._settled_width() - self.width)
            if has_slipped(gripper.description, moved):
                raise self._failure("SLIPPED", f"slips: the fingers moved {1e3 * moved:.1f} mm")

    def watch(self) -> Iterator[None]:
        """Check the hold as `look`; after a slip, stop and decide as `judge`."""
        try:
            self.look()
        except Failure as failure:
            if failure.code == "SLIPPED":
                yield from self.judge(failure)
            raise

    def firm_for(self, force_n: float) -> float:
        """Increase the grip force so that the object withstands a contact force without sliding.

        Args:
            force_n: Contact force along the pads, N.

        Returns:
            That force, or the smaller one that friction withstands at the largest grip force.
        """
        gripper = self._arm.gripper
        declared = self._arm.world.objects[self._name]
        description = gripper.description
        if not description.fingers:
            return force_n  # contact presses the object onto the cup
        friction = 2.0 * max(description.friction, declared.friction)  # two pads
        needed = _FIRM * force_n / max(friction, 1e-3)
        held = self._arm.world.attachments.find(self._arm.name, self._name)
        most = math.inf if held is None else held.most_force
        firm = min(description.force.clipped(needed), most)
        if firm > gripper.commanded.force:
            gripper.command(force=firm)
        return min(force_n, gripper.commanded.force * friction / _FIRM)

    def judge(self, slip: Failure) -> Iterator[None]:
        """Stop, and decide between slip and loss once the fingers are at rest; always raises.

        Args:
            slip: Failure that `look` has raised.

        Raises:
            Failure: ``DROPPED`` if nothing is left between the fingers, otherwise ``slip``.
        """
        yield from self._arm.halt()
        gripper = self._arm.gripper
        began = self._arm.time
        while self._arm.time - began < _JUDGED_S and not gripper.is_lost:
            yield None
        if gripper.is_lost:
            raise self._failure("DROPPED", "is no longer between the fingers") from None
        raise slip

    def _settled_width(self) -> float:
        """Opening with the smallest change within `LOST_S`, m: a single reading may be wrong."""
        now = self._arm.time
        gripper = self._arm.gripper
        self._widths.append((now, gripper.width))
        while now - self._widths[0][0] > LOST_S:
            self._widths.popleft()
        return min((width for _, width in self._widths), key=lambda one: abs(one - self.width))

    def _failure(self, code: str, how: str) -> Failure:
        gripper = self._arm.gripper
        if code == "DROPPED":
            gripper.let_go(self._name)
        return Failure(
            code,
            f"{self._name!r} {how}",
            width_m=gripper.width,
            width_before_m=self.width,
            force_n=gripper.force,
        )


_TARE_S: Final = (0.1, 0.5)
"""Age of the force samples whose mean is the zero: they contain friction and model errors."""

_DEVIATIONS: Final = 5.0
"""Standard deviations of the noise that a contact has to exceed: of the 30 to 100 samples of an
approach, less than one in a thousand would by chance."""

_MEDIAN_OF_NORMAL: Final = 0.6745
"""Median magnitude of a normal variable with a standard deviation of 1."""

_CHANGES: Final = 100  # from which the noise is estimated
_FEW: Final = 8


class TouchSense:
    """Contact force against a motion of the tool, relative to its value a moment ago.

    Args:
        arm: Arm that moves.
        direction: Direction of the motion in the world, of unit length, of shape (3,).
        alone: Whether to assume that only a force along the motion acts. Joint friction then has
            little effect in any posture, but small forces are underestimated.

    Attributes:
        most: Largest force so far, N.
        slow_rise: Current force relative to the smallest zero so far, N: a force that rises slowly,
            as against something soft, shifts the zero with it.
    """

    def __init__(self, arm: Arm, direction: Vector, *, alone: bool = False) -> None:
        self._arm = arm
        self._direction = direction
        self._alone = alone
        self._felt = deque[tuple[float, float]]()
        self._latest: float | None = None
        self._changes = deque[float](maxlen=_CHANGES)
        self._zero = 0.0
        self._least = math.inf
        self.most = self.slow_rise = 0.0

    def listen(self) -> None:
        """Sample the noise, where no contact is expected yet; to be called once per tick."""
        self._sample()

    def force(self, *, stands: bool = False) -> float:
        """Current contact force, N; to be called once per tick.

        Args:
            stands: Whether the tool has stopped: the zero is kept while it stands, since a contact
                force may rise slowly.
        """
        now = self._arm.time
        latest, earliest = _TARE_S
        felt = self._sample()
        self._felt.append((now, felt))
        while now - self._felt[0][0] > earliest:
            self._felt.popleft()
        before = [one for at, one in self._felt if now - at >= latest]
        if not stands:
            self._zero = float(np.mean(before)) if before else felt
        self._least = min(self._least, self._zero)
        self.slow_rise = felt - self._least
        rise = felt - self._zero
        self.most = max(self.most, rise)
        return rise

    def exceeds(self, force: float) -> bool:
        """Whether the contact force exceeds ``force`` in N, and noise; instead of `force`.

        Noise of the encoders appears as a force in proportion to the mass that the tool moves: a
        few newtons for an arm of 20 kg, and more than 40 N for one of 150 kg. Its standard
        deviation follows from the median change between two samples, which contacts and joints
        that break away hardly affect.
        """
        rise = self.force()
        before = list(self._changes)[:-1]  # the latest change may be a contact
        # The median of a few changes may be small by chance, or they are those of a start.
        change = float(np.median(before) if len(before) >= _FEW else max(before, default=0.0))
        deviation = change / (_MEDIAN_OF_NORMAL * math.sqrt(2.0))
        return rise > max(force, _DEVIATIONS * deviation)

    def _sample(self) -> float:
        felt = self._against()
        if self._latest is not None:
            self._changes.append(abs(felt - self._latest))
        self._latest = felt
        return felt

    def _against(self) -> float:
        """Force against the motion, N, that explains the external joint torques.

        With ``alone`` it is a weighted least-squares fit of this one force, with torques relative
        to the joints' efforts. A full wrench is not observable near a singularity: there friction
        of joints that hardly move the tool appeared as 100 N.
        """
        arm = self._arm
        direction = self._direction
        if not self._alone:
            return -float(direction @ arm.external_wrench[:3])
        lever = direction @ arm.world.nominal[arm.name].tool_jacobian_at(arm.q)[:3]
        shares = lever / arm.robot.limits.effort**2
        return -float(shares @ arm.external_torque) / max(float(shares @ lever), 1e-12)


_HELD_S: Final = 1.0  # time for fingers to come to rest


def held_through(
    arm: Arm, going: Iterator[float | None]
) -> Generator[float | None, None, dict[str, Number]]:
    """Execute a motion and monitor the held object; yields the progress once per tick.

    Args:
        arm: Arm that moves.
        going: Its motion; without a held object nothing else is done.

    Returns:
        ``slid_m``: true displacement of the object in the tool; ``slips_felt`` and
        ``grip_force_n`` if slips were detected; empty if nothing is held.

    Raises:
        Failure: ``SLIPPED`` or ``DROPPED`` by the gripper's sensors; as the motion.
    """
    held = arm.world.attachments.gripped_by(arm.name)
    if not held:
        yield from going
        return {}
    name = held[0].object  # a gripper holds one object
    grip = Grip(arm, name)
    began_at = _true_pose_in_tool(arm, name)
    felt = arm.slips_felt
    yield from _monitored(going, grip)
    yield from _at_rest(arm, grip, name)
    found: dict[str, Number] = {"slid_m": _true_pose_in_tool(arm, name).distance(began_at)}
    if arm.slips_felt > felt:
        found |= {"slips_felt": arm.slips_felt - felt}
        found |= {"grip_force_n": arm.gripper.commanded.force}
    return found


def _monitored(going: Iterator[float | None], grip: Grip) -> Iterator[float | None]:
    grip.look()
    try:
        for progress in going:
            yield progress
            grip.look()
    except Failure as failure:
        if failure.code == "SLIPPED":
            yield from grip.judge(failure)
        raise


def _at_rest(arm: Arm, grip: Grip, name: str) -> Iterator[float]:
    """Wait until the fingers are at rest and press."""
    began = arm.time
    while not arm.gripper.holding:
        yield 1.0
        grip.look()
        if arm.time - began > _HELD_S:
            raise Failure("DROPPED", f"{name!r} is no longer held")


def _true_pose_in_tool(arm: Arm, name: str) -> Pose:
    """True pose of the object in the tool frame, which the encoders measure."""
    return arm.tool_pose.inverse @ arm.world.object_pose(name)


_STEP_M: Final = 0.03  # step between two retreats that are checked
_FARTHEST_M: Final = 0.24  # longest retreat
_CHORD_M: Final = 0.004  # step between two openings that are checked
_OPEN_M: Final = 2e-3  # fingers that are this near to their opening need not move


def make_room(
    arm: Arm, speed: float, opening: float | None = None, ignore: frozenset[str] = frozenset()
) -> Iterator[float | None]:
    """Retreat until the empty fingers can open, or close, without collision.

    The arm retreats along the tool axis or upward, as little as possible; mostly not at all.

    Args:
        arm: Arm whose gripper moves its fingers afterwards.
        speed: Fraction of its limits, above 0 to 1.
        opening: Opening that they will have, m; by default the widest.
        ignore: Names of objects that the fingers may touch.

    Raises:
        Failure: ``IN_COLLISION`` with what is next to the fingers, if no retreat helps; as motions.
    """
    description = arm.gripper.description
    to = description.stroke if opening is None else opening
    if not description.fingers or abs(arm.gripper.width - to) < _OPEN_M:
        return
    yield from arm.come_to_rest()  # the motion of a halted leaf may still be braking
    beside = contact_of_fingers(arm, arm.setpoint.q, to, ignore)
    if beside is None:
        return
    for goal in _retreats(arm):
        if contact_of_fingers(arm, arm.line_on(goal)[-1], to, ignore) is None:
            yield from arm.past_others(speed).straight(goal)
            return
    raise beside.failure()


def _retreats(arm: Arm) -> Iterator[Pose]:
    """Poses of the tool that a free straight path reaches, the nearest first."""
    here = arm.commanded_tool_pose
    directions: list[Vector] = [-here.rotation_matrix[:, 2], np.array((0.0, 0.0, 1.0))]
    for back in np.arange(_STEP_M, _FARTHEST_M + 1e-9, _STEP_M):
        for direction in list(directions):
            goal = here.shifted(back * direction)
            try:
                arm.refuse_collision_along(arm.line_on(goal))
            except Failure:
                directions.remove(direction)  # a longer retreat would pass through here
            else:
                yield goal


def contact_of_fingers(
    arm: Arm, q: Vector, to: float, ignore: frozenset[str] = frozenset()
) -> Contact | None:
    """Collision of fingers that move to an opening, in one configuration, if there is one.

    Args:
        arm: Arm with the fingers.
        q: Its configuration, of shape (dof,), rad.
        to: The opening, m.
        ignore: Names of objects that the fingers may touch.
    """
    checker = arm.checker(ignore)
    width = arm.gripper.width
    for opening in np.linspace(width, to, 2 + int(abs(to - width) / _CHORD_M)):
        checker.open_fingers(float(opening))
        contact = checker.contact(q)
        if contact is not None:
            return contact
    return None
