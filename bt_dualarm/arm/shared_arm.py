"""An arm with what all leaves of its tree share."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from bt_dualarm.arm.known_objects import KnownObjects
from bt_dualarm.arm.payload import PayloadCheck
from bt_dualarm.arm.slip_response import SlipResponse
from bt_dualarm.arm.state import ArmState, Backoff, Lease
from bt_dualarm.arm.traffic import Traffic
from bt_dualarm.control.controller import JointController
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.planning.process import PlanningProcess
from bt_dualarm.sim.camera import Camera
from bt_dualarm.sim.contact_monitor import Contacts
from bt_dualarm.sim.world import World


class SharedArm(ArmState):
    """An arm with what all leaves of its tree share.

    Args:
        world: World that the arm is in.
        name: Name of the arm in the tree file.
        controller: Controller that follows the motions of the skills.
        camera: Camera of this arm, if it has one.
        seed: Random seed in this arm's planning.
        planning: Process that searches for collision-free paths.
        touches: True contacts of the arms, for scoring.
        traffic: Right of way among the arms of the run.
        controllers: Controllers of all arms of the run, by the arm's name.
        no_plan: Name of the injected fault by which the planner finds no path now, or empty.

    Attributes:
        carrying: Check of loads and motions against what the arm can carry.
        known: Where the arm believes objects to be.
        lease: Right to move the arm.
        patience: Backoff while another arm is in the way.
        slip: Slip response of the gripper.
        unfinished: Whether a leaf was halted or failed since the last motion began: the gripper may
            still open.
    """

    def __init__(
        self,
        world: World,
        name: str,
        controller: JointController,
        camera: Camera | None,
        seed: int,
        planning: PlanningProcess,
        touches: Contacts,
        traffic: Traffic,
        controllers: Mapping[str, JointController],
        no_plan: Callable[[], str] = str,
    ) -> None:
        kinematics = Kinematics(world.robots[name], world.arms[name].base, seed)
        super().__init__(world, name, controller, kinematics)
        self.camera = camera
        self.seed = seed
        self.planning = planning
        self.no_plan = no_plan
        self.touches = touches
        self.traffic = traffic
        self.controllers = controllers
        self.carrying = PayloadCheck(world, name)
        self.known = KnownObjects(world, name)
        self.lease = Lease(name, lambda: controller.at_rest)
        self.patience = Backoff(name, seed)
        self.slip = SlipResponse(world, name, controller, self.known)
        self.unfinished = False
