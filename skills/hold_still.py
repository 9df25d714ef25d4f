"""Hold the tool in place against pushes, stiffly or like a spring."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np

from bt_dualarm import (
    HANDS_APART_M,
    CellWait,
    Duration,
    Failure,
    Grip,
    OtherArmName,
    PortModel,
    Skill,
    Trajectory,
    Vector,
    port,
    shared_grasp,
)

_LEARN_S = 1.0  # time to learn model errors before the arm becomes soft
_ZERO_S = 0.2  # likewise for zeroing the force of a stiff arm
_BACK_S = 4.0  # time limit for returning to its pose when it becomes stiff again
_BACK_RAD = 5e-4


class HoldStill(Skill):
    """Hold the tool in place while another arm works on it, stiffly or like a spring.

    Without ``duration`` it holds until it is halted. It must begin without a push.
    """

    class Ports(PortModel):
        compliance: float = port(
            0.0,
            "displacement of the tool per force in its softest direction; 0 holds as stiffly as "
            "the arm can. The dry friction of the joints adds to this",
            unit="m/N",
            ge=0,
            le=0.02,
        )
        partner: OtherArmName | None = port(
            None,
            "arm that may touch what this arm holds, with its hand and with what it holds; that "
            "arm's skill has to name the object as well",
        )
        push: float = port(
            12.0,
            "contact force of `partner` that the grip withstands; by default that with which "
            "`insert` pushes",
            unit="N",
            ge=0,
            le=200,
        )
        duration: Duration | None = port(None, "time after which it succeeds", gt=0)
        max_displacement: float = port(
            0.02, "largest distance of the tool from its pose", unit="m", ge=1e-4, le=0.5
        )

    failures = {
        "INVALID_TARGET": "the arm cannot have this compliance here, or there is no such partner",
        "PARTNER_GONE": "the tree of the partner has ended, or it was removed",
        "MOVED": "the tool was pushed farther than max_displacement",
    }
    example = "hold_still: {compliance: 0.0005, duration: 2.0}"
    ports: Ports
    _is_alone = False

    def run(self) -> Iterator[float | None]:
        """Become soft, measure displacement and force until the end, become stiff again."""
        arm = self.arm
        partner = self.ports.partner
        if partner is not None and (partner == arm.name or partner not in arm.world.arms):
            raise Failure("INVALID_TARGET", f"there is no other arm {partner!r} in the world now")
        yield from arm.think()
        with ExitStack() as shared:
            for obj in arm.held if partner is not None else ():
                shared.enter_context(shared_grasp(arm, str(partner), obj, HANDS_APART_M))
            # What the weight needs does not withstand the partner: a light object slid by 2 mm.
            for held in arm.world.attachments.gripped_by(arm.name) if partner is not None else ():
                Grip(arm, held.object).firm_for(self.ports.push)
            wait = None if partner is None else self._depend(partner, shared)
            yield from self._hold(wait)
        ended = self.time
        while np.abs(arm.setpoint.q - arm.q).max() > _BACK_RAD and self.time - ended < _BACK_S:
            yield 1.0
            arm.check()
        yield from arm.settle()

    def _depend(self, partner: str, shared: ExitStack) -> CellWait:
        """Let the cell know that nothing but the partner ends this, to find arms that block it."""
        cell = self.context.cell
        has_timeout = self.ports.duration is not None
        wait = cell.shared.depend(
            cell.arm, self.context.name, f"partner {partner}", has_timeout=has_timeout
        )
        shared.callback(cell.shared.end, wait)
        return wait

    def _refuse_alone(self, wait: CellWait | None) -> None:
        if wait is None:
            return
        partner = str(self.ports.partner)
        self.arm.world.arms.require(partner)
        failure = wait.failure
        if self.context.cell.shared.has_ended(partner):
            failure = Failure("PARTNER_GONE", f"the tree of {partner} has ended")
        # With the end of the partner's tree, the signal that it wrote last becomes visible: an
        # `await` beside this leaf, whatever their order, may end it first.
        if failure is not None and self._is_alone:
            raise failure
        self._is_alone = failure is not None

    def _hold(self, wait: CellWait | None) -> Iterator[float | None]:
        arm = self.arm
        ports = self.ports
        start = arm.setpoint.q
        pose = arm.commanded_tool_pose
        is_soft = ports.compliance > 0.0
        ready = _LEARN_S if is_soft else _ZERO_S
        bandwidth = arm.spring_bandwidth(ports.compliance) if is_soft else 0.0
        compliance = arm.controller.compliance
        arm.begin(Trajectory.rest(start, arm.period), may_touch=True, compliant=is_soft)
        began = self.time
        zero: list[Vector] = []
        moved_m = pushed_n = 0.0
        try:
            while ports.duration is None or self.time - began < ready + ports.duration:
                done = 0.0 if ports.duration is None else (self.time - began) / ports.duration
                yield None if ports.duration is None else min(1.0, done)
                arm.check()
                if not np.array_equal(arm.setpoint.q, start):
                    raise Failure("INTERRUPTED", f"another leaf has moved {arm.name}")
                self._refuse_alone(wait)
                if self.time - began < ready:
                    zero.append(arm.external_wrench[:3])
                    continue
                if is_soft and not compliance.is_spring:
                    compliance.spring(bandwidth)
                moved_m = max(moved_m, arm.tool_pose.distance(pose))
                force = arm.external_wrench[:3] - np.mean(zero or [np.zeros(3)], axis=0)
                pushed_n = max(pushed_n, float(np.linalg.norm(force)))
                if moved_m > ports.max_displacement:
                    raise Failure(
                        "MOVED",
                        f"the tool was pushed {1e3 * moved_m:.1f} mm away by about "
                        f"{pushed_n:.0f} N; max_displacement allows "
                        f"{1e3 * ports.max_displacement:.1f} mm",
                        held_moved_m=moved_m,
                        held_force_n=pushed_n,
                    )
        finally:
            compliance.active = False
            self.metrics |= {"held_moved_m": moved_m, "held_force_n": pushed_n}
