"""Planning problems like those of MotionBenchMaker, for every arm of the catalog.

Source: Chamzas et al., MotionBenchMaker: a tool to generate and benchmark motion planning datasets,
RA-L 2022: bookshelves, a box, a cage, objects on a table and space under it. Sizes are scaled by
the arm's reach; the poses of the objects and both ends are random, with the tool in a pose to grasp
an object. In a third of the worlds there is another arm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.measured_robots import MEASURED
from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.core.errors import Failure, WorldError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.planning.problem import PlanningProblem
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ArmSpec, ObjectSpec, TreeFile, WorldSpec
from bt_dualarm.spec.node_types import NodeSpec
from bt_dualarm.spec.values import PoseSpec

MARGIN_M = 0.045
DT = 0.004
REACH_M = 0.9
"""Reach of an arm to which the sizes below apply, m."""

Draw = np.random.Generator
Place = tuple[float, float, float]
DOWN = (np.pi, 0.0)
AHEAD = (0.0, np.pi / 2)
"""Roll and pitch of a tool that points down, and away from the base."""


@dataclass(frozen=True)
class Scene:
    """Boxes in the base frame, as center and size, and tool positions with roll and pitch."""

    boxes: list[tuple[Place, Place]]
    places: list[tuple[Place, tuple[float, float]]]


def bookshelf(rng: Draw) -> Scene:
    """Boards between two sides and a back; the tool is between two boards."""
    x = rng.uniform(0.5, 0.62)
    width = rng.uniform(0.6, 0.9)
    deep = rng.uniform(0.22, 0.3)
    rise = rng.uniform(0.26, 0.34)
    boards = int(rng.integers(3, 5))
    height = rise * (boards - 1)
    y = rng.uniform(-0.1, 0.1)
    boxes: list[tuple[Place, Place]] = [((x + deep, y, height / 2), (0.02, width, height))]
    sides = (y - width / 2, y + width / 2)
    boxes += [((x + deep / 2, side, height / 2), (deep, 0.02, height)) for side in sides]
    boxes += [((x + deep / 2, y, i * rise + 0.01), (deep, width, 0.02)) for i in range(boards)]
    places = [
        (
            (x + rng.uniform(0.03, 0.12), y + rng.uniform(-0.3, 0.3) * width, (i + 0.5) * rise),
            AHEAD,
        )
        for i in range(boards - 1)
    ]
    return Scene(boxes, places)


def box(rng: Draw) -> Scene:
    """A box that is open at the top; the tool is in it, pointing down, and beside it."""
    x = rng.uniform(0.4, 0.55)
    y = rng.uniform(-0.25, 0.25)
    width = rng.uniform(0.26, 0.36)
    height = rng.uniform(0.2, 0.3)
    boxes: list[tuple[Place, Place]] = [((x, y, 0.01), (width, width, 0.02))]
    for side in (-1, 1):
        boxes.append(((x + side * width / 2, y, height / 2), (0.02, width, height)))
        boxes.append(((x, y + side * width / 2, height / 2), (width, 0.02, height)))
    inside = (x + rng.uniform(-0.05, 0.05), y + rng.uniform(-0.05, 0.05), height - 0.08)
    beside = (rng.uniform(0.3, 0.5), -y - np.sign(y) * 0.25, rng.uniform(0.1, 0.3))
    return Scene(boxes, [(inside, DOWN), (beside, DOWN)])


def cage(rng: Draw) -> Scene:
    """Bars along the edges of a box, and some across it; the tool is in it, and beside it."""
    x = rng.uniform(0.45, 0.55)
    y = rng.uniform(-0.2, 0.2)
    edge = rng.uniform(0.36, 0.46)
    bar = 0.025
    half = edge / 2
    boxes: list[tuple[Place, Place]] = []
    for one in (-half, half):
        for other in (-half, half):
            boxes.append(((x + one, y + other, half), (bar, bar, edge)))
            boxes.append(((x, y + one, half + other), (edge, bar, bar)))
            boxes.append(((x + one, y, half + other), (bar, edge, bar)))
    boxes.append(((x + rng.uniform(-0.3, 0.3) * edge, y, edge), (bar, edge, bar)))
    boxes.append(((x, y + half, rng.uniform(0.3, 0.7) * edge), (edge, bar, bar)))
    inside = (
        x + rng.uniform(-0.08, 0.08),
        y + rng.uniform(-0.08, 0.08),
        rng.uniform(0.12, 0.25),
    )
    beside = (rng.uniform(0.25, 0.4), y + rng.choice((-1, 1)) * 0.4, rng.uniform(0.1, 0.4))
    return Scene(boxes, [(inside, DOWN if rng.random() < 0.5 else AHEAD), (beside, DOWN)])


def table(rng: Draw) -> Scene:
    """Objects on a table; the tool is just above two of them, or low in front of them."""
    top = rng.uniform(0.1, 0.25)
    boxes: list[tuple[Place, Place]] = [((0.6, 0.0, top - 0.015), (0.6, 1.0, 0.03))]
    places: list[tuple[Place, tuple[float, float]]] = []
    for i in range(int(rng.integers(5, 9))):
        x = rng.uniform(0.38, 0.75)
        y = -0.4 + 0.1 * i
        tall = rng.uniform(0.06, 0.25)
        boxes.append(((x, y, top + tall / 2), (rng.uniform(0.04, 0.09), 0.06, tall)))
        places.append(((x, y, top + tall + rng.uniform(0.01, 0.05)), DOWN))
    places.append(((0.32, rng.uniform(-0.4, 0.4), top + rng.uniform(0.04, 0.1)), DOWN))
    return Scene(boxes, [places[i] for i in rng.permutation(len(places))])


def under_table(rng: Draw) -> Scene:
    """A table on four legs; the tool is under it, and above it."""
    x = rng.uniform(0.55, 0.65)
    y = rng.uniform(-0.1, 0.1)
    top = rng.uniform(0.36, 0.5)
    boxes: list[tuple[Place, Place]] = [((x, y, top), (0.5, 0.8, 0.03))]
    feet = [(x + one, y + other) for one in (-0.23, 0.23) for other in (-0.38, 0.38)]
    boxes += [((*foot, top / 2), (0.04, 0.04, top)) for foot in feet]
    under = (
        x + rng.uniform(-0.2, 0.0),
        y + rng.uniform(-0.25, 0.25),
        rng.uniform(0.1, top - 0.15),
    )
    above = (
        x + rng.uniform(-0.15, 0.1),
        y + rng.uniform(-0.3, 0.3),
        top + rng.uniform(0.05, 0.2),
    )
    return Scene(boxes, [(under, AHEAD), (above, DOWN)])


KINDS: dict[str, Callable[[Draw], Scene]] = {
    "bookshelf": bookshelf,
    "box": box,
    "cage": cage,
    "table": table,
    "under table": under_table,
}


def world_of(scene: Scene, robot: str, scale: float, turn: float, beside: bool) -> World:
    """A world with the arm, the boxes around it, and possibly another arm."""
    tree = NodeSpec(kind="succeed", name="succeed", ports={})
    arms = {"arm1": ArmSpec(robot=robot, base=PoseSpec(xyz=(0.0, 0.0, 0.0)), tree=tree)}
    if beside:
        away = PoseSpec(xyz=(-0.1 * scale, 0.75 * scale, 0.0), rpy=(0.0, 0.0, 180.0))
        arms["arm2"] = ArmSpec(robot="ur3", base=away, tree=tree)
    turned = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, turn))
    objects = {}
    for i, (place, size) in enumerate(scene.boxes):
        center = turned.apply(scale * np.array([place]))[0] + (0.0, 0.0, 0.002)
        objects[f"part{i}"] = ObjectSpec(
            shape="box",
            size=tuple(float(scale * edge) for edge in size),
            mass=1.0,
            fixed=True,
            pose=PoseSpec(xyz=tuple(center.tolist()), rpy=(0.0, 0.0, float(np.rad2deg(turn)))),
        )
    return World(
        TreeFile(
            name="scenes",
            world=WorldSpec(scene="empty"),
            objects=objects,
            arms=arms,
            path=Path("scenes.yaml"),
        )
    )


def ends(
    scene: Scene,
    scale: float,
    turn: float,
    rng: Draw,
    kinematics: Kinematics,
    free: CollisionChecker,
) -> tuple[Vector, Vector] | None:
    """Two free configurations with the tool at two positions of the scene, or None."""
    found: list[Vector] = []
    for place, (roll, pitch) in scene.places:
        for _ in range(6):
            x, y, z = Pose.from_rpy((0, 0, 0), (0, 0, turn)).apply(scale * np.array([place]))[0]
            yaw = np.arctan2(y, x) + rng.uniform(-0.5, 0.5) + (roll > 0) * rng.uniform(-2.0, 2.0)
            pose = Pose.from_rpy((x, y, z), (roll, pitch, yaw))
            try:
                answers = kinematics.solutions(pose, free.present)
            except Failure:
                continue
            good = [q for q in answers if free.free(q)]
            if good:
                found.append(good[rng.integers(len(good))])
                break
        if len(found) == 2:
            one, other = (found[i] for i in rng.permutation(2))
            return one, other
    return None


def scene_problems(seed: int) -> Iterator[tuple[str, World, PlanningProblem]]:
    """An infinite series of kinds with robots, worlds, and problems of ``arm1``."""
    rng = np.random.default_rng(seed)
    robots = {name: load_robot(name) for name in MEASURED}
    while True:
        for name, robot in robots.items():
            scale = Kinematics(robot, Pose.identity()).bounding_ball[1] / REACH_M
            for kind, make in KINDS.items():
                scene = make(rng)
                turn = rng.uniform(-0.8, 0.8)
                try:
                    world = world_of(scene, name, scale, turn, rng.random() < 1 / 3)
                    world.refuse_overlaps()
                except WorldError:
                    continue
                free = CollisionChecker(world, "arm1", MARGIN_M)
                kinematics = Kinematics(robot, Pose.identity())
                both = ends(scene, scale, turn, rng, kinematics, free)
                if both is not None:
                    start, goal = both
                    problem = PlanningProblem(free, start, (goal,), robot.limits, DT)
                    yield f"{kind}, {name}", world, problem
