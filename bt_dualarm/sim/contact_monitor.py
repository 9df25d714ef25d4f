"""True contacts of the arms and their forces, for scoring only.

No arm senses these. A controller notices a contact only because a joint lags behind its set-point,
moves too fast, or needs more than its effort limit; motions fail by that alone.
"""

from __future__ import annotations

import mujoco
import numpy as np

from bt_dualarm.core.share import weakly
from bt_dualarm.sim.composition import name_of_geom
from bt_dualarm.sim.world import World

_NOBODY = -1


class ContactMonitor:
    """What one arm touches from now on, what it touches already and what it holds aside.

    Args:
        arm: Name of the arm.
        already: Names of the objects that it touches when the watch begins.

    Attributes:
        forces_n: Largest normal force of a contact, by the name of the object, N.
    """

    def __init__(self, arm: str, already: frozenset[str]) -> None:
        self.arm = arm
        self.forces_n: dict[str, float] = {}
        self._already = already

    def note(self, thing: str, force_n: float) -> None:
        """Take up one contact."""
        if thing not in self._already and force_n > self.forces_n.get(thing, 0.0):
            self.forces_n[thing] = force_n


class Contacts:
    """Looks at the contacts of a world in each of its steps, for those who watch.

    After a step MuJoCo has found the contacts of now, and has no forces for them yet.

    Args:
        world: World whose arms and objects may come and go.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._watches: list[ContactMonitor] = []
        self._generation = -1
        world.on_forces.append(weakly(self._look))

    def watch(self, arm: str) -> ContactMonitor:
        """Begin to watch an arm that is in the world."""
        watch = ContactMonitor(
            arm, frozenset(thing for one, thing, _ in self._touching() if one == arm)
        )
        self._watches.append(watch)
        return watch

    def end(self, watch: ContactMonitor) -> None:
        """Watch no more; harmless when that has ended."""
        self._watches = [one for one in self._watches if one is not watch]

    def _look(self) -> None:
        """Take up what was touched in this step."""
        if not self._watches:
            return
        for arm, thing, force in self._touching():
            for watch in self._watches:
                if watch.arm == arm:
                    watch.note(thing, force)

    def _touching(self) -> list[tuple[str, str, float]]:
        """Arm, object and normal force in N of each contact of an arm with what is not its own."""
        model = self._world.model
        data = self._world.data
        if not data.ncon:
            return []
        if self._generation != self._world.generation:
            self._bind()
        geoms = data.contact.geom
        if not self._meets(geoms, self._owner, self._holder):
            return []
        owners = self._owner[geoms]
        holders = self._holder[geoms]
        strange = (owners[:, 0] != owners[:, 1]) & (owners.max(axis=1) != _NOBODY)
        strange &= data.contact.dist <= 0.0  # a cup's lip feels what is near, too
        strange &= (holders[:, 0] != owners[:, 1]) & (holders[:, 1] != owners[:, 0])
        found = []
        force = np.empty(6)
        for i in np.flatnonzero(strange).tolist():
            mujoco.mj_contactForce(model, data, i, force)
            for mine, other in ((0, 1), (1, 0)):
                arm = self._arms[owners[i, mine]]
                thing = name_of_geom(model, int(geoms[i, other])).partition("/")[0]
                if owners[i, mine] != _NOBODY and thing != arm:  # its pedestal bears its name
                    found.append((arm, thing, float(force[0])))
        return found

    def _bind(self) -> None:
        """Look up whose the shapes are, and who holds what."""
        from bt_dualarm.sim.device_kernels import any_unrequested

        world = self._world
        self._meets = any_unrequested
        self._generation = world.generation
        self._arms = tuple(world.arms)
        self._owner = np.full(world.model.ngeom, _NOBODY)
        self._holder = np.full(world.model.ngeom, _NOBODY - 1)
        for index, body in enumerate(world.arms.values()):
            self._owner[list(body.geom_ids)] = index
        for held in world.attachments:
            self._holder[world.object_geom(held.object)] = self._arms.index(held.arm)


def warm_up_contacts() -> None:
    """Have all kernels of contacts compiled."""
    from bt_dualarm.sim.device_kernels import any_unrequested

    pairs = np.zeros((4, 2), np.int32)
    numbers = np.zeros(1, np.int64)
    for one in (pairs, pairs[::2]):  # a single contact lies in one piece, several do not
        any_unrequested(one, numbers, numbers)
