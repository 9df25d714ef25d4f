"""The joint controller of one arm: computed torque behind a gate that enforces the limits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from bt_dualarm.errors import DivergenceError, Failure, Number
from bt_dualarm.motion import timing
from bt_dualarm.motion.guard import Guard
from bt_dualarm.motion.limiter import SetPoint, SetPointLimiter
from bt_dualarm.motion.load import Load
from bt_dualarm.motion.motions import Motion, Stream, StreamMotion, TrajectoryMotion
from bt_dualarm.motion.trajectory import Trajectory
from bt_dualarm.pose import Vector
from bt_dualarm.world.arm_body import ArmBody
from bt_dualarm.world.world import World

BANDWIDTH = 60.0
"""Natural frequency of the error dynamics in rad/s: e'' + 2we' + w²e = 0 (critically damped)."""

_LOAD_FEEDBACK = 0.6
"""Share of the error's correction that is amplified by the load. With all of it the light wrist of
an xArm7 shakes at its payload: the weld gives way a little between wrist and load."""

LEFT_BEHIND = 0.1
"""Joint error in rad at which a motion is given up: blocked, or beyond the arm's torque."""

BACK_OFF_S = 0.1
"""Planned seconds that an arm which touches something goes back."""

_STANDSTILL = 0.005  # rad/s: a tool 0.8 m away creeps by less than 4 mm/s


