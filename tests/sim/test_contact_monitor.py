"""Contacts of arms are detected in the step in which they occur, in each generation of a world."""

from __future__ import annotations

import numpy as np

from bt_dualarm.core.pose import Pose
from bt_dualarm.sim.contact_monitor import Contacts
from bt_dualarm.sim.world import World
from tests.sim.worlds import arm, box, file_of

STEPS = 60


def hit(world: World) -> list[bool]:
    """Throw the box at the last link from above; returns whether they touch in each step."""
    mine = world.arms["arm1"].geom_ids
    above = world.data.geom_xpos[max(mine)] + np.array((0.0, 0.0, 0.25))
    world.spawn_object("box", Pose(above, np.array((1.0, 0.0, 0.0, 0.0))))
    world.data.joint("box").qvel[2] = -4.0
    mine = world.arms["arm1"].geom_ids
    other = world.object_geom("box")
    touching: list[bool] = []

    def record() -> None:
        pairs = [set(pair) for pair in world.data.contact.geom.tolist()]
        touching.append(any(other in pair and not pair.isdisjoint(mine) for pair in pairs))

    world.on_forces.append(record)
    for _ in range(STEPS):
        world.step()
    world.on_forces.remove(record)
    return touching


def test_contact_is_detected_again_after_a_recompilation() -> None:
    """The box is spawned, hits the arm, is removed, and spawned again, in new generations."""
    world = World(file_of({"arm1": arm("ur5")}, {"box": box((0.0, 0.0, 2.0), spawned=False)}))
    contacts = Contacts(world)
    for _ in range(2):
        monitor = contacts.watch("arm1")
        assert any(hit(world))
        assert monitor.forces_n["box"] > 0.0
        contacts.end(monitor)
        world.remove_object("box")


def test_step_reports_contact_with_foreign_objects() -> None:
    """Only with a monitor, which defines what is foreign, and only during contact."""
    world = World(file_of({"arm1": arm("ur5")}, {"box": box((0.0, 0.0, 2.0), spawned=False)}))
    assert any(hit(world))
    assert not world.devices.touches_foreign
    world.remove_object("box")
    contacts = Contacts(world)
    contacts.watch("arm1")
    noticed: list[bool] = []
    world.on_forces.append(lambda: noticed.append(world.devices.touches_foreign))
    touching = hit(world)
    # In the first step after a change, the monitor checks contacts itself.
    assert noticed[1:] == touching[1:]
    assert any(touching)
