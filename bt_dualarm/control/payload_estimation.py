"""Payload estimation: mass and center of a held object from the motor torques.

- `PayloadEstimator` collects measurements while an arm moves, and reports masses.
- `TorqueRegressor` makes torques linear in the inertial parameters.
- `ParameterEstimate` is the Bayesian linear regression.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.control.dynamics import DRIVE_DELAY_S, ArmDynamics
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.sim.arm_models import NominalArm, NominalLoad
from bt_dualarm.trajectory.set_points import SetPoint

INERTIAL = 10
"""Inertial parameters of a rigid body: mass, first moment of mass (3), inertia about the origin of
its frame (6)."""

_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Rows and columns of the six inertia elements."""

# Prior standard deviations of the model parameters.

LINK_DOUBT: Final = 0.12
"""Relative deviation of a link's mass and inertia from the robot description: about that
of a uniform error of ±20 %."""

CENTER_DOUBT_M: Final = 0.003
"""Deviation of a link's center of mass along each axis, m."""

FRICTION_DOUBT: Final = 0.35
"""Relative deviation of dry and viscous friction: a cold joint or a warm one, uniform."""

GAIN_DOUBT: Final = 0.02
"""Relative deviation of a motor's torque constant."""

OFF_CENTER_M: Final = 0.005
"""Deviation of a load's center of mass from the center of its shape along each axis, m."""

_MASS_DOUBT_KG: Final = 5.0
"""Deviation of a load's mass of which nothing is known, kg."""

# Standard deviations of the measured torques of a window.

_NOISE: Final = 0.01
"""Torque noise as a fraction of the effort limit; part of it is correlated over many windows."""

_DYNAMIC_NOISE: Final = 0.5
"""Fraction of the inertial torque of acceleration changes within a window that counts as noise."""

_TRACKING_NOISE: Final = 2.0
"""Factor of the inertial torque of a deviation from the commanded acceleration."""

_STICTION_SPEED: Final = 0.05
"""Speed below which dry friction is unknown, rad/s. Its sign would be that of encoder noise, and it
keeps its value for many windows, which would count as evidence of another friction or weight."""

_MOVING: Final = 0.02
"""Speed of the fastest joint below which windows are skipped, rad/s: the arm may be in contact."""

# Windows: means over a few periods.

_WINDOW: Final = 5
"""Number of periods in a window."""

_MIDDLE: Final = 3
"""Period at whose start the state stands for the whole window."""

_SETTLING: Final = 5
"""Number of windows after a grasp that are skipped."""

_REPORT_EVERY: Final = 5
"""Number of windows between two reports."""

_KNOWN_SHARE: Final = 0.3
"""Relative deviation below which a mass is reported."""

_KNOWN_KG: Final = 0.05
"""Absolute deviation below which a mass is reported, kg."""

_OUTLIER: Final = 3.0
"""Deviations from the expected value beyond which a measurement has less weight."""

_EXPECTED_FOR: Final = 5
"""Windows for which an expectation is kept."""

_CHANGED: Final = 0.5
"""Change, in deviations, after which a mass is reported again."""

_IMPROVED: Final = 0.7
"""Share to which the deviation must shrink for a mass to be reported again."""


