"""Node types that coordinate arms: signal, await, meet, claim, in_step; see `skill.cell`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal, TypeAlias

from py_trees.common import Status
from pydantic import Field

from bt_dualarm.behaviors.composites import Node, Ticks
from bt_dualarm.behaviors.leaf import LanguageLeaf, compared
from bt_dualarm.behaviors.node import NodeParts, reached
from bt_dualarm.core.errors import Failure
from bt_dualarm.skill.cell import KEPT_VALUES, Appointment, CellAccess, CellWait, Request
from bt_dualarm.skill.making_room import ASIDES, WaitingPlace
from bt_dualarm.spec.cell import (
    AWAIT,
    CLAIM,
    IN_STEP,
    MEET,
    SIGNAL,
    RendezvousName,
    SignalName,
    ZoneName,
    claimed,
)
from bt_dualarm.spec.node_types import (
    LanguageNode,
    Outcomes,
    PortModel,
    Slot,
    always,
    counted,
    port,
    success,
)
from bt_dualarm.spec.values import ArmName, Duration, ObjectName
from bt_dualarm.spec.yaml_reader import Data


class Signal(LanguageLeaf):
    """Writes a signal of the cell."""

    class Ports(PortModel):
        """Ports of signal."""

        signal: SignalName = port(..., "Signal to write; this arm must be one of `written_by`")
        value: Data = port(True, "Value to write, of the signal's type; true by default")

    node_type = LanguageNode(
        SIGNAL,
        "Writes a signal of the cell, which other arms read from their next tick on",
        Ports,
        fixed=frozenset({"signal"}),
        shorthand="signal",
        example="signal: {signal: ready, value: true}",
        outcomes=success,
    )
    ports: Ports

    def run(self) -> Iterator[None]:
        """Write the value.

        Raises:
            Failure: ``NOT_ALLOWED``: the signal has other writers, or another type.
        """
        cell = self.context.cell
        name = self.ports.signal
        signal = cell.shared.spec.signals[name]
        if cell.arm not in signal.written_by:
            raise Failure(
                "NOT_ALLOWED", f"'{name}' is written by {' and '.join(signal.written_by)} only"
            )
        for complaint in signal.complaints(self.ports.value):
            raise Failure("NOT_ALLOWED", f"'{name}': {complaint.removeprefix('value: ')}")
        cell.shared.write(cell.arm, name, self.ports.value)
        yield from ()


_Relation: TypeAlias = Literal[
    "equal", "not_equal", "less", "less_or_equal", "greater", "greater_or_equal", "near"
]


class Await(LanguageLeaf):
    """Waits until a signal has a value."""

    class Ports(PortModel):
        """Ports of await."""

        signal: SignalName = port(..., "Signal to wait for")
        to: Data = port(True, "Right side of the comparison; true by default")
        relation: _Relation | Literal["any"] = port(
            "equal", "Comparison; `any` accepts every value"
        )
        tolerance: float = port(
            1e-6, "Largest difference between two numbers that are near", ge=0.0, le=1e9
        )
        values: Literal["latest", "every"] = port(
            "latest",
            "`latest` checks the current value; `every` takes each value once, in order, including "
            "values that were overwritten",
        )
        timeout: Duration | None = port(None, "Simulated time after which it fails", gt=0.0)

    class Outputs(PortModel):
        """Outputs of await."""

        value: Data = port(..., "The value that ended the wait")

    node_type = LanguageNode(
        AWAIT,
        "Waits until a signal of the cell has a value",
        Ports,
        outputs=Outputs,
        fixed=frozenset({"signal"}),
        shorthand="signal",
        failures={
            "TIMEOUT": "the signal did not get such a value in time",
            "PARTNER_GONE": "the trees that write the signal have ended",
            "DEADLOCK": "the arms that write the signal wait for this one",
            "LOST_VALUES": f"more than {KEPT_VALUES} values were pending",
            "NOT_COMPARABLE": "the value cannot be compared with the right side",
        },
        example="await: {signal: ready, timeout: 10}",
        synonyms={"WaitForBlackboardVariable": "", "WaitForBlackboardVariableValue": ""},
    )
    ports: Ports

    def run(self) -> Iterator[None]:
        """Wait for the value.

        Raises:
            Failure: As declared.
        """
        cell = self.context.cell
        name = self.ports.signal
        began = self.time
        timeout = self.ports.timeout
        wait: CellWait | None = None
        place = WaitingPlace(self.arm, cell.shared)
        seen = -1
        try:
            while True:
                if cell.shared.written(name) != seen:  # otherwise nothing has changed since
                    if self._is_fulfilled(cell, name):
                        break
                    seen = cell.shared.written(name)
                if timeout is not None and reached(self.time, began + timeout):
                    raise Failure(
                        "TIMEOUT", f"'{name}' was not written as awaited in {timeout:g} s"
                    )
                if wait is None:
                    wait = cell.shared.await_signal(
                        cell.arm, self.context.name, name, has_timeout=timeout is not None
                    )
                    wait.asides = ASIDES
                cell.shared.looked(wait, seen)
                if wait.failure is not None:
                    raise wait.failure
                if wait.asked_by:
                    yield from place.make_room(wait)
                    cell.shared.resume(wait)
                    continue
                yield
        finally:
            if wait is not None:
                cell.shared.end(wait)
        yield from place.come_back_or_go_on()

    def _is_fulfilled(self, cell: CellAccess, name: str) -> bool:
        if self.ports.values == "latest":
            value, exists = cell.shared.value(name)
            return exists and self._accepts(value)
        values, lost = cell.shared.values_since(name, cell.taken.get(name, 0))
        if lost:
            cell.taken[name] = cell.shared.written(name)
            were = "was" if lost == 1 else "were"
            reason = f"{counted(lost, 'value')} of '{name}' {were} not taken in time"
            raise Failure("LOST_VALUES", reason)
        for value in values:
            cell.taken[name] = cell.taken.get(name, 0) + 1
            if self._accepts(value):
                return True
        return False

    def _accepts(self, value: Data) -> bool:
        relation = self.ports.relation
        if relation != "any" and not compared(value, relation, self.ports.to, self.ports.tolerance):
            return False
        self.output("value", value)
        return True


class Meet(LanguageLeaf):
    """Waits until all participants of a rendezvous wait there."""

    class Ports(PortModel):
        """Ports of meet."""

        at: RendezvousName = port(..., "Rendezvous; this arm must be one of its participants")
        timeout: Duration | None = port(None, "Simulated time after which it fails", gt=0.0)

    node_type = LanguageNode(
        MEET,
        "Waits until all participants are waiting at the rendezvous: all of them succeed, or none",
        Ports,
        fixed=frozenset({"at"}),
        shorthand="at",
        failures={
            "TIMEOUT": "the other participants did not arrive in time",
            "PARTNER_GONE": "another participant gave up, ended or was removed",
            "DEADLOCK": "the missing participants wait for this arm",
        },
        example="meet: {at: handover, timeout: 5 s}",
    )
    ports: Ports

    def run(self) -> Iterator[None]:
        """Wait for the others.

        Raises:
            Failure: As declared.
        """
        cell = self.context.cell
        name = self.ports.at
        timeout = self.ports.timeout
        if cell.arm not in cell.shared.spec.rendezvous[name]:
            raise Failure("PARTNER_GONE", f"{cell.arm} is not a participant of '{name}'")
        attendance = cell.shared.arrive(
            cell.arm, self.context.name, name, has_timeout=timeout is not None
        )
        attendance.asides = ASIDES
        place = WaitingPlace(self.arm, cell.shared)
        began = self.time
        why = "was halted at the rendezvous"
        try:
            while not attendance.has_met:
                if attendance.failure is not None:
                    raise attendance.failure
                if attendance.asked_by:
                    attendance.is_aside = True  # already on the way: it must not take place then
                    yield from place.make_room(attendance)
                    attendance.is_aside = place.is_left
                    cell.shared.resume(attendance)
                    continue
                if attendance.is_aside and cell.shared.is_awaited(attendance):
                    try:
                        yield from place.come_back()
                    except Failure as failure:
                        why = f"could not return to the rendezvous: {failure.reason}"
                        raise
                    attendance.is_aside = False
                    cell.shared.resume(attendance)
                    continue
                if timeout is not None and reached(self.time, began + timeout):
                    why = f"has waited for {timeout:g} s, its timeout"
                    missing = " and ".join(attendance.others)
                    raise Failure("TIMEOUT", f"{missing} did not come to '{name}' in {timeout:g} s")
                yield
        finally:
            cell.shared.leave(attendance, why)


_Names: TypeAlias = Annotated[tuple[str, ...], Field(min_length=1, max_length=16)]


class Claim(Node):
    """Runs its child while nobody else has what it claims."""

    class Ports(PortModel):
        """Ports of claim."""

        zone: ZoneName | Annotated[_Names, *ZoneName.__metadata__] | None = port(
            None, "Zone or zones that no other arm may claim meanwhile"
        )
        object: ObjectName | Annotated[_Names, *ObjectName.__metadata__] | None = port(
            None, "Object or objects that no other arm may claim meanwhile"
        )
        timeout: Duration | None = port(
            None, "Simulated time after which it fails, if it is not granted", gt=0.0
        )

    node_type = LanguageNode(
        CLAIM,
        "Runs its child while no other arm has claimed the same zone or object",
        Ports,
        slots=(Slot("child"),),
        fixed=frozenset({"zone", "object"}),
        failures={
            "TIMEOUT": "it was not granted in time",
            "DEADLOCK": "the arms that have claimed it wait for this one",
        },
        example="claim: {zone: bin, child: {wait: 1}}",
        runs_all=always,
        outcomes=lambda _, children: Outcomes(children[0].succeeds, True),
    )
    ports: Ports
    _request: Request | None = None

    def __init__(self, parts: NodeParts) -> None:
        super().__init__(parts)
        self._cell = parts.cell

    def initialise(self) -> None:
        """Ask for everything at once."""
        self._release()
        resources = claimed(self.ports.model_dump())
        if not resources:
            raise Failure("NOTHING_CLAIMED", "neither a zone nor an object is named")
        self._request = self._cell.shared.claim(
            self._cell.arm, self.path, resources, has_timeout=self.ports.timeout is not None
        )

    def tick_children(self) -> Ticks:
        """Tick the child once the claim is granted."""
        request = self._request
        if request is not None and request.granted_s is None:
            timeout = self.ports.timeout
            if request.failure is not None:
                raise request.failure
            if timeout is not None and reached(self.time, request.since + timeout):
                others = " and ".join(request.others)
                raise Failure(
                    "TIMEOUT", f"{others} did not release {request.target} in {timeout:g} s"
                )
            return Status.RUNNING
        yield from self.children[0].tick()
        return self.children[0].status

    def stop(self, new_status: Status = Status.INVALID) -> None:
        """Halt the child, then release the claim, whatever the reason of the end."""
        super().stop(new_status)
        self._release()

    def _release(self) -> None:
        if self._request is not None:
            self._cell.shared.release(self._request)
            self._request = None


class _InStepPorts(PortModel):
    """Ports of in_step; the name of one of them is a keyword of Python."""

    timeout: Duration | None = port(
        None, "Simulated time after which it fails, if the other arm has not come", gt=0.0
    )
    __annotations__["with"] = ArmName
    vars()["with"] = port(..., "Other arm, whose tree has an `in_step` with this one")


class InStep(Node):
    """Runs its child together with that of another arm: their motions take the same time."""

    node_type = LanguageNode(
        IN_STEP,
        "Runs its child while the motions of another arm's child begin and end with its own",
        _InStepPorts,
        slots=(Slot("child"),),
        fixed=frozenset({"with"}),
        failures={
            "TIMEOUT": "the other arm did not come in time",
            "PARTNER_GONE": "the other arm gave up, failed, ended or was removed",
            "DEADLOCK": "the other arm waits for this one",
        },
        example="in_step: {with: arm2, child: {wait: 1}}",
        runs_all=always,
        outcomes=lambda _, children: Outcomes(children[0].succeeds, True),
    )
    _one: Appointment | None = None
    _has_entered = False
    _is_done = False

    def __init__(self, parts: NodeParts) -> None:
        super().__init__(parts)
        self._cell = parts.cell

    @property
    def _other(self) -> str:
        other: str = getattr(self.ports, "with")
        return other

    def initialise(self) -> None:
        """Come to the step; the other arm need not be there yet."""
        self._leave("began it again")
        arm = self._cell.arm
        if self._other == arm:
            raise Failure("PARTNER_GONE", f"{arm} cannot go in step with itself")
        first, second = members = tuple(sorted((arm, self._other)))
        self._one = self._cell.shared.join(
            arm, self.path, f"the step of {first} and {second}", members
        )
        self._one.has_timeout = self._timeout is not None

    @property
    def _timeout(self) -> float | None:
        timeout: float | None = getattr(self.ports, "timeout", None)
        return timeout

    def tick_children(self) -> Ticks:
        """Tick the child once both arms have come, and wait for the other arm at its end."""
        one = self._one
        if one is None:  # never None here: `initialise` has set it
            return Status.RUNNING
        shared = self._cell.shared
        arm = self._cell.arm
        if one.failure is not None:
            raise one.failure
        if one.action is None:
            timeout = self._timeout
            if timeout is not None and reached(self.time, one.since + timeout):
                raise Failure("TIMEOUT", f"{self._other} did not come in {timeout:g} s")
            return Status.RUNNING
        if not self._has_entered:
            self._has_entered = True
            one.has_timeout = False
            shared.traffic.enter_step(arm, self._other, one.action)
        is_other_done = bool(one.action.messages(self._other).get("done"))
        if is_other_done:
            shared.traffic.alone_in_step(arm)
        elif self._other in one.action.left:
            raise Failure("PARTNER_GONE", f"{self._other} {one.action.left[self._other]}")
        refusal = shared.step_failure(arm)
        if refusal is not None:
            raise refusal
        if not self._is_done:
            yield from self.children[0].tick()
            if self.children[0].status is not Status.SUCCESS:
                return self.children[0].status
            self._is_done = True
            one.action.send(arm, {"done": True})
            shared.traffic.leave_step(arm)
        shared.await_members(one, (self._other,))
        # What this arm has published becomes visible to both in the same tick.
        both = is_other_done and one.action.messages(arm).get("done")
        return Status.SUCCESS if both else Status.RUNNING

    def stop(self, new_status: Status = Status.INVALID) -> None:
        """Halt the child, then leave the step, whatever the reason of the end."""
        why = f"was halted in {self.path}"
        if new_status is Status.FAILURE:
            child = self.children[0]
            code = self.code or getattr(child, "code", "")
            reason = self.reason or getattr(child, "reason", "")
            why = (
                f"failed in {self.path} with {code}: {reason}" if code else f"failed in {self.path}"
            )
        super().stop(new_status)
        self._leave(why)

    def _leave(self, why: str) -> None:
        if self._has_entered:
            self._cell.shared.traffic.leave_step(self._cell.arm)
        if self._one is not None:
            self._cell.shared.part(self._one, why)
        self._one = None
        self._has_entered = False
        self._is_done = False
