"""Mass and centre of what an arm holds, told by the torques of its motors as it moves."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from bt_dualarm.motion.control.dynamics import ArmDynamics
from bt_dualarm.motion.control.law import DRIVE_DELAY_S
from bt_dualarm.motion.identification.beliefs import Beliefs
from bt_dualarm.motion.identification.regressor import INERTIAL, TorqueRegressor, inertial_numbers
from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.world.nominal.nominal_arm import NominalArm
from bt_dualarm.world.nominal.nominal_load import NominalLoad

LINK_DOUBT: Final = 0.12
"""Deviation of a link's mass and inertia from its page, as a share: half a CAD model, uniform."""

CENTER_DOUBT_M: Final = 0.003
"""Deviation of a link's centre of mass along each axis, m."""

FRICTION_DOUBT: Final = 0.35
"""Deviation of dry and of viscous friction, as a share: cold against warm, uniform."""

GAIN_DOUBT: Final = 0.02
"""Deviation of a motor's torque, as a share."""

OFF_CENTER_M: Final = 0.005
"""Deviation of a load's centre of mass from that of its shape along each axis, m."""

_HEAVIEST: Final = 5.0  # kg; deviation of a mass of which nothing is known
_NOISE: Final = (
    0.01  # of a torque over a window, as a share of the effort; some of it stays for many
)
_STUCK: Final = 0.05  # rad/s, below which dry friction may be anything
_CHANGING: Final = 0.5  # of the torques of a change of acceleration in a window, that are noise
_MISSED: Final = 2.0  # times what the arm did otherwise than it was meant to
_MOVING: Final = 0.02  # rad/s; an arm that stands may lean on something
_WINDOW: Final = 5  # periods that are averaged
_MIDDLE: Final = 3  # period at whose beginning the state is that of the window
_SETTLING: Final = 5  # windows after a grasp that do not count
_EVERY: Final = 5  # windows from one telling to the next
_TOLD: Final = 0.3  # share of a mass to which it must be known to be told, or
_TOLD_KG: Final = 0.05
_NEWS: Final = 0.5  # deviations by which a mass must have changed to be told anew, or
_BETTER: Final = 0.7  # share of its deviation


