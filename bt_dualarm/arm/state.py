"""The state of an arm, the lease to move it, and its contacts."""

from __future__ import annotations

import threading
import zlib
from collections.abc import Callable, Collection

import numpy as np

from bt_dualarm.control.computed_torque import tool_wrench
from bt_dualarm.control.controller import JointController
from bt_dualarm.core.errors import Failure, Number, SkillError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.robot import JointLimits, Robot
from bt_dualarm.sim.arm_models import NominalLoad
from bt_dualarm.sim.contact_monitor import ContactMonitor, Contacts
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.set_points import SetPoint

BACKOFF_S = (0.5, 2.0)
"""Range of simulated seconds that an arm waits for another one to leave its path."""


class ArmState:
    """Measured and commanded state of an arm; all poses are of the tool frame, in the world.

    Args:
        world: World of the arm, for measurements and objects. Do not read the pose of an object
            that a camera has to find.
        name: Name of the arm in the tree file.
        controller: Controller that follows the motions of the skills.
        kinematics: Kinematics of the arm on its base.
    """

    def __init__(
        self, world: World, name: str, controller: JointController, kinematics: Kinematics
    ) -> None:
        self.world = world
        self.name = name
        self.controller = controller
        self.kinematics = kinematics

    @property
    def robot(self) -> Robot:
        """Description of the robot."""
        return self.world.robots[self.name]

    @property
    def is_present(self) -> bool:
        """Whether the arm is in the world; its own leaf may have removed it."""
        return self.name in self.world.arms

    @property
    def period(self) -> float:
        """Seconds between two set-points."""
        return self.controller.period

    @property
    def time(self) -> float:
        """Simulated time in seconds."""
        return self.world.time

    @property
    def setpoint(self) -> SetPoint:
        """Copy of the last set-point that was sent: motions begin there."""
        return self.controller.setpoint.copy()

    @property
    def q(self) -> Vector:
        """Copy of the measured joint angles, of shape (dof,), rad."""
        return self.world.hardware[self.name].q.copy()

    @property
    def tool_pose(self) -> Pose:
        """Measured pose of the tool, from the encoders."""
        return self.world.nominal[self.name].tool_pose_at(self.q)

    @property
    def commanded_tool_pose(self) -> Pose:
        """Pose of the tool at the last set-point: free of the servo error, so plans start here."""
        return self.kinematics.forward(self.setpoint.q)

    @property
    def external_torque(self) -> Vector:
        """Estimated external joint torques, of shape (dof,), N m; unmodeled friction included."""
        return self.controller.touch.torque

    @property
    def external_wrench(self) -> Vector:
        """Force in N, then moment in N m about the tool, in the world, of shape (6,).

        It explains `external_torque` best under the assumption that all of it acts on the tool.
        """
        return tool_wrench(self.world.nominal[self.name], self.q, self.external_torque)

    @property
    def held(self) -> tuple[str, ...]:
        """Names of the objects that are attached to the tool or gripped."""
        return self.world.attachments.attached_to(self.name)

    @property
    def payload(self) -> tuple[NominalLoad, ...]:
        """Held loads, with the declared mass and center or with those that the arm estimated."""
        return self.world.nominal[self.name].loads

    def limits(self, speed: float) -> JointLimits:
        """Joint limits with velocity, acceleration and jerk times ``speed``.

        Raises:
            ValueError: The speed is not above 0 to 1.
        """
        if not 0.0 < speed <= 1.0:
            raise ValueError(f"speed {speed} is not a fraction of the arm's limits, above 0 to 1")
        return self.robot.limits.scaled(speed)

    def posture(self, name: str) -> Vector:
        """Joint angles, of shape (dof,), rad, of a named posture of the robot.

        Raises:
            Failure: ``INVALID_TARGET`` with the names of the postures that exist.
        """
        postures = self.robot.postures
        if name not in postures:
            known = ", ".join(postures)
            raise Failure("INVALID_TARGET", f"{self.robot.name} has no posture {name!r}: {known}")
        return postures[name]