class PayloadEstimator:
    """Estimates model errors of an arm and mass and center of its loads from motor torques.

    Torques are linear in all uncertain parameters: masses, centers of mass and inertias of links,
    dry and viscous friction, rotor inertias, motor gains, and mass and first moment of each load.
    While the arm moves, all of them are estimated jointly by Bayesian linear regression (weights:
    Swevers et al., IEEE Trans. Robot. Autom. 1997). What was learned about the arm before a grasp
    therefore makes the estimate of the load more accurate.

    Args:
        nominal: Nominal model of the arm; loads without a declared mass are estimated.
        period: Seconds for which a torque is held.
    """

    def __init__(self, nominal: NominalArm, period: float) -> None:
        self._nominal = nominal
        self._regressor = TorqueRegressor(nominal)
        self._effort = nominal.robot.limits.effort
        self._doubts = [_doubts(numbers) for numbers in self._regressor.links]
        dof = len(self._effort)
        self._own = dof * (INERTIAL + 4)
        self._parameters = ParameterEstimate(self._own)
        self._loads: list[NominalLoad] = []  # loads of unknown mass
        self._reported: dict[str, NominalLoad] = {}
        self._dynamics = ArmDynamics(nominal)  # includes loads of declared mass
        self._estimated = self._dynamics  # includes estimated loads as well
        self._held: tuple[NominalLoad, ...] = ()
        self._commanded_a: list[Vector] = []
        self._torque_sum = np.zeros(dof)
        self._torque = np.zeros(dof)
        self._q = np.zeros(dof)
        self._v = np.zeros(dof)
        self._v_error = np.zeros(dof)
        self._v_error_before = np.zeros(dof)
        self._delay_share = DRIVE_DELAY_S / period
        self._window_s = _WINDOW * period
        self._windows = 0

    def update(self, q: Vector, v: Vector, sent: SetPoint, torque: Vector) -> bool:
        """Process one period; return whether a new estimate of a load was reported.

        Args:
            q: Positions at the end of the period, of shape (dof,), rad.
            v: Velocities then, of shape (dof,), rad/s.
            sent: Set-point of the period.
            torque: Torques that were commanded for it, of shape (dof,), N m.
        """
        self._v_error = v - sent.v
        if self._held is not self._nominal.loads:
            self._set_loads(self._nominal.loads)
            self._start_window()
            self._windows = -_SETTLING
            return False
        self._commanded_a.append(sent.a)
        # The drive delay: the previous torque still acts during the first part of the period.
        self._torque_sum = self._torque_sum + torque + self._delay_share * (self._torque - torque)
        self._torque = torque
        if len(self._commanded_a) == _MIDDLE:
            self._q = q
            self._v = v
        if len(self._commanded_a) < _WINDOW:
            return False
        commanded_a = np.array(self._commanded_a)
        a_error = (self._v_error - self._v_error_before) / self._window_s
        mean_torque = self._torque_sum / _WINDOW
        self._start_window()
        self._windows += 1
        if self._windows <= 0 or np.abs(self._v).max() < _MOVING:
            return False
        if not all(load.alone for load in self._held):  # another arm bears an unknown part
            return False
        window = self._measurements(self._q, self._v, commanded_a, a_error, mean_torque)
        self._parameters.measure(*window)
        return bool(self._loads) and self._windows % _REPORT_EVERY == 0 and self._report()

    def _start_window(self) -> None:
        """Start the next window."""
        self._commanded_a.clear()
        self._torque_sum = np.zeros_like(self._torque_sum)
        self._v_error_before = self._v_error

    def _measurements(
        self, q: Vector, v: Vector, commanded_a: Matrix, a_error: Vector, torque: Vector
    ) -> tuple[Matrix, Vector, Vector]:
        """Regressor, values and weights of one window, with a row per joint of known friction.

        Noise in the regressor would bias masses toward zero (errors in variables). It therefore
        contains nothing measured except q and v: accelerations are those commanded, torques those
        of the model. Where the arm deviates from them, by ``a_error`` in rad/s², the row has less
        weight: at first, an unknown load causes tracking errors.
        """
        friction = self._nominal.friction
        dof = len(q)
        a = commanded_a.mean(axis=0)
        links = self._regressor(q, v, a)
        own = [links[:, i] @ doubts for i, doubts in enumerate(self._doubts)]
        dry = friction.level(v) * friction.build_up(v)
        viscous = friction.viscous * v
        total = self._estimated.moving(q, v, a) + dry + viscous
        rotors = self._nominal.model.dof_armature * a
        shares = FRICTION_DOUBT * dry, FRICTION_DOUBT * viscous, LINK_DOUBT * rotors
        own += [np.diag(share) for share in (*shares, -GAIN_DOUBT * total)]
        loads = [links[:, -1] @ self._load_columns(load) for load in self._loads]
        dynamics = self._dynamics
        values = torque - dynamics.moving(q, v, a) - dry - viscous
        noise = _NOISE * self._effort
        dynamics.update(q, v)
        noise = noise + _DYNAMIC_NOISE * np.abs(dynamics.inertia) @ np.ptp(commanded_a, axis=0)
        noise = np.hypot(noise, _TRACKING_NOISE * dynamics.inertia_times(a_error))
        stuck = (np.abs(v) < _STICTION_SPEED) & (friction.rise <= 0.0) & (friction.static > 0.0)
        columns = np.column_stack((*own, *loads)).reshape(dof, -1)
        return columns[~stuck], values[~stuck], 1.0 / np.square(noise[~stuck])

    def _report(self) -> bool:
        """Pass sufficiently accurate masses to the nominal model, if they are new."""
        is_new = False
        for index, unknown in enumerate(self._loads):
            load = self._estimate(index)
            if load is not None and _is_new(load, self._reported.get(unknown.object)):
                self._reported[unknown.object] = load
                self._nominal.update_load(load)
                is_new = True
        if is_new:
            self._held = self._nominal.loads
            self._estimated = ArmDynamics(self._nominal, self._held)
        return is_new

    def _estimate(self, index: int) -> NominalLoad | None:
        """Current estimate of a load; None if its mass is not positive."""
        load = self._loads[index]
        mean, covariance = self._parameters.marginal(self._own + 4 * index, 4)
        if mean[0] <= 0.0:
            return None
        # The first moment was estimated with a prior for 1 kg. Its deviation grows with the mass,
        # which is known only now: replace that prior by the one for the estimated mass.
        prior = np.diag((0.0, *np.full(3, (mean[0] * _MASS_DOUBT_KG) ** -2.0 - 1.0)))
        information = np.linalg.inv(covariance)
        covariance = np.linalg.inv(information + prior)
        mean = covariance @ information @ mean
        mass = float(mean[0]) * _MASS_DOUBT_KG
        doubts = np.sqrt(np.diag(covariance))
        if mass <= 0.0:
            return None
        to_tool = self._regressor.tool_link.inverse
        shift = to_tool.turn(mean[1:] * OFF_CENTER_M / mass)
        return replace(
            load,
            mass=mass,
            inertia=mass * load.gyration,
            pose=load.pose.shifted(shift),
            mass_doubt=float(doubts[0]) * _MASS_DOUBT_KG,
            center_doubt=float(doubts[1:].max()) * OFF_CENTER_M / mass,
        )

    def _set_loads(self, loads: tuple[NominalLoad, ...]) -> None:
        """Estimate the loads of unknown mass among those that the arm holds now."""
        self._held = loads
        unknown = {load.object: load for load in loads if not load.mass_declared}
        for index in reversed(range(len(self._loads))):
            if self._loads[index].object not in unknown:
                self._parameters.drop(self._own + 4 * index, 4)
                self._reported.pop(self._loads.pop(index).object, None)
        estimated = [load.object for load in self._loads]
        for name, load in unknown.items():
            if name not in estimated:
                self._loads.append(load)
                self._parameters.add(4)
        self._dynamics = ArmDynamics(self._nominal, [load for load in loads if load.mass_declared])
        self._estimated = ArmDynamics(self._nominal, loads)

    def _load_columns(self, load: NominalLoad) -> Matrix:
        """Inertial parameters per prior deviation of a load's mass and first moment, (10, 4)."""
        pose = self._regressor.tool_link @ load.pose
        columns = np.zeros((INERTIAL, 4))
        columns[:, 0] = inertial_parameters(_MASS_DOUBT_KG, _MASS_DOUBT_KG * load.gyration, pose)
        columns[1:4, 1:] = OFF_CENTER_M * np.eye(3)
        return columns


