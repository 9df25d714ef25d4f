"""Conditions: leaves that evaluate sensors and beliefs of the arm, and their combinations.

They do not move the arm. None of them reads the simulator's true state: poses of arms come from
encoders, forces from joint torques, objects from the wrist camera or from what the arm holds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

import numpy as np
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_dualarm.behaviors.composites import Node, Ticks
from bt_dualarm.behaviors.decorators import Inverter
from bt_dualarm.behaviors.leaf import LanguageLeaf
from bt_dualarm.behaviors.node import Became, Children, NodeParts, halt_running
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.skill.articulated import MovedPart
from bt_dualarm.skill.condition import Condition
from bt_dualarm.skill.looking import SightPorts, still_picture
from bt_dualarm.skill.skill import unit_vector
from bt_dualarm.spec.cell import IN_ZONE, ZoneName
from bt_dualarm.spec.node_types import (
    ChildOutcomes,
    LanguageNode,
    NodeSpec,
    Outcomes,
    PortModel,
    Slot,
    port,
)
from bt_dualarm.spec.values import (
    Angle,
    Direction,
    Duration,
    Goal,
    JointName,
    JointPosition,
    ObjectName,
    OtherArmName,
    PoseSpec,
    PostureName,
    Vector3,
)


class _Leaf(LanguageLeaf, Condition):
    """Base of the conditions of one arm."""


def _distances(here: Pose, there: PoseSpec) -> tuple[float, float]:
    """Distance in m and angle in rad to a target; 0 for an orientation that is not given."""
    goal = there.pose
    return here.distance(goal), here.angle(goal) if there.is_oriented else 0.0


class ArmAt(_Leaf):
    """Holds if the tool is at a pose, or the joints in a posture, from the encoders."""

    class Ports(PortModel):
        """Ports of arm_at."""

        exactly_one_of = ("at", "posture")

        at: Annotated[PoseSpec, Goal()] | None = port(
            None, "Pose of the tool in the world; the orientation counts only if given"
        )
        posture: PostureName | None = port(None, "Posture of the robot")
        within: float = port(0.01, "Largest distance from `at`", unit="m", gt=0.0, le=10.0)
        angle: Angle = port(
            5.0, "Largest angle from `at`, or of each joint from `posture`", gt=0.0, le=180.0
        )

    node_type = LanguageNode(
        "arm_at",
        "Holds if the tool is at a pose, or the joints are in a posture, from the encoders",
        Ports,
        example="arm_at: {posture: home}",
    )
    ports: Ports

    def check(self) -> bool:
        """Compare the measured pose, or the measured joint angles."""
        if self.ports.posture is not None:
            wanted = self.arm.posture(self.ports.posture)
            away = float(np.abs(self.arm.q - wanted).max())
            self.reason = f"a joint is {math.degrees(away):.1f}° from {self.ports.posture}"
            return away <= self.ports.angle
        assert self.ports.at is not None  # noqa: S101 - exactly one is given
        distance, angle = _distances(self.arm.tool_pose, self.ports.at)
        self.reason = f"the tool is {1e3 * distance:.1f} mm and {math.degrees(angle):.1f}° away"
        return distance <= self.ports.within and angle <= self.ports.angle


class ArmNear(_Leaf):
    """Holds if the tools of two arms are near each other, from the encoders of both."""

    class Ports(PortModel):
        """Ports of arm_near."""

        arm: OtherArmName = port(..., "The other arm")
        within: float = port(0.3, "Largest distance of the two tools", unit="m", gt=0.0, le=10.0)

    node_type = LanguageNode(
        "arm_near",
        "Holds if the tool of another arm is near this one's, from the encoders of both",
        Ports,
        example="arm_near: {arm: arm2, within: 0.3}",
    )
    ports: Ports

    def check(self) -> bool:
        """Compare the distance; an arm that is not in the world is not near."""
        other = self.ports.arm
        if other not in self.arm.world.arms:
            self.reason = f"{other} is not in the world"
            return False
        distance = self.arm.tool_pose.distance(self.arm.tool_pose_of(other))
        self.reason = f"the tool of {other} is {1e3 * distance:.0f} mm away"
        return distance <= self.ports.within


class InZone(_Leaf):
    """Holds if the tool is in a zone of the cell, from the encoders."""

    class Ports(PortModel):
        """Ports of in_zone."""

        zone: ZoneName = port(..., "Zone of the cell, which must not move with an object")

    node_type = LanguageNode(
        IN_ZONE,
        "Holds if the tool is in a zone of the cell, from the encoders",
        Ports,
        shorthand="zone",
        example="in_zone: bin",
        failures={"INVALID_TARGET": "the zone moves with an object"},
    )
    ports: Ports

    def check(self) -> bool:
        """Compare the position of the tool with the zone.

        Raises:
            Failure: ``INVALID_TARGET``: the zone moves with an object, whose pose is not sensed.
        """
        zone = self.context.cell.shared.spec.zones[self.ports.zone]
        if zone.around is not None:
            reason = f"{self.ports.zone} moves with {zone.around}, whose pose no sensor gives"
            raise Failure("INVALID_TARGET", reason)
        outside = zone.outside_by(zone.pose.pose.inverse.apply(self.arm.tool_pose.position))
        self.reason = f"the tool is {1e3 * outside:.0f} mm outside {self.ports.zone}"
        return outside == 0.0


class Moving(_Leaf):
    """Holds if a motion is commanded, or the arm is not yet at rest, from the encoders."""

    node_type = LanguageNode(
        "moving",
        "Holds if the arm moves: a motion is commanded, or the encoders show one",
        example="moving",
    )

    def check(self) -> bool:
        """Compare the mean velocity of the joints with standstill."""
        self.reason = "the arm is at rest"
        return not self.arm.controller.at_rest


class ForceAbove(_Leaf):
    """Holds if the force on the tool, estimated from the joint torques, is above a bound."""

    class Ports(PortModel):
        """Ports of force_above."""

        force: float = port(..., "Bound", unit="N", gt=0.0, le=1e4)
        direction: Direction | None = port(
            None, "Direction of the force, world axes; by default its magnitude counts"
        )

    node_type = LanguageNode(
        "force_above",
        "Holds if the force on the tool is above a bound, estimated from joint torques",
        Ports,
        shorthand="force",
        example="force_above: {force: 20, direction: [0, 0, 1]}",
    )
    ports: Ports

    def check(self) -> bool:
        """Compare the estimate, in which friction and errors of the model are included."""
        force: Vector = self.arm.external_wrench[:3]
        felt = float(np.linalg.norm(force))
        if self.ports.direction is not None:
            felt = float(force @ unit_vector(self.ports.direction))
        self.reason = f"the force is {felt:.1f} N"
        self.metrics["force_n"] = felt
        return felt > self.ports.force


class Touching(_Leaf):
    """Holds if the arm feels a contact, through its fingertips, its cup or its joint torques."""

    class Ports(PortModel):
        """Ports of touching."""

        by: Literal["any", "fingers", "joints"] = port(
            "any",
            "what has to feel it: the fingers or the cup, the joints as a force on the tool, or "
            "either",
        )
        fingers: float = port(
            2.0, "Bound of the force on one of the fingertips", unit="N", gt=0.0, le=1e3
        )
        joints: float = port(
            30.0, "Bound of the force on the tool, from the joint torques", unit="N", gt=0.0, le=1e4
        )

    node_type = LanguageNode(
        "touching",
        "Holds if the arm feels a contact, through its fingertips, its cup or its joint torques",
        Ports,
        example="touching: {by: joints, joints: 40}",
        failures={"NO_GRIPPER": "`by` is fingers, but the arm has no gripper"},
    )
    ports: Ports

    def check(self) -> bool:
        """Compare what fingers and joints feel with the bounds."""
        ports = self.ports
        felt: dict[str, float] = {}
        if ports.by == "fingers" or (
            ports.by == "any" and self.arm.name in self.arm.world.grippers
        ):
            felt["fingers"] = self.arm.gripper.touch
        if ports.by != "fingers":
            felt["joints"] = float(np.linalg.norm(self.arm.external_wrench[:3]))
        self.metrics |= {f"{name}_n": force for name, force in felt.items()}
        forces = ", ".join(f"{force:.1f} N by the {name}" for name, force in felt.items())
        self.reason = f"the arm feels no contact: {forces}"
        return any(force > getattr(ports, name) for name, force in felt.items())


class JointAt(_Leaf):
    """Holds if a joint of an object is in a range, from its sensor or the arm's hold on it."""

    class Ports(PortModel):
        """Ports of joint_at."""

        exactly_one_of = ("above", "below", "between")

        object: ObjectName = port(..., "Object with the joint")
        joint: JointName = port(..., "The joint")
        above: JointPosition | None = port(None, "Least position")
        below: JointPosition | None = port(None, "Largest position")
        between: tuple[JointPosition, JointPosition] | None = port(
            None, "Minimum and maximum position"
        )

    node_type = LanguageNode(
        "joint_at",
        "Holds if a joint of an object is in a range, from its sensor or the arm's hold on it",
        Ports,
        example="joint_at: {object: cabinet, joint: slide, above: 0.1}",
        failures={
            "NOT_THERE": "the object is not in the world",
            "INVALID_TARGET": "the object has no such joint, or the range is empty",
        },
    )
    ports: Ports

    def check(self) -> bool:
        """Compare the position that the arm knows with the range.

        Raises:
            Failure: ``NOT_THERE``, ``INVALID_TARGET``; ``UNKNOWN_POSE``, as `KnownObjects.pose`.
        """
        ports = self.ports
        part = MovedPart(self.arm, ports.object, ports.joint)
        low, high = ports.between or (
            -math.inf if ports.above is None else ports.above,
            math.inf if ports.below is None else ports.below,
        )
        if low > high:
            raise Failure("INVALID_TARGET", f"between {low:g} and {high:g}: there is nothing")
        position = part.position
        self.metrics[f"joint_{part.spec.si_unit}"] = position
        self.reason = f"{part.name} is at {part.spec.in_words(position)}"
        return part.spec.si(low) <= position <= part.spec.si(high)