class Lease:
    """Right to move an arm, shared by its leaves: one of them has it at a time.

    Args:
        arm: Name of the arm.
        at_rest: Whether the arm is at rest; then another leaf may take the lease over.
    """

    def __init__(self, arm: str, at_rest: Callable[[], bool]) -> None:
        self._arm = arm
        self._at_rest = at_rest
        self._holder: Leaseholder | None = None

    def for_leaf(self, leaf: str) -> Leaseholder:
        """A new holder, without the lease; two holders of one name are distinct."""
        return Leaseholder(self, leaf)

    def is_held_by(self, holder: Leaseholder) -> bool:
        """Whether this holder has the lease."""
        return self._holder is holder

    def refuse_others_than(self, holder: Leaseholder) -> None:
        """Check that this holder may move the arm.

        Raises:
            Failure: ``BUSY`` when another one has the lease and the arm is not at rest.
        """
        other = self._holder
        if other is not None and other is not holder and not self._at_rest():
            raise Failure("BUSY", f"{other.leaf} is already moving {self._arm}", owner=other.leaf)

    def take(self, holder: Leaseholder) -> None:
        """Give the lease to this holder; repeated calls change nothing.

        Raises:
            Failure: ``BUSY``, as `refuse_others_than`.
        """
        self.refuse_others_than(holder)
        self._holder = holder

    def give_back(self, holder: Leaseholder) -> bool:
        """Free the lease if this holder has it; returns whether it had."""
        held = self.is_held_by(holder)
        if held:
            self._holder = None
        return held


class Leaseholder:
    """A leaf's access to the lease of its arm.

    Only the thread that ticks the leaf may drive the arm: commands of another thread would come at
    a moment that no seed decides, and the run would not repeat.

    Args:
        lease: Lease of the arm.
        leaf: Path of the leaf in its tree, for messages.

    Attributes:
        intrusion: Message about another thread's attempt, with which the leaf fails.
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
        """Register the calling thread as the one that ticks or halts the leaf.

        Args:
            anew: Whether a new run of the leaf begins, which an earlier intrusion does not
                affect.
        """
        self._thread = threading.get_ident()
        if anew:
            self.intrusion = ""

    def refuse_other_threads(self) -> None:
        """Check that the calling thread is the one that ticks the leaf.

        Raises:
            SkillError: It is another one; the leaf will fail with this error, too.
        """
        if self._thread not in (None, threading.get_ident()):
            self.intrusion = (
                f"{self.leaf} commands its arm from thread {threading.current_thread().name!r}: "
                "a skill may command it only within its ticks; let run() yield, start no threads"
            )
            raise SkillError(self.intrusion)

    def refuse_if_busy(self) -> None:
        """Check that this leaf may move the arm.

        Raises:
            Failure: ``BUSY`` when another leaf moves it.
            SkillError: The calling thread is not the one that ticks the leaf.
        """
        self.refuse_other_threads()
        self._lease.refuse_others_than(self)

    def take(self) -> None:
        """Take the lease; repeated calls change nothing.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm.
            SkillError: The calling thread is not the one that ticks the leaf.
        """
        self.refuse_other_threads()
        self._lease.take(self)

    def give_back(self) -> bool:
        """Give the lease back; returns whether this leaf had it.

        Raises:
            SkillError: The calling thread is not the one that ticks the leaf.
        """
        self.refuse_other_threads()
        return self._lease.give_back(self)


class Backoff:
    """Random waiting time of an arm, so that two arms in each other's way retry at different times.

    Args:
        arm: Name of the arm.
        seed: Random seed in the run.

    Attributes:
        rng: Random generator, also for other choices of an arm that waits.
        seconds: Simulated seconds of the current wait.
    """

    def __init__(self, arm: str, seed: int) -> None:
        self.rng = np.random.default_rng([seed, zlib.crc32(arm.encode())])
        self.seconds = 0.0
        self.renew()

    def renew(self) -> float:
        """Draw and return the seconds of the next wait."""
        self.seconds = float(self.rng.uniform(*BACKOFF_S))
        return self.seconds


class ArmContacts:
    """True contacts during one leaf's motions: a score that nothing that moves the arm can read.

    Args:
        contacts: Contacts of all arms.
        arm: Name of the arm.
    """

    def __init__(self, contacts: Contacts, arm: str) -> None:
        self._contacts = contacts
        self._arm = arm
        self._monitor: ContactMonitor | None = None

    def begin(self) -> None:
        """Start to monitor, as the leaf begins to move the arm; repeated calls change nothing."""
        if self._monitor is None:
            self._monitor = self._contacts.watch(self._arm)

    def end(self, asked: Collection[str]) -> dict[str, Number]:
        """Stop to monitor; returns metrics of the contacts, none if nothing was touched.

        Args:
            asked: Names of the objects that the leaf was asked to handle: those do not count, and
                neither does what moves on their joints, such as the door of a named handle.
        """
        if self._monitor is None:
            return {}
        monitor = self._monitor
        self._monitor = None
        self._contacts.end(monitor)
        forces = {
            name: force
            for name, force in monitor.forces_n.items()
            if name not in asked and name.partition(".")[0] not in asked
        }
        if not forces:
            return {}
        hardest_first = sorted(forces, key=lambda name: (-forces[name], name))
        return {"touched": ", ".join(hardest_first), "touch_force_n": max(forces.values())}