def _is_new(load: NominalLoad, reported: NominalLoad | None) -> bool:
    """Whether an estimate is accurate enough, and differs from or improves the reported one."""
    mass = load.mass or 0.0
    doubt = load.mass_doubt
    if doubt > max(_KNOWN_SHARE * mass, _KNOWN_KG):
        return False
    if reported is None:
        return True
    changed = abs(mass - (reported.mass or 0.0)) > _CHANGED * doubt
    return changed or doubt < _IMPROVED * reported.mass_doubt


def _doubts(link: Vector) -> Matrix:
    """Inertial parameters per prior deviation of a link, a column per parameter, (10, 10)."""
    mass = float(link[0])
    spread = float(link[4:7].max())
    columns = np.zeros((INERTIAL, INERTIAL))
    columns[:, 0] = LINK_DOUBT * link
    columns[1:4, 1:4] = CENTER_DOUBT_M * mass * np.eye(3)
    columns[4:, 4:] = LINK_DOUBT * spread * np.eye(INERTIAL - 4)
    return columns


class TorqueRegressor:
    """Regressor of an arm's inverse dynamics: torques are linear in the inertial parameters.

    See Khalil and Dombre, Modeling, Identification and Control of Robots, 9.4. Bodies that are
    rigidly connected count as one link, in the frame of the one with the joint.

    Args:
        nominal: Nominal model of the arm.

    Attributes:
        links: Inertial parameters of the links by the robot description, of shape (dof, 10).
        tool_link: Pose of the tool's body in the frame of the last link.
    """

    def __init__(self, nominal: NominalArm) -> None:
        self._model = model = nominal.model
        self._data = data = mujoco.MjData(model)
        self._bodies = model.jnt_bodyid.tolist()
        mujoco.mj_kinematics(model, data)
        self.links = np.zeros((model.nv, INERTIAL))
        for body, row in self._rigid_parts():
            mass = float(model.body_mass[body])
            inertia = model.body_inertia[body]
            own = Pose(model.body_ipos[body], model.body_iquat[body])
            self.links[row] += inertial_parameters(mass, inertia, self._in_link(row, body) @ own)
        self.tool_link = self._in_link(model.nv - 1, nominal.tool_body)

    def __call__(self, q: Vector, v: Vector, a: Vector) -> npt.NDArray[np.float64]:
        """Regressor at a state, of shape (dof, links, 10), SI units.

        The sum over links and parameters of regressor times parameter is the torque of each joint.

        Args:
            q: Joint positions, of shape (dof,), rad.
            v: Joint velocities, of shape (dof,), rad/s.
            a: Joint accelerations, of shape (dof,), rad/s².
        """
        model = self._model
        data = self._data
        dof = self._model.nv
        data.qpos[:] = q
        data.qvel[:] = v
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        jacobian, change = np.zeros((2, dof, 6, dof))
        for row, body in enumerate(self._bodies):
            mujoco.mj_jacBody(model, data, jacobian[row, :3], jacobian[row, 3:], body)
            point = data.xpos[body]
            mujoco.mj_jacDot(model, data, change[row, :3], change[row, 3:], point, body)
        axes = data.xmat[self._bodies].reshape(dof, 3, 3)
        acceleration = (jacobian @ a + change @ v).reshape(dof, 2, 3) @ axes
        linear = acceleration[:, 0] - model.opt.gravity @ axes
        turning = acceleration[:, 1]
        spinning = (jacobian[:, 3:] @ v)[:, None] @ axes
        # Newton-Euler in link frames, where the inertial parameters are constant.
        wrench = _wrenches(linear, turning, spinning[:, 0])
        in_world = axes[:, None] @ wrench.reshape(dof, 2, 3, INERTIAL)
        # Virtual work: a wrench on a link acts on the joints by the link's transposed Jacobian.
        columns: npt.NDArray[np.float64] = np.einsum(
            "bij,bik->jbk", jacobian, in_world.reshape(dof, 6, INERTIAL)
        )
        return columns

    def _rigid_parts(self) -> Iterator[tuple[int, int]]:
        """Pairs of a moving body and the index of the link that it belongs to."""
        for body, root in enumerate(self._model.body_weldid.tolist()):
            if root in self._bodies:
                yield body, self._bodies.index(root)

    def _in_link(self, row: int, body: int) -> Pose:
        """Pose of a body in the frame of the link that it belongs to."""
        data = self._data
        link = self._bodies[row]
        frame = Pose(data.xpos[link].copy(), data.xquat[link].copy())
        return frame.inverse @ Pose(data.xpos[body].copy(), data.xquat[body].copy())


