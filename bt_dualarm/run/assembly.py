"""From a tree file to a world whose arms are ready to be run."""

from __future__ import annotations

import logging
import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bt_dualarm.arm import Arm
from bt_dualarm.motion.controller import JointController
from bt_dualarm.registry import Registry
from bt_dualarm.run.arms import Arms
from bt_dualarm.run.schedule import exact
from bt_dualarm.run.station import Equipment
from bt_dualarm.skill import SkillContext
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.tree.build import build_tree
from bt_dualarm.tree.report import StatusChange
from bt_dualarm.world.camera import Camera
from bt_dualarm.world.rendering import RendererChoice, choose_renderer
from bt_dualarm.world.world import World

CONTROL_PERIOD_S = 0.002
"""Longest time between two set-points of an arm: 500 Hz."""


@dataclass
class Assembly:
    """A world and all that acts in it.

    Attributes:
        renderer: Of the cameras, None where no arm of the file has one.
        seed: Of everything random.
    """

    world: World
    arms: Arms
    renderer: RendererChoice | None
    seed: int


def assemble(
    file: TreeFile,
    registry: Registry,
    on_event: Callable[[StatusChange], None],
    *,
    seed: int | None = None,
    renderer: str | None = None,
) -> Assembly:
    """Compose the world and equip its arms; nothing moves yet.

    Args:
        file: Checked with the skills of ``registry``.
        registry: The skills.
        on_event: Receives every change of a status.
        seed: Instead of the file's.
        renderer: ``auto``, ``gl`` or ``ray`` instead of the file's.

    Raises:
        CatalogueError: A robot or scene is unknown or broken.
        RendererError: The renderer asked for cannot work here.
        WorldError: The parts do not compile to one world.
    """
    seed = file.world.seed if seed is None else seed
    choice = None
    if any(arm.camera is not None for arm in file.arms.values()):
        choice = choose_renderer(renderer or file.world.renderer)
    world = World(file, seed)

    def equip(name: str) -> Equipment:
        return _equip(name, file, world, registry, choice, on_event, seed)

    declared = {name: arm.robot for name, arm in file.arms.items()}
    return Assembly(world, Arms(declared, equip, world), choice, seed)


def _equip(
    name: str,
    file: TreeFile,
    world: World,
    registry: Registry,
    choice: RendererChoice | None,
    on_event: Callable[[StatusChange], None],
    seed: int,
) -> Equipment:
    """Camera, controller and tree of an arm that is in the world."""
    spec = file.arms[name]
    camera = None
    if spec.camera is not None and choice is not None:
        camera = Camera(f"{name}/camera", spec.camera, choice.create())
    period = world.timestep * max(1, int(CONTROL_PERIOD_S / world.timestep + 1e-9))
    controller = JointController(world, name, period)
    arm = Arm(world, name, controller, camera, seed)

    def context(path: str) -> SkillContext:
        return SkillContext(
            name=path,
            arm=arm.for_leaf(path),
            clock=lambda: world.time,
            rng=np.random.default_rng([seed, zlib.crc32(f"{name}:{path}".encode())]),
            log=logging.getLogger(f"bt_dualarm.skills.{name}"),
        )

    tree = build_tree(name, spec.tree, registry.skills, context, lambda: world.time, on_event)
    return Equipment(
        robot=spec.robot,
        tree=tree,
        controller=controller,
        eye=camera,
        tick_period=1 / exact(spec.tick_hz),
        control_period=exact(period),
    )