class Elapsed(_Leaf):
    """Holds once a time has passed since its first evaluation in a run of the node around it."""

    class Ports(PortModel):
        """Ports of elapsed."""

        seconds: Duration = port(..., "Simulated time", gt=0.0)

    node_type = LanguageNode(
        "elapsed",
        "Holds once a time has passed since the node that evaluates it has started",
        Ports,
        shorthand="seconds",
        example="elapsed: 5",
    )
    ports: Ports

    def check(self) -> bool:
        """Compare the time since the first tick."""
        passed = self.time - self.first_tick
        self.reason = f"{passed:.2f} s of {self.ports.seconds:g} s have passed"
        return passed >= self.ports.seconds - 1e-9


class Sees(_Leaf):
    """Holds if the wrist camera's next image shows enough objects of one kind."""

    class Ports(SightPorts):
        """Ports of sees."""

        least: int = port(1, "Number of objects that must be in view", ge=1, le=100)

    node_type = LanguageNode(
        "sees",
        "Holds if the next image of the wrist camera shows enough objects of one kind",
        Ports,
        example="sees: {object: cube}",
        needs_camera=True,
        failures={
            "NO_CAMERA": "the arm has no camera that moves with it",
            "INVALID_TARGET": "the object has no color that can be detected, or no size is given",
        },
    )
    ports: Ports

    def run(self) -> Iterator[None]:
        """Wait for the next image, and look for the objects in it.

        Raises:
            Failure: ``FALSE``: there are too few.
        """
        seen = self.ports.sighted(self.arm, self.context.cell.zones)
        picture = yield from still_picture(self.arm, 1)
        if picture is None:
            raise Failure("FALSE", "the camera gave no image in time")
        seen.take(picture)
        if len(seen.objects) < self.ports.least:
            reason = f"{len(seen.objects)} of {self.ports.least} objects are in view"
            raise Failure("FALSE", reason if seen.objects else f"{reason}: {seen.others}")


