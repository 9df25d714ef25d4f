"""Warnings of objects that an arm is to carry and is not made for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from bt_dualarm.spec.annotations import metadata_of
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.goals import Goal
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.problems import Problem
from bt_dualarm.spec.values import Refers
from bt_dualarm.world.robots.robot import Robot


def overloads(
    file: TreeFile, robots: Mapping[str, Robot], kinds: Mapping[str, Kind]
) -> Iterator[Problem]:
    """Warn of every object that is to be carried and weighs more than the arm's payload.

    Args:
        file: Without errors.
        robots: Robots by the arm's name.
        kinds: Kinds of all nodes, by name.
    """
    for name, arm in file.arms.items():
        payload = robots[name].payload
        for node in arm.tree.walk():
            for port, thing in _carried(node, kinds):
                mass = file.objects[thing].mass if thing in file.objects else 0.0
                if payload is not None and mass > payload:
                    message = f"{node.kind}: {port}: {thing} weighs {mass:g} kg"
                    hint = f"the payload of {name}, a {robots[name].name}, is {payload:g} kg"
                    yield replace(node.port_problem((port,), message, hint), severity="warning")


def _carried(node: NodeSpec, kinds: Mapping[str, Kind]) -> Iterator[tuple[str, str]]:
    """Ports with the names of objects, of a node that carries what it names somewhere."""
    fields = kinds[node.kind].ports.model_fields if node.kind in kinds else {}
    goals = (metadata_of(declared, Goal) for declared in fields.values())
    if not any(goal.carried for goal in goals if goal):
        return
    for port, declared in fields.items():
        refers, value = metadata_of(declared, Refers), node.ports.get(port)
        if refers is not None and refers.to == ("object",) and isinstance(value, str):
            yield port, value
