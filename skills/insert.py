"""Insert a peg that the gripper holds into its hole, by contact."""

from __future__ import annotations

from collections.abc import Generator, Iterator

import numpy as np

from bt_dualarm import (
    Angle,
    CarriedPose,
    Failure,
    Grip,
    HoleAxes,
    Inserting,
    InsertingPorts,
    KnownShape,
    Matrix,
    ObjectName,
    OtherObjectName,
    PortModel,
    Pose,
    Skill,
    Speed,
    Trajectory,
    goals_alike,
    into_held,
    port,
    unit_vector,
)

_CLEAR_M = 0.004  # height above the rim from which the peg is lowered
_STARTS = 3  # free branches of the inverse kinematics among which the planner chooses
_TRIES = 12  # blocked branches after which the search for free ones ends
_OUT = 0.1  # fraction of the arm's limits with which a peg is raised out of its hole


class _PegPorts(PortModel):
    object: ObjectName = port(..., "peg; the gripper must hold it")
    at: CarriedPose = port(..., "pose of the peg when it is fully inserted")
    into: OtherObjectName | None = port(
        None,
        "object, held by another arm with `hold_still`, that has the hole or is a side of it: the "
        "peg and the hand may touch it",
    )
    angle_tolerance: Angle = port(
        5.0, "largest rotation error of the peg at the end, up to its symmetry", ge=0.1, le=90
    )
    speed: Speed = port(0.3, "fraction of the arm's limits up to the hole")


