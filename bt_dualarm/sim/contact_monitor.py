"""True contacts of the arms and their forces, for scoring only.

No arm senses these. A controller notices a contact only because a joint lags behind its set-point,
moves too fast, or needs more than its effort limit; motions fail by that alone.
"""

from __future__ import annotations

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.share import weakly
from bt_dualarm.sim.composition import name_of_geom
from bt_dualarm.sim.world import World

_NO_ARM = -1


def arms_of_geoms(world: World) -> npt.NDArray[np.int64]:
    """Number of the arm that owns each geom, in the order of ``world.arms``; -1 for none."""
    owners = np.full(world.model.ngeom, _NO_ARM)
    for number, body in enumerate(world.arms.values()):
        owners[list(body.geom_ids)] = number
    return owners


class ContactMonitor:
    """New contacts of one arm; objects that it touched or held at the start do not count.

    Args:
        arm: Name of the arm.
        already: Names of the objects that it touches or holds at the start.

    Attributes:
        forces_n: Largest normal force of a contact, by the name of the object, N.
    """

    def __init__(self, arm: str, already: frozenset[str]) -> None:
        self.arm = arm
        self.forces_n: dict[str, float] = {}
        self._already = already

    def note(self, obj: str, force_n: float) -> None:
        """Record one contact with an object, its normal force in N."""
        if obj not in self._already and force_n > self.forces_n.get(obj, 0.0):
            self.forces_n[obj] = force_n


class Contacts:
    """Observes the contacts of a world in each step, on behalf of its monitors.

    It runs before the second half of a step, when contacts and their forces match (see
    `Stepping.advance`): afterwards MuJoCo has new contacts without forces.

    Args:
        world: World whose arms and objects may come and go.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._monitors: list[ContactMonitor] = []
        self._generation = -1
        world.on_forces.append(weakly(self._observe))

    def watch(self, arm: str) -> ContactMonitor:
        """Start to monitor an arm that is in the world."""
        touched = {obj for one, obj, _ in self._foreign_contacts() if one == arm}
        held = {held.object for held in self._world.attachments if held.arm == arm}
        monitor = ContactMonitor(arm, frozenset(touched | held))
        self._monitors.append(monitor)
        return monitor

    def end(self, monitor: ContactMonitor) -> None:
        """Stop a monitor; harmless if it has stopped already."""
        self._monitors = [one for one in self._monitors if one is not monitor]

    def _observe(self) -> None:
        """Pass the contacts of this step to the monitors."""
        if not self._monitors:
            return
        # Until this generation is bound, the world does not know what is foreign.
        is_bound = self._generation == self._world.generation
        if is_bound and not self._world.devices.touches_foreign:  # the usual case
            return
        for arm, obj, force in self._foreign_contacts():
            for monitor in self._monitors:
                if monitor.arm == arm:
                    monitor.note(obj, force)

    def _foreign_contacts(self) -> list[tuple[str, str, float]]:
        """Arm, object and normal force in N of each contact of an arm with something foreign."""
        model = self._world.model
        data = self._world.data
        if self._generation != self._world.generation:
            self._bind()
        if not data.ncon:
            return []
        geoms = data.contact.geom
        owners = self._owner[geoms]
        holders = self._holder[geoms]
        foreign = (owners[:, 0] != owners[:, 1]) & (owners.max(axis=1) != _NO_ARM)
        foreign &= data.contact.dist <= 0.0  # a cup's lip has contacts across its gap
        foreign &= (holders[:, 0] != owners[:, 1]) & (holders[:, 1] != owners[:, 0])
        for index, geom in self._others_hold:  # of an object that several arms hold
            foreign &= ~((owners == index).any(axis=1) & (geoms == geom).any(axis=1))
        found = []
        force = np.empty(6)
        for i in np.flatnonzero(foreign).tolist():
            mujoco.mj_contactForce(model, data, i, force)
            for mine, other in ((0, 1), (1, 0)):
                arm = self._arms[owners[i, mine]]
                obj = name_of_geom(model, int(geoms[i, other])).partition("/")[0]
                if owners[i, mine] != _NO_ARM and obj != arm:  # the pedestal has the arm's name
                    found.append((arm, obj, float(force[0])))
        return found

    def _bind(self) -> None:
        """Look up which arm owns, and which holds, each geom."""
        world = self._world
        self._generation = world.generation
        self._arms = tuple(world.arms)
        self._owner = arms_of_geoms(world)
        self._holder = np.full(world.model.ngeom, _NO_ARM - 1)
        self._others_hold: list[tuple[int, int]] = []
        for held in world.attachments:
            for geom in world.payload_geoms(held.object):
                if self._holder[geom] >= 0:
                    self._others_hold.append((self._arms.index(held.arm), geom))
                else:
                    self._holder[geom] = self._arms.index(held.arm)
        world.devices.notice_foreign(self._owner, self._holder)
