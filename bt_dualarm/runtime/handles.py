"""The arms and trees of a run that goes on, to be looked at between two steps."""

from __future__ import annotations

from bt_dualarm.pose import Pose, Vector
from bt_dualarm.runtime.arms import Arms
from bt_dualarm.runtime.outcome import Outcome
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.tree.report import NodeView, StatusName
from bt_dualarm.world.arm_body import ArmBody
from bt_dualarm.world.names import must_be_among
from bt_dualarm.world.world import World


class ArmHandle:
    """One arm of a run, as it is now.

    Args:
        name: Name of the arm in the file.
        world: The world that it is in, or may come into.
        arms: The arms of the run.

    Attributes:
        name: Name of the arm in the file.
    """

    def __init__(self, name: str, world: World, arms: Arms) -> None:
        self.name = name
        self._world = world
        self._arms = arms

    @property
    def robot(self) -> str:
        """Its name in the catalogue, or the title of a page beside the tree file."""
        return self._arms.view(self.name).robot

    @property
    def is_present(self) -> bool:
        """Whether it is in the world."""
        return self.name in self._world.arms

    @property
    def outcome(self) -> Outcome | None:
        """How its tree ended in its present life, None while it runs or has not begun."""
        return self._arms.view(self.name).outcome

    @property
    def tool_pose(self) -> Pose:
        """Pose of the tool frame in the world.

        Raises:
            WorldError: The arm is not in the world.
        """
        return self._body().tool_pose

    @property
    def q(self) -> Vector:
        """Joint positions in rad, base to tip, of shape (dof,).

        Raises:
            WorldError: The arm is not in the world.
        """
        return self._body().q

    @property
    def v(self) -> Vector:
        """Joint velocities in rad/s, base to tip, of shape (dof,).

        Raises:
            WorldError: The arm is not in the world.
        """
        return self._body().v

    @property
    def holds(self) -> tuple[str, ...]:
        """Names of the objects that it holds, in the order in which they were attached."""
        return self._world.attachments.attached_to(self.name)

    def _body(self) -> ArmBody:
        must_be_among(self.name, self._world.arms, "arm", "in the world")
        return self._world.arms[self.name]

    def __repr__(self) -> str:
        state = self.outcome or ("RUNNING" if self.is_present else "not in the world")
        return f"<arm {self.name} ({self.robot}): {state}>"


class TreeHandle:
    """One arm's behaviour tree, as it is now.

    Args:
        arm: The arm's name in the file.
        spec: The tree in the file.
        arms: The arms of the run.

    Attributes:
        arm: The arm's name in the file.
    """

    def __init__(self, arm: str, spec: NodeSpec, arms: Arms) -> None:
        self.arm = arm
        self._spec = spec
        self._arms = arms

    @property
    def status(self) -> StatusName:
        """Status of its root; INVALID before its first tick, and when it was halted."""
        return self.snapshot().status

    def snapshot(self) -> NodeView:
        """All its nodes as they stand now; what it shows does not change any more."""
        return self._arms.view(self.arm).tree or _never_ticked(self._spec)

    def __repr__(self) -> str:
        return f"<tree of {self.arm}: {self.status}>"


def _never_ticked(spec: NodeSpec) -> NodeView:
    """The tree of an arm that has not been in the world yet."""
    children = tuple(_never_ticked(child) for child in spec.children)
    return NodeView(spec.name, spec.kind, "INVALID", 0.0, children=children)