class Insert(Skill):
    """Insert a held peg into its hole: lower it, search around the goal, push it in."""

    class Ports(InsertingPorts, _PegPorts):
        pass

    failures = {
        "NOT_HELD": "the gripper does not hold the peg",
        **Inserting.failures,
        "NOT_INSERTED": "the peg is not where the arm estimates it: it moved in the gripper",
    }
    example = (
        "insert: {object: cube, at: {xyz: [0.25, -0.45, 0.425], rpy: [0, 0, 0]}, depth: 0.012}"
    )
    begins_anywhere = True
    needs_gripper = True
    needs_held = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Move above the hole, search it by contact with the rim, push down, check the depth."""
        arm = self.arm
        name = self.ports.object
        held = arm.world.attachments.find(arm.name, name)
        if held is None or name not in arm.gripper.held:
            raise Failure("NOT_HELD", f"{arm.name} does not hold {name!r}")
        arm.refuse_shared()
        in_tool = arm.robot.tool.inverse @ held.relative
        goal = self.ports.at.pose_from(arm.commanded_tool_pose @ in_tool)
        alike = goals_alike(arm.world, name, goal)
        self._axes = HoleAxes(unit_vector(self.ports.direction))
        self._bottoms = [(angle, pose @ in_tool.inverse) for angle, pose in alike]
        grip = Grip(arm, name)
        with into_held(arm, self.ports.into):
            try:
                yield from self._leave_hole(grip)
                yield from self._go_above(grip)
                ((spun, bottom),) = self._bottoms
                if spun:
                    self.metrics["spun_rad"] = spun
                inserting = Inserting(arm, self.ports, name, grip, bottom, self.metrics)
                yield from inserting.through()
            except Failure as failure:
                if failure.code == "SLIPPED":
                    yield from grip.judge(failure)
                raise
        self._score(name, goal)

    def _score(self, name: str, goal: Pose) -> None:
        """Check the true pose of the peg: no sensor measures how it turned or slid in the gripper.

        The horizontal tolerance includes the position uncertainty of the hole.

        Raises:
            Failure: ``NOT_INSERTED``.
        """
        if name not in self.arm.world.objects:
            raise Failure("NOT_INSERTED", f"object {name!r} was removed from the world")
        ports = self.ports
        shape = KnownShape.of(self.arm.world.objects[name])
        true = shape.nearest(self.arm.world.object_pose(name), goal)
        offset, height = self._axes.offset(true, goal)
        beside = float(np.linalg.norm(offset))
        turned = shape.angle(true, goal)
        self.metrics |= {"inserted_error_m": true.distance(goal), "inserted_turned_rad": turned}
        if (
            abs(height) > ports.tolerance
            or beside > ports.radius + ports.tolerance
            or turned > ports.angle_tolerance
        ):
            raise Failure(
                "NOT_INSERTED",
                f"{name!r} is {1e3 * beside:.1f} mm beside and {1e3 * height:.1f} mm above its "
                f"goal, rotated by {np.degrees(turned):.1f}°",
                beside_m=beside,
                height_off_m=height,
                turned_rad=turned,
            )

    def _leave_hole(self, grip: Grip) -> Iterator[float | None]:
        """Raise a peg that a former attempt has left in the hole, out of which no plan leads."""
        arm = self.arm
        ports = self.ports
        here = arm.commanded_tool_pose
        for _, bottom in self._bottoms:
            beside, height = self._axes.offset(here, bottom)
            if (
                np.hypot(*beside) <= ports.radius + ports.tolerance
                and -ports.tolerance <= height < ports.depth
                and here.angle(bottom) <= ports.angle_tolerance
            ):
                yield from arm.come_to_rest()  # the halted attempt may still be braking
                arm.controller.compliance.active = False  # it would sink as it relaxes
                yield from arm.relax()
                out = arm.commanded_tool_pose
                _, height = self._axes.offset(out, bottom)
                above = ports.depth + _CLEAR_M
                rows = arm.line_on(out.shifted((above - height) * self._axes.out))
                motion = arm.begin(arm.time_path(rows, _OUT), may_touch=True, compliant=True)
                while not motion.done:
                    yield 0.0
                    arm.check()
                    grip.look()
                yield from arm.settle()
                return

    def _go_above(self, grip: Grip) -> Iterator[float]:
        """Move above the hole, in a branch that also reaches the bottom from there."""
        arm = self.arm
        ports = self.ports
        for progress in arm.past_others(ports.speed).along(self._plan_above):
            yield 0.3 * (progress or 0.0)
            grip.look()

    def _plan_above(self) -> Generator[None, None, Trajectory]:
        """Plan the way to above the hole; only the possible pose at its bottom is left then.

        There are others if the peg looks the same when it is turned, the smallest rotation first.
        """
        first: Failure | None = None
        for spun, bottom in self._bottoms:
            try:
                starts = yield from self._starts_above(bottom)
            except Failure as failure:
                first = first or failure.with_traceback(None)  # would keep this frame alive
            else:
                self._bottoms = [(spun, bottom)]
                turned = [rows[0] for rows in self.arm.turned(starts)]
                above = [rows[0] for rows in starts]
                try:
                    return (yield from self.arm.plan(above, self.ports.speed, turned=turned))
                except Failure as failure:
                    if "goal_enclosed" in failure.numbers:
                        failure.adding("a `depth` like that of the hole begins above it")
                    raise
        assert first is not None  # noqa: S101 - the goal itself is one of them
        raise first

    def _starts_above(self, bottom: Pose) -> Generator[None, None, list[Matrix]]:
        """Descents from above the hole after which the arm can go beyond the bottom.

        Returns:
            For each branch configurations down to the bottom, of shape (n, dof), rad.
        """
        arm = self.arm
        ports = self.ports
        peg = frozenset({self.ports.object})
        on_axis = np.zeros(2)
        above = self._axes.pose(bottom, on_axis, ports.depth + _CLEAR_M)
        deepest = self._axes.pose(bottom, on_axis, -ports.tolerance)
        starts: list[Matrix] = []
        refusals: list[Failure] = []
        for down, _ in arm.lines(above, bottom, deepest):
            try:
                arm.refuse_collision(down[-1], ignore=peg)  # fingers that hold the peg too low
            except Failure as failure:
                refusals.append(
                    failure.with_traceback(None)
                )  # a traceback would keep this frame alive
            else:
                starts.append(down)
            yield
            if len(starts) == _STARTS or len(refusals) == _TRIES:
                break
        if not starts:
            raise refusals[0]
        return starts
