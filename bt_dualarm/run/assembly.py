"""From a tree file to a world whose arms are ready to be run."""

from __future__ import annotations

import logging
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import partial

import numpy as np

from bt_dualarm.arm import Arm
from bt_dualarm.motion.controller import JointController
from bt_dualarm.motion.planning_process import PlanningProcess
from bt_dualarm.registry import Registry
from bt_dualarm.run.arms import Arms
from bt_dualarm.run.schedule import exact
from bt_dualarm.run.series import SeriesLog
from bt_dualarm.run.station import Equipment
from bt_dualarm.skill import SkillContext
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.tree.build import build_tree
from bt_dualarm.tree.report import StatusChange
from bt_dualarm.world.camera import Camera
from bt_dualarm.world.catalogue import Robot, is_page
from bt_dualarm.world.rendering import Renderer, RendererKind, choose_renderer
from bt_dualarm.world.world import World

CONTROL_PERIOD = Fraction(1, 250)
"""Longest time in seconds between two set-points of an arm, where the physics steps as often."""


@dataclass
class Assembly:
    """A world and all that acts in it.

    Attributes:
        renderer: Of all cameras, None where no arm of the file has one; to be closed.
        message: One sentence on which renderer is used and why; empty without cameras.
        series: What the skills measure over time.
        planning: Of all arms; to be closed.
        seed: Of everything random.
    """

    world: World
    arms: Arms
    renderer: Renderer | None
    message: str
    series: SeriesLog
    planning: PlanningProcess
    seed: int


@dataclass(frozen=True)
class _Parts:
    """What every arm is equipped from."""

    file: TreeFile
    world: World
    registry: Registry
    renderer: Renderer | None
    on_event: Callable[[StatusChange], None]
    series: SeriesLog
    planning: PlanningProcess
    seed: int

    def clock(self) -> float:
        return self.world.time

    def equip(self, name: str) -> Equipment:
        """Camera, controller and tree of an arm that is in the world."""
        spec = self.file.arms[name]
        camera = None
        if spec.camera is not None and self.renderer is not None:
            camera_name = f"{name}/camera"
            camera = Camera(camera_name, spec.camera, self.renderer, self._rng(camera_name))
        period = control_period(self.world.timestep)
        controller = JointController(self.world, name, float(period))
        arm = Arm(self.world, name, controller, camera, self.seed, self.planning)
        tree = build_tree(
            name,
            spec.tree,
            self.registry.skills,
            lambda path: self._context(arm, path),
            self.clock,
            self.on_event,
        )
        called = name_of_robot(spec.robot, self.world.robots[name])
        return Equipment(called, tree, controller, camera, 1 / exact(spec.tick_hz), period)

    def _rng(self, owner: str) -> np.random.Generator:
        """Randomness hangs on the seed and on who uses it, not on who runs first."""
        return np.random.default_rng([self.seed, zlib.crc32(owner.encode())])

    def _context(self, arm: Arm, path: str) -> SkillContext:
        return SkillContext(
            name=path,
            arm=arm.for_leaf(path),
            clock=self.clock,
            rng=self._rng(f"{arm.name}:{path}"),
            log=logging.getLogger(f"bt_dualarm.skills.{arm.name}"),
            record=partial(self.series.add, arm.name, path),
        )


def assemble(
    file: TreeFile,
    registry: Registry,
    on_event: Callable[[StatusChange], None],
    *,
    seed: int | None = None,
    renderer: RendererKind | None = None,
) -> Assembly:
    """Compose the world and equip its arms; nothing moves yet.

    Args:
        file: Checked with the skills of ``registry``.
        registry: The skills.
        on_event: Receives every change of a status.
        seed: Instead of the file's.
        renderer: Instead of the file's.

    Raises:
        CatalogueError: A robot or scene is unknown or broken.
        RendererError: The renderer asked for cannot work here.
        WorldError: The parts do not compile to one world, or two of them are in one place.
    """
    seed = file.world.seed if seed is None else seed
    drawing, message = None, ""
    if any(arm.camera is not None for arm in file.arms.values()):
        choice = choose_renderer(renderer or file.world.renderer)
        drawing, message = choice.create(), choice.message
    world = World(file, seed)
    world.refuse_overlaps()
    series, planning = SeriesLog(), PlanningProcess()
    parts = _Parts(file, world, registry, drawing, on_event, series, planning, seed)
    declared = {
        name: name_of_robot(arm.robot, world.robots[name]) for name, arm in file.arms.items()
    }
    arms = Arms(declared, parts.equip, world)
    return Assembly(world, arms, drawing, message, series, planning, seed)


def name_of_robot(given: str, robot: Robot) -> str:
    """What people are shown: the name in the catalogue, else the title of the page, on one line."""
    return " ".join(robot.title.split()) if is_page(given) else given


def control_period(timestep: float) -> Fraction:
    """Seconds between set-points: so many physics steps as fit into `CONTROL_PERIOD`, or one."""
    step = exact(timestep)
    return max(1, CONTROL_PERIOD // step) * step
