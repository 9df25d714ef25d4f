"""What all leaves of one arm share: the arm's lease, its patience, the process that plans."""

from __future__ import annotations

from bt_dualarm.arm.carrying import Carrying
from bt_dualarm.arm.lease import Lease
from bt_dualarm.arm.patience import Patience
from bt_dualarm.arm.slip_response import SlipResponse
from bt_dualarm.arm.state import ArmState
from bt_dualarm.motion.control.controller import JointController
from bt_dualarm.motion.kinematics.arm_kinematics import Kinematics
from bt_dualarm.motion.planning.process import PlanningProcess
from bt_dualarm.world.cameras.camera import Camera
from bt_dualarm.world.touches import Touches
from bt_dualarm.world.world import World


class SharedArm:
    """One arm before it is in anybody's hands; `Arm` puts it into those of a leaf.

    Args:
        world: World that the arm is in.
        name: Name of the arm in the tree file.
        controller: Controller that follows what the skills ask for.
        camera: Camera of this arm, if it has one.
        seed: Seed of everything random in this arm's planning.
        planning: Process that looks for ways around what is in the way.
        touches: What the arms really touch, for scoring.

    Attributes:
        kinematics: Kinematics of the arm on its base.
        carrying: What it can carry.
        lease: Right to move the arm.
        patience: Time that the arm waits for another one.
        slip: Watch over what its gripper holds.
    """

    def __init__(
        self,
        world: World,
        name: str,
        controller: JointController,
        camera: Camera | None,
        seed: int,
        planning: PlanningProcess,
        touches: Touches,
    ) -> None:
        self.world = world
        self.name = name
        self.controller = controller
        self.camera = camera
        self.seed = seed
        self.planning = planning
        self.touches = touches
        self.kinematics = Kinematics(world.robots[name], world.arms[name].base, seed)
        self.carrying = Carrying(world, name)
        self.lease = Lease(name, lambda: controller.at_rest)
        self.patience = Patience(name, seed)
        self.slip = SlipResponse(ArmState(world, name, controller, self.kinematics))