def inertial_parameters(mass: float, moments: Vector, pose: Pose) -> Vector:
    """Inertial parameters of a body in a frame, of shape (10,).

    Args:
        mass: Mass, kg.
        moments: Principal moments of inertia about its center of mass, of shape (3,), kg m².
        pose: Pose of its center of mass and principal axes in the frame.
    """
    rotation = pose.rotation_matrix
    center = pose.position
    inertia = rotation @ np.diag(moments) @ rotation.T
    inertia += mass * (float(center @ center) * np.eye(3) - np.outer(center, center))
    return np.array([mass, *(mass * center), *(inertia[i, j] for i, j in _PAIRS)])


def _wrenches(linear: Matrix, turning: Matrix, spinning: Matrix) -> npt.NDArray[np.float64]:
    """Wrenches per unit of each inertial parameter: the Newton-Euler equations in link frames.

    ``f = m a + w' x c + w x (w x c)`` and ``n = c x a + I w' + w x (I w)`` with c the first moment.

    Args:
        linear: Accelerations of the link origins less gravity, of shape (n, 3), m/s².
        turning: Angular accelerations w', of the same shape, rad/s².
        spinning: Angular velocities w, of the same shape, rad/s.

    Returns:
        Forces and moments about the link origins, in link axes, of shape (n, 6, 10).
    """
    wrench = np.zeros((len(linear), 6, INERTIAL))
    wrench[:, :3, 0] = linear
    spin = _cross(spinning)
    wrench[:, :3, 1:4] = _cross(turning) + spin @ spin
    wrench[:, 3:, 1:4] = -_cross(linear)
    wrench[:, 3:, 4:] = _inertia_times(turning) + spin @ _inertia_times(spinning)
    return wrench


