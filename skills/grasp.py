"""Take an object with the gripper and see that it hangs in it."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from bt_dualarm import (
    Failure,
    ObjectName,
    PortModel,
    PoseSpec,
    Skill,
    Taking,
    TakingPorts,
    WantedGrasp,
    grasps_on,
    port,
    refuse_too_frail,
    thing_at,
    twin_at,
)

_UNKNOWN_FRICTION = 0.5


class _What(PortModel):
    object: ObjectName | None = port(None, "object to take; the file says its shape")
    at: PoseSpec | None = port(
        None, "pose of the object, as `locate` writes it; its true one is then not looked at"
    )
    width: float | None = port(
        None,
        "extent of what lies `at` that pose and has no name, along its y axis: there fingers close",
        unit="m",
        ge=1e-3,
        le=1,
    )
    depth: float | None = port(
        None, "extent along its x axis; by default the width", unit="m", ge=1e-3, le=1
    )
    height: float | None = port(
        None, "extent along its z axis; by default the width", unit="m", ge=1e-3, le=1
    )
    friction: float | None = port(
        None,
        "sliding friction of it; by default 0.5",
        unit="times the pressure",
        gt=0,
        le=10,
    )


class Grasp(Skill):
    """Take an object with the gripper, lift it a little and see that it hangs there."""

    class Ports(TakingPorts, _What):
        exactly_one_of = ("object", "width")
        goes_with = {"width": "at", "depth": "width", "height": "width", "friction": "width"}

    failures = Taking.failures
    example = "grasp: {object: cube}"
    needs = ("scipy.interpolate", "bt_dualarm.skill.grasps_prepared")
    needs_gripper = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Choose before moving; go, close with the force that is needed, lift, look."""
        name, gripper = self.ports.object, self.arm.gripper
        yield from gripper.until_decided()
        if name is not None and self.ports.at is not None:
            name = next((held for held in gripper.held if self._alike(held, name)), name)
        gripper.refuse_full(name)
        if gripper.held:  # it is this one
            if gripper.holding:
                return
            yield from Taking.open(self.arm)
        lies = None if self.ports.at is None else self.ports.at.pose
        if name is not None and lies is not None:
            name = self.metrics["taken"] = twin_at(self.arm.world, name, lies.position)
        wanted = WantedGrasp.named(self.arm, name, self.ports, lies) if name else self._unnamed()
        refuse_too_frail(self.arm, wanted.label, self.ports.most_force)
        taking = Taking(self.arm, self.ports, wanted, self.ports.at is not None, self.metrics)
        yield from taking.through(grasps_on(self.arm, wanted))

    def _alike(self, one: str, other: str) -> bool:
        """Whether two objects are of one form: nobody can tell them apart where one was seen."""
        first, second = (self.arm.world.declared_objects[name] for name in (one, other))
        return (first.shape, first.size) == (second.shape, second.size)

    def _unnamed(self) -> WantedGrasp:
        """What lies at a pose, a box of the extent that was told."""
        ports = self.ports
        if ports.at is None or ports.width is None:
            raise Failure("INVALID_TARGET", "neither an object is named, nor `at` and `width`")
        width, lies = ports.width, ports.at.pose
        edges = (ports.depth or width, width, ports.height or width)
        name = thing_at(self.arm.world, lies.position, 0.5 * float(np.linalg.norm(edges)))
        mass, bears = ports.mass_of(None), ports.most_force or math.inf
        rubs = ports.friction or _UNKNOWN_FRICTION
        return WantedGrasp(
            name, lies, mass, ports.shake, ports.margin, bears, edges, rubs, ports.along
        )