class JointController:
    """Keeps one arm on its set-points; without a motion it holds the last one.

    The torque is ``M(q) (a + 2w(v - v̂) + w²(q - q̂)) + bias`` (computed torque, Siciliano et al.,
    Robotics, 8.5.2) plus what the attached objects need, within the joints' efforts.

    Args:
        world: The world that the arm ``name`` is in.
        period: Seconds between set-points, a multiple of the world's time step.

    Attributes:
        fault: What went wrong in the last motion; the skill that began it raises it.
    """

    def __init__(self, world: World, name: str, period: float) -> None:
        self.period = period
        self.fault: Exception | SystemExit | None = None
        self.saturated = 0
        self._world = world
        self._name = name
        self._robot = world.robots[name]
        self._limiter = SetPointLimiter(self._robot.limits, period, world.arms[name].q)
        self._motion: Motion | None = None
        self._retreat: Motion | None = None
        self._followed: Motion | None = None
        self._guard = Guard(world, name)
        self._hold = self.setpoint
        self._bind()

    @property
    def setpoint(self) -> SetPoint:
        """The last set-point that was sent: where the next motion has to begin."""
        return self._limiter.sent

    @property
    def clipped(self) -> int:
        """How many set-points broke a limit and were bent."""
        return self._limiter.clipped

    @property
    def guard(self) -> Mapping[str, Number]:
        """What the guard has seen and done so far, as in `GuardReport`."""
        return self._guard.report.as_dict()

    @property
    def motion(self) -> Motion | None:
        """What is being followed, None while holding."""
        return self._motion

    @property
    def at_rest(self) -> bool:
        """No motion is commanded and the arm stands still."""
        return self._motion is None and bool((np.abs(self._body.v) < _STANDSTILL).all())

    def follow(self, trajectory: Trajectory, *, along_path: bool = False) -> TrajectoryMotion:
        """Begin a motion; it must start where the last set-point was.

        Args:
            trajectory: From rest to rest.
            along_path: The tool's path matters, not only its end.

        Raises:
            Failure: ``TRACKING_ERROR`` if it starts elsewhere.
        """
        away = float(np.abs(trajectory.q[0] - self.setpoint.q).max())
        if away > 1e-6:
            raise Failure(
                "TRACKING_ERROR",
                f"the motion starts {np.degrees(away):.3g}° from where the arm is",
                start_error_rad=away,
            )
        motion = TrajectoryMotion(trajectory, along_path)
        self._motion, self.fault = motion, None
        self._followed = motion
        return motion

    def stream(self, source: Stream) -> None:
        """Follow a stream of set-points until ``stop``."""
        self._motion, self.fault = StreamMotion(source), None
        self._followed = self._motion

    def stop(self) -> None:
        """Brake with bounded jerk and hold; harmless at rest, and where the arm gives in anyway."""
        if self._motion is not None and self._motion is self._retreat:
            return
        sent = self.setpoint
        if not sent.v.any() and not sent.a.any():
            self._motion, self._hold = None, sent
            return
        on_path = None
        if isinstance(self._motion, TrajectoryMotion):
            on_path = self._motion.halt(self._robot.limits)
        if on_path is not None:
            self._go_on(on_path)
            return
        self._go_on(timing.stop(sent.q, sent.v, sent.a, self._robot.limits, self.period))

    def update(self, time: float) -> None:
        """Send the set-point for ``time`` and command the torques for the next step(s).

        Raises:
            DivergenceError: A torque is not a number.
        """
        if self._generation != self._world.generation:
            self._bind()
        if self._motion is not None and self._motion is self._followed and self._guard.due(time):
            self._heed(self._guard.look(self._motion, self.setpoint, time))
        sent = self._limiter.send(self._wanted(time))
        data, body = self._world.data, self._body
        error = sent.q - data.qpos[body.qpos_ids]
        if self._motion is not None:
            self._watch(error)
        lag = sent.v - self._half_step * sent.a - data.qvel[body.dof_ids]
        torque = self._torque(sent.a, (2 * BANDWIDTH) * lag + BANDWIDTH**2 * error)
        limit = self._robot.limits.effort
        if not (np.abs(torque) <= limit).all():
            if not np.isfinite(torque).all():
                raise DivergenceError(
                    f"the simulation diverged at {time:.3f} s: "
                    f"the torques of {self._name} are no numbers"
                )
            self.saturated += 1
            torque = self._within_effort(torque)
        data.ctrl[body.actuator_ids] = torque

    def _heed(self, refusal: Failure | None) -> None:
        """Give up the motion if the guard says so."""
        if refusal is None or self.fault is not None:
            return
        self.fault = refusal
        motion = self._motion
        if "depth_m" not in refusal.numbers:  # nothing is touched yet
            self.stop()
        elif isinstance(motion, TrajectoryMotion):  # back the way that it came
            self._give_in(motion.configuration(max(motion.place.s - BACK_OFF_S, 0.0)))
        else:
            self._give_in(self._body.q)

    def _wanted(self, time: float) -> SetPoint:
        motion = self._motion
        if motion is None:
            return self._hold
        if isinstance(motion, TrajectoryMotion):
            motion.executed.append(self._world.data.site_xpos[self._body.tool_site].copy())
        try:
            wanted = motion.next(time)
        except (Exception, SystemExit) as error:  # noqa: BLE001 - a skill may raise anything
            self.fault = error
            self.stop()
            return self._wanted(time)
        if motion.done:
            self._motion = None
            self._hold = SetPoint(wanted.q, np.zeros_like(wanted.q), np.zeros_like(wanted.q))
        return wanted

    def _watch(self, error: Vector) -> None:
        worst = float(np.abs(error).max())
        if worst > LEFT_BEHIND and self.fault is None:
            joint = self._robot.joints[int(np.argmax(np.abs(error)))]
            self.fault = Failure(
                "TRACKING_ERROR",
                f"joint {joint} is {np.degrees(worst):.1f}° behind its set-point: "
                "the arm is blocked or its torque does not suffice",
                joint_error_rad=worst,
            )
            self._give_in(self._body.q)

    def _give_in(self, place: Vector) -> None:
        """Brake, then let the set-point return to a place where the arm does not push."""
        limits, sent = self._robot.limits, self.setpoint
        here = np.clip(place, limits.lower, limits.upper)
        braking = timing.stop(sent.q, sent.v, sent.a, limits, self.period)
        self._go_on(braking.then(timing.point_to_point(braking.q[-1], here, limits, self.period)))
        self._retreat = self._motion

    def _go_on(self, motion: Trajectory) -> None:
        """Follow a motion whose first set-point is the one that was sent last."""
        self._motion = TrajectoryMotion(motion)
        self._motion.next(self._world.time)
        if self._motion.done:
            self._motion, self._hold = None, self.setpoint

    def _torque(self, meant: Vector, correction: Vector) -> Vector:
        """Torques, of shape (dof,), that give the joints both accelerations."""
        world, dofs = self._world, self._body.dof_ids
        self._wide[dofs] = meant + correction
        mujoco.mj_mulM(world.model, world.data, self._product, self._wide)
        torque: Vector = self._product[dofs] + world.data.qfrc_bias[dofs]
        for load in self._loads:
            torque += load.torque(meant + _LOAD_FEEDBACK * correction)
        return torque

    def _within_effort(self, wanted: Vector) -> Vector:
        """As much of the wanted torques as the joints can give, in their direction.

        Clipped joint by joint they would turn an arm that was knocked elsewhere, and feed it with
        energy until it whirls.
        """
        limit, nothing = self._robot.limits.effort, np.zeros_like(wanted)
        rest = self._torque(nothing, nothing)
        drive = wanted - rest
        if (np.abs(rest) > limit).any():  # so fast that no path can be held: brake, nothing else
            drive = self._torque(nothing, -2 * BANDWIDTH * self._body.v) - rest
            rest = nothing
        room = np.where(drive > 0.0, limit - rest, limit + rest)
        share = float((room / np.maximum(np.abs(drive), 1e-9)).min())
        within: Vector = np.clip(rest + min(1.0, share) * drive, -limit, limit)
        return within

    def _bind(self) -> None:
        """Look up what a recompilation of the world has moved."""
        world = self._world
        self._generation = world.generation
        self._body: ArmBody = world.arms[self._name]
        # MuJoCo's Euler steps end with the velocity that they had in their middle.
        self._half_step = 0.5 * world.timestep
        self._wide: Any = np.zeros(world.model.nv)
        self._product: Any = np.zeros(world.model.nv)
        held = world.attachments.attached_to(self._name)
        self._loads = [
            Load(world.model, world.data, world.object_body(thing), self._body) for thing in held
        ]