class Weighing:
    """What the torques tell of an arm that is not its page, and of what it holds.

    Torques are linear in all that is doubted: the links' masses, centres and inertias, dry and
    viscous friction, rotors, the gain of the motors, and mass and first moment of each load.
    As long as the arm moves all of them are estimated together by least squares with a prior
    (Bayesian linear regression; Swevers et al., IEEE Trans. Robot. Autom. 1997, for the weights).
    What the arm has learnt of itself before it took hold of something is what it weighs it by.

    Args:
        nominal: What is believed of the arm; the loads that it was told no mass of are weighed.
        period: Seconds for which a torque is held.
    """

    def __init__(self, nominal: NominalArm, period: float) -> None:
        self._nominal = nominal
        self._regressor = TorqueRegressor(nominal)
        self._effort = nominal.robot.limits.effort
        self._doubts = [_doubts(numbers) for numbers in self._regressor.links]
        dof = len(self._effort)
        self._own = dof * (INERTIAL + 4)
        self._beliefs = Beliefs(self._own)
        self._loads: list[NominalLoad] = []
        self._told: dict[str, NominalLoad] = {}
        self._dynamics = self._believed = ArmDynamics(nominal)
        self._held: tuple[NominalLoad, ...] = ()
        self._asked: list[Vector] = []
        self._sums, self._torque, self._q, self._v, self._off, self._was_off = np.zeros((6, dof))
        self._late = DRIVE_DELAY_S / period
        self._window_s = _WINDOW * period
        self._windows = 0

    def take(self, q: Vector, v: Vector, sent: SetPoint, torque: Vector) -> bool:
        """Take up a period; whether more is known of what the arm holds.

        Args:
            q: Positions at its end, of shape (dof,), rad.
            v: Velocities then, likewise.
            sent: What was meant.
            torque: Torques that were commanded for it, of shape (dof,), N m.
        """
        self._off = v - sent.v
        if self._held is not self._nominal.loads:
            self._take_up(self._nominal.loads)
            self._begin()
            self._windows = -_SETTLING
            return False
        self._asked.append(sent.a)
        self._sums = self._sums + torque + self._late * (self._torque - torque)
        self._torque = torque
        if len(self._asked) == _MIDDLE:
            self._q, self._v = q, v
        if len(self._asked) < _WINDOW:
            return False
        asked, missed = np.array(self._asked), (self._off - self._was_off) / self._window_s
        mean = self._sums / _WINDOW
        self._begin()
        self._windows += 1
        if self._windows <= 0 or np.abs(self._v).max() < _MOVING:
            return False
        self._beliefs.measure(*self._measurements(self._q, self._v, asked, missed, mean))
        return bool(self._loads) and self._windows % _EVERY == 0 and self._tell()

    def _begin(self) -> None:
        """Begin a window."""
        self._asked.clear()
        self._sums = np.zeros_like(self._sums)
        self._was_off = self._off

    def _measurements(
        self, q: Vector, v: Vector, asked: Matrix, missed: Vector, torque: Vector
    ) -> tuple[Matrix, Vector, Vector]:
        """Columns, values and weights of one window, a row a joint.

        Nothing in the columns is measured but where the arm is, for noise in them would be taken
        for less mass: accelerations are those that were meant, torques those of the model.
        Where the arm did otherwise, by ``missed`` rad/s², the row counts for less: a load that
        nobody has told of pulls it off its way at first.
        """
        friction, dof, a = self._nominal.friction, len(q), asked.mean(axis=0)
        links = self._regressor(q, v, a)
        own = [links[:, i] @ doubts for i, doubts in enumerate(self._doubts)]
        dry = friction.level(v) * friction.build_up(v)
        viscous = friction.viscous * v
        whole = self._believed.moving(q, v, a) + dry + viscous
        rotors = self._nominal.model.dof_armature * a
        shares = FRICTION_DOUBT * dry, FRICTION_DOUBT * viscous, LINK_DOUBT * rotors
        own += [np.diag(share) for share in (*shares, -GAIN_DOUBT * whole)]
        loads = [links[:, -1] @ self._load_columns(load) for load in self._loads]
        dynamics = self._dynamics
        values = torque - dynamics.moving(q, v, a) - dry - viscous
        noise = _NOISE * self._effort
        dynamics.update(q, v)
        noise = noise + _CHANGING * np.abs(dynamics.inertia) @ np.ptp(asked, axis=0)
        noise = np.hypot(noise, _MISSED * dynamics.inertia_times(missed))
        stuck = (np.abs(v) < _STUCK) & (friction.rise <= 0.0)
        noise = noise + np.where(stuck, np.maximum(friction.static, friction.coulomb), 0.0)
        return np.column_stack((*own, *loads)).reshape(dof, -1), values, 1.0 / np.square(noise)

    def _tell(self) -> bool:
        """Let the nominal arm know the masses that are known well enough, if they are news."""
        news = False
        for index, weighed in enumerate(self._loads):
            load = self._estimate(index)
            if load is not None and _is_news(load, self._told.get(weighed.object)):
                self._told[weighed.object] = load
                self._nominal.weigh(load)
                news = True
        if news:
            self._held = self._nominal.loads
            self._believed = ArmDynamics(self._nominal, self._held)
        return news

    def _estimate(self, index: int) -> NominalLoad | None:
        """What is known of a load by now; None of one that seems to weigh nothing."""
        load = self._loads[index]
        mean, covariance = self._beliefs.told(self._own + 4 * index, 4)
        if mean[0] <= 0.0:
            return None
        # How far the centre may be off grows with the mass, which is known only now.
        prior = np.diag((0.0, *np.full(3, (mean[0] * _HEAVIEST) ** -2.0 - 1.0)))
        information = np.linalg.inv(covariance)
        covariance = np.linalg.inv(information + prior)
        mean = covariance @ information @ mean
        mass, doubts = float(mean[0]) * _HEAVIEST, np.sqrt(np.diag(covariance))
        if mass <= 0.0:
            return None
        to_tool = self._regressor.tool_link.inverse
        shift = to_tool.turn(mean[1:] * OFF_CENTER_M / mass)
        return replace(
            load,
            mass=mass,
            inertia=mass * load.gyration,
            pose=Pose(load.pose.position + shift, load.pose.quaternion),
            mass_doubt=float(doubts[0]) * _HEAVIEST,
            center_doubt=float(doubts[1:].max()) * OFF_CENTER_M / mass,
        )

    def _take_up(self, loads: tuple[NominalLoad, ...]) -> None:
        """Reckon with what the arm holds now."""
        self._held = loads
        unknown = {load.object: load for load in loads if not load.is_told}
        for index in reversed(range(len(self._loads))):
            if self._loads[index].object not in unknown:
                self._beliefs.drop(self._own + 4 * index, 4)
                self._told.pop(self._loads.pop(index).object, None)
        weighed = [load.object for load in self._loads]
        for name, load in unknown.items():
            if name not in weighed:
                self._loads.append(load)
                self._beliefs.add(4)
        self._dynamics = ArmDynamics(self._nominal, [load for load in loads if load.is_told])
        self._believed = ArmDynamics(self._nominal, loads)

    def _load_columns(self, load: NominalLoad) -> Matrix:
        """Inertial numbers of a load's mass and of the three parts of its centre's offset."""
        at = self._regressor.tool_link @ load.pose
        columns = np.zeros((INERTIAL, 4))
        columns[:, 0] = inertial_numbers(_HEAVIEST, _HEAVIEST * load.gyration, at)
        columns[1:4, 1:] = OFF_CENTER_M * np.eye(3)
        return columns


def _is_news(load: NominalLoad, told: NominalLoad | None) -> bool:
    """Whether a load is known well enough, and otherwise or better than it was told."""
    mass, doubt = load.mass or 0.0, load.mass_doubt
    if doubt > max(_TOLD * mass, _TOLD_KG):
        return False
    if told is None:
        return True
    return abs(mass - (told.mass or 0.0)) > _NEWS * doubt or doubt < _BETTER * told.mass_doubt


def _doubts(link: Vector) -> Matrix:
    """Inertial numbers, of shape (10, 10), by which a link may be off: a column a doubt."""
    mass, spread = float(link[0]), float(link[4:7].max())
    columns = np.zeros((INERTIAL, INERTIAL))
    columns[:, 0] = LINK_DOUBT * link
    columns[1:4, 1:4] = CENTER_DOUBT_M * mass * np.eye(3)
    columns[4:, 4:] = LINK_DOUBT * spread * np.eye(INERTIAL - 4)
    return columns