class ObjectAt(_Leaf):
    """Holds if an object is somewhere: by the wrist camera, or by belief while the arm holds it."""

    class Ports(PortModel):
        """Ports of object_at."""

        object: ObjectName = port(..., "The object; its declared and its true pose are not used")
        at: Vector3 = port(..., "Position of its center in the world", unit="m")
        within: float = port(0.02, "Largest distance from there", unit="m", gt=0.0, le=10.0)
        by: Literal["color", "marker"] = port(
            "color", "detect it by its color and shape, or by the marker on it"
        )

    node_type = LanguageNode(
        "object_at",
        "Holds if an object is at a position, seen by the wrist camera or believed while held",
        Ports,
        example="object_at: {object: cube, at: [0.4, -0.4, 0.425]}",
        failures={
            "NO_CAMERA": "the arm neither holds the object nor has a camera that moves with it",
            "INVALID_TARGET": "the object has no color that can be detected",
        },
    )
    ports: Ports

    def run(self) -> Iterator[None]:
        """Compare the believed pose, or wait for the next image and compare the estimates.

        Raises:
            Failure: ``FALSE``: it is elsewhere, or not in view.
        """
        name = self.ports.object
        if name in self.arm.held:
            middle = body_of(self.arm.world.declared_objects[name]).middle
            found = [self.arm.known.pose(name).pose.apply(middle)]
        else:
            look = SightPorts(object=name, by=self.ports.by)
            seen = look.sighted(self.arm)
            picture = yield from still_picture(self.arm, 1)
            if picture is not None:
                seen.take(picture)
            found = [obj.position for obj in seen.objects]
        if not found:
            raise Failure("FALSE", f"{name} is not in view")
        away = min(float(np.linalg.norm(one - np.array(self.ports.at))) for one in found)
        self.metrics["distance_m"] = away
        if away > self.ports.within:
            raise Failure("FALSE", f"{name} is {1e3 * away:.0f} mm away")