def _cross(vectors: Matrix) -> npt.NDArray[np.float64]:
    """Cross-product matrices, of shape (n, 3, 3), of vectors of shape (n, 3)."""
    matrices = np.zeros((len(vectors), 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrices[:, k, j] = vectors[:, i]
        matrices[:, j, k] = -vectors[:, i]
    return matrices


def _inertia_times(vectors: Matrix) -> npt.NDArray[np.float64]:
    """Matrices, of shape (n, 3, 6), whose product with the inertia elements is I times a vector."""
    matrices = np.zeros((len(vectors), 3, len(_PAIRS)))
    for column, (i, j) in enumerate(_PAIRS):
        matrices[:, i, column] = vectors[:, j]
        if i != j:
            matrices[:, j, column] = vectors[:, i]
    return matrices


class ParameterEstimate:
    """Bayesian linear regression in information form; parameters can be added and removed.

    Each parameter is scaled by its prior standard deviation: its prior is normal with mean 0 and
    deviation 1.

    Measurements far from what is expected count less, as in robust filters (Masreliez and Martin,
    IEEE Trans. Autom. Control 1977): an arm that rubs against something would otherwise take that
    for friction or weight, and be sure of it.

    Args:
        count: Initial number of parameters.
    """

    def __init__(self, count: int) -> None:
        self._information = np.eye(count)
        self._vector = np.zeros(count)
        self._mean = np.zeros(count)
        self._covariance = np.eye(count)
        self._age = 0  # measurements since mean and covariance were computed; 0 to compute them

    def measure(self, columns: Matrix, values: Vector, weights: Vector) -> None:
        """Add measurements ``values = columns @ parameters + noise``.

        Args:
            columns: Regressor, of shape (n, count).
            values: Measured values, of shape (n,).
            weights: Inverse variance of each, of shape (n,).
        """
        if self._age == 0:
            self._covariance = np.asarray(np.linalg.inv(self._information), dtype=np.float64)
            self._mean = self._covariance @ self._vector
        self._age = (self._age + 1) % _EXPECTED_FOR
        spread = 1.0 / weights + np.einsum("ij,ij->i", columns @ self._covariance, columns)
        surprise = np.abs(values - columns @ self._mean) / np.sqrt(spread)
        weights = weights * np.square(_OUTLIER / np.maximum(surprise, _OUTLIER))
        weighted = columns.T * weights
        self._information += weighted @ columns
        self._vector += weighted @ values

    def add(self, count: int) -> None:
        """Append parameters with their prior."""
        old = self._information
        size = len(self._vector) + count
        self._information = np.eye(size)
        self._information[: len(old), : len(old)] = old
        self._vector = np.concatenate((self._vector, np.zeros(count)))
        self._age = 0

    def drop(self, first: int, count: int) -> None:
        """Marginalize parameters: what they imply about the others is kept (Schur complement)."""
        gone = np.zeros(len(self._vector), dtype=bool)
        gone[first : first + count] = True
        shared = self._information[np.ix_(~gone, gone)]
        gain = np.linalg.solve(self._information[np.ix_(gone, gone)], shared.T).T
        self._age = 0
        self._vector = self._vector[~gone] - gain @ self._vector[gone]
        self._information = self._information[np.ix_(~gone, ~gone)] - gain @ shared.T

    def marginal(self, first: int, count: int) -> tuple[Vector, Matrix]:
        """Mean and covariance of ``count`` parameters, of shapes (count,) and (count, count)."""
        part = slice(first, first + count)
        # One solution for both: information @ mean = vector, information @ covariance = identity.
        identity = np.eye(len(self._vector))[:, part]
        columns = np.column_stack((self._vector, identity))
        found = np.asarray(np.linalg.solve(self._information, columns)[part], dtype=np.float64)
        return found[:, 0], found[:, 1:]
