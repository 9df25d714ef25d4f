"""One MuJoCo world with arms and objects that come and go while it runs."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping

import mujoco

from bt_dualarm.errors import OverlapError, WorldError
from bt_dualarm.pose import Pose, Vector
from bt_dualarm.spec.document import ArmSpec, ObjectSpec, TreeFile
from bt_dualarm.world import composition
from bt_dualarm.world.arm_body import ArmBody
from bt_dualarm.world.attachments import Attachments
from bt_dualarm.world.declarations import check_declarations
from bt_dualarm.world.equipment import Equipment
from bt_dualarm.world.grippers.mounting import load_arm
from bt_dualarm.world.holding import HoldingView
from bt_dualarm.world.mounting import MountingSurface, surface_below
from bt_dualarm.world.names import must_be_among
from bt_dualarm.world.object_bodies import add_object, noisy_pose
from bt_dualarm.world.overlap import no_room, overlap
from bt_dualarm.world.robots.robot import Robot
from bt_dualarm.world.stepping import Stepping

_log = logging.getLogger(__name__)


class World(HoldingView):
    """The composed world: ``model`` and ``data`` change identity when ``generation`` grows.

    They are the plant: who controls an arm reads its `hardware` and `nominal`.

    Args:
        file: Declares scene, objects and arms.
        seed: Moves objects by their noise.
        visuals: Load the full visual meshes, for pictures.

    Attributes:
        before_removal: Functions that are told the name of an arm that is about to be taken away.
        on_forces: Functions that are called in each step, when contacts have the forces of it.
        declared_arms: Every arm of the file, present or not.
        declared_objects: Every object of the file, likewise.
        equipment: Hardware, grippers and nominal model of each arm that is present, by name.

    Raises:
        CatalogueError: A robot or scene is unknown or broken.
        WorldError: The parts do not compile to one world.
    """

    def __init__(self, file: TreeFile, seed: int = 0, *, visuals: bool = False) -> None:
        mujoco.set_mju_user_warning(_log.warning)  # else it writes a file where the user stands
        self._file, self._visuals = file, visuals
        self.declared_arms: Mapping[str, ArmSpec] = file.arms
        self.declared_objects: Mapping[str, ObjectSpec] = file.objects
        self._poses = {name: noisy_pose(name, thing, seed) for name, thing in file.objects.items()}
        loaded = {name: load_arm(arm, file.root) for name, arm in file.arms.items()}
        self.robots: dict[str, Robot] = {
            name: robot.derated(file.arms[name].limits) for name, (robot, _) in loaded.items()
        }
        mounted = {name: gripper for name, (_, gripper) in loaded.items() if gripper is not None}
        self.arms: dict[str, ArmBody] = {}
        self.objects: dict[str, ObjectSpec] = {}
        self.before_removal: list[Callable[[str], None]] = []
        self.generation = 0
        self.equipment = Equipment(file, self.robots, mounted, seed)
        self.hardware, self.nominal = self.equipment.hardware, self.equipment.nominal
        self.grippers = self.equipment.grippers
        self.on_forces: list[Callable[[], None]] = [self.equipment.rub]
        self._spec = composition.scene_spec(file.world, file.root)
        if mounted:
            self.on_forces.append(self.equipment.carry)
            composition.take_hold_options(self._spec)
        check_declarations(file, self.robots, composition.names_in(self._spec))
        self.attachments = Attachments(self._spec, self._recompile, self._take_up)
        self._compile_first()

    def step(self) -> None:
        """Advance by one physics step; positions, contacts and inertias are then those of now.

        Raises:
            DivergenceError: A torque or the state is not finite, or time did not advance.
        """
        self.equipment.drive()
        time = self._stepping.advance(self.on_forces)
        self.equipment.sense(time)

    def sense(self) -> None:
        """Read all sensors; `step` does so at its end."""
        self.equipment.sense(self.data.time)

    def overlaps(self) -> Iterator[OverlapError]:
        """Each arm or object that is inside another thing now; of two in each other the first."""
        said: set[tuple[str, str]] = set()
        for kind, names in (("arm", self.arms), ("object", self.objects)):
            for name in names:
                inside = overlap(self.model, self.data, name)
                if inside is not None and (inside[0].partition("/")[0], name) not in said:
                    said.add((name, inside[0].partition("/")[0]))
                    yield no_room(kind, name, *inside)

    def refuse_overlaps(self) -> None:
        """Raise an `OverlapError` if an arm or object is inside another thing at the start."""
        for error in self.overlaps():
            raise error

    def spawn_arm(self, name: str) -> None:
        """Add a declared arm in its initial posture.

        Raises:
            WorldError: Not declared, present already, or something is in its place.
        """
        must_be_among(name, self._file.arms, "arm", "declared")
        if name in self.arms:
            raise WorldError(f"arm {name!r} is present already")
        self._add_arm(name)
        self._recompile()
        self._take_posture(name)
        self._look_again()
        inside = overlap(self.model, self.data, name)
        if inside is not None:
            self.remove_arm(name)
            raise no_room("arm", name, *inside)

    def remove_arm(self, name: str) -> None:
        """Take an arm away; what it held falls.

        Raises:
            WorldError: The arm is not present.
        """
        must_be_among(name, self.arms, "arm", "in the world")
        for notify in self.before_removal:
            notify(name)
        if name not in self.arms:  # who was told has taken it away
            return
        self.attachments.forget(name)
        composition.remove_arm(self._spec, name, self.robots[name])
        del self.arms[name]
        self.equipment.remove(name)
        self._recompile()

    def spawn_object(self, name: str, pose: Pose | None = None) -> None:
        """Add a declared object at rest, at its declared pose or at ``pose``.

        Raises:
            WorldError: Not declared, present already, or something is in its place.
        """
        must_be_among(name, self._file.objects, "object", "declared")
        if name in self.objects:
            raise WorldError(f"object {name!r} is present already")
        self._put_object(name, pose or self._poses[name])
        self._recompile()
        inside = overlap(self.model, self.data, name)
        if inside is not None:
            self.remove_object(name)
            raise no_room("object", name, *inside)

    def remove_object(self, name: str) -> None:
        """Take an object away, out of any arm's hold.

        Raises:
            WorldError: The object is not present.
        """
        must_be_among(name, self.objects, "object", "in the world")
        self.attachments.forget(name)
        self._spec.delete(self._spec.body(name))
        del self.objects[name]
        self._recompile()

    def restore(self, state: Vector) -> None:
        """Go back to a state of the same generation, bit for bit; drives keep theirs."""
        mujoco.mj_setState(self.model, self.data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        self._look_again()

    def _compile_first(self) -> None:
        """What does not move comes first: the arms' bases may stand on it."""
        self._add_objects(fixed=True)
        self._compile()
        self._surfaces: dict[str, MountingSurface | None] = {
            name: surface_below(self.model, self.data, arm.base.pose)
            for name, arm in self._file.arms.items()
        }
        self._add_objects(fixed=False)
        for name, arm in self._file.arms.items():
            if arm.spawned:
                self._add_arm(name)
        self._compile()
        self._bind()
        for name in self.arms:
            self._take_posture(name)
        self._look_again()

    def _add_objects(self, *, fixed: bool) -> None:
        for name, thing in self._file.objects.items():
            if thing.spawned and thing.fixed == fixed:
                self._put_object(name, self._poses[name])

    def _put_object(self, name: str, pose: Pose) -> None:
        self.objects[name] = thing = self._file.objects[name]
        add_object(self._spec, name, thing, pose, self.equipment.drawn_object(name))

    def _compile(self) -> None:
        try:
            self.model = self._spec.compile()
        except ValueError as error:
            raise WorldError(f"MuJoCo cannot compile the world: {error}") from error
        self.data = mujoco.MjData(self.model)
        mujoco.mj_step1(self.model, self.data)

    def _recompile(self) -> None:
        """Take up changes of the spec; the state of everything that stays is kept."""
        try:
            self.model, self.data = self._spec.recompile(self.model, self.data)
        except ValueError as error:
            raise WorldError(f"MuJoCo cannot recompile the world: {error}") from error
        self._take_up()

    def _take_up(self) -> None:
        """Let everybody look again at what there is, and at who holds what."""
        self.generation += 1
        self._bind()
        self._look_again()

    def _look_again(self) -> None:
        """Bring up to date what hangs on the state, and read the sensors."""
        self.equipment.rub()
        mujoco.mj_step1(self.model, self.data)
        self.sense()

    def _bind(self) -> None:
        plant = self.model, self.data
        self._stepping = Stepping(*plant)
        self.arms = {
            name: ArmBody.find(name, self.robots[name], self._file.arms[name].base.pose, *plant)
            for name in self.arms
        }
        self.equipment.connect(plant, self.arms, self.attachments, self.objects)

    def _add_arm(self, name: str) -> None:
        arm, robot, drawn = self._file.arms[name], self.robots[name], self.equipment.drawn[name]
        surface, visuals = self._surfaces[name], self._visuals
        gripper = self.equipment.mounted.get(name)
        composition.add_arm(
            self._spec, name, arm, robot, drawn, gripper, surface=surface, visuals=visuals
        )
        self.equipment.add(name, self._spec.option)
        self.arms[name] = None  # type: ignore[assignment]  # bound when the model is compiled

    def _take_posture(self, name: str) -> None:
        """Put an arm that has just come into its initial posture: before its first step only."""
        posture = self.robots[name].postures[self._file.arms[name].posture]
        self.data.qpos[self.arms[name].qpos_ids] = posture
        self.equipment.open_gripper(name)