# Combinations.


class _Combination(Node):
    """Base of nodes that evaluate several conditions until the result is decided.

    A condition that runs, such as one that waits for an image, is ticked again until it ends; the
    others keep their result meanwhile. The children are not reset between two evaluations, so
    that `elapsed` counts from the start of the node around them.
    """

    restarts_children: ClassVar[bool] = False
    decides: ClassVar[Status]
    _left: list[Behaviour]

    def initialise(self) -> None:
        """Evaluate all conditions again."""
        self._left = list(self.children)

    def swap_children(self, children: Children, slots: tuple[str, ...], became: Became) -> bool:
        """Evaluate all of the new conditions."""
        self._left = list(children)
        return super().swap_children(children, slots, became)

    def tick_children(self) -> Ticks:
        """Tick the conditions in order until one decides."""
        running = []
        for child in self._left:
            yield from child.tick()
            if child.status is self.decides:
                halt_running(self.children)
                return self._decided(child)
            if child.status is Status.RUNNING:
                running.append(child)
        self._left = running
        return Status.RUNNING if running else self._undecided()

    def _decided(self, child: Behaviour) -> Status:
        raise NotImplementedError

    def _undecided(self) -> Status:
        raise NotImplementedError


class All(_Combination):
    """Holds if all of its conditions hold."""

    node_type = LanguageNode(
        "all",
        "Holds if all of its conditions hold; evaluates them in order until one does not",
        many=True,
        example="all: [{compare: {value: 1, to: 1}}, {compare: {value: 1, to: 2}}]",
        outcomes=lambda _, children: Outcomes(
            all(child.succeeds for child in children), any(child.fails for child in children)
        ),
    )
    decides = Status.FAILURE

    def _decided(self, child: Behaviour) -> Status:
        raise Failure("FALSE", f"'{child.name}' does not hold")

    def _undecided(self) -> Status:
        return Status.SUCCESS


def _any_outcomes(_: NodeSpec, children: ChildOutcomes) -> Outcomes:
    return Outcomes(
        any(child.succeeds for child in children), all(child.fails for child in children)
    )


class AnyOf(_Combination):
    """Holds if one of its conditions holds."""

    node_type = LanguageNode(
        "any",
        "Holds if one of its conditions holds; evaluates them in order until one does",
        many=True,
        example="any: [{compare: {value: 1, to: 2}}, {compare: {value: 1, to: 1}}]",
        outcomes=_any_outcomes,
    )
    decides = Status.SUCCESS

    def _decided(self, child: Behaviour) -> Status:  # noqa: ARG002 - any of them will do
        return Status.SUCCESS

    def _undecided(self) -> Status:
        raise Failure("FALSE", "none of the conditions holds")


class Not(Inverter):
    """Holds if its condition does not."""

    node_type = LanguageNode(
        "not",
        "Holds if its condition does not hold",
        slots=(Slot("child"),),
        example="not: {child: {compare: {value: 1, to: 2}}}",
        outcomes=lambda _, children: Outcomes(children[0].fails, children[0].succeeds),
        bare_child=True,
    )

    @classmethod
    def of(cls, parts: NodeParts) -> Not:
        """Returns the opposite of the only child."""
        return cls(parts.name, parts.children[0])
