"""Thin obstacles: an admitted motion touches none of them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise, product

import mujoco
import numpy as np
import pytest

from bt_dualarm.collision.checker import CollisionChecker, interpolated
from bt_dualarm.core.errors import Failure, OverlapError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.planning.problem import refuse_contact
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.trajectory.path_timing import point_to_point
from bt_dualarm.trajectory.trajectory import Trajectory
from tests.families import some
from tests.sim.worlds import WIDE, arm, file_of

THIN = 0.001
SIZES = {"plate": (THIN, 0.1, 0.1), "wire": (THIN, THIN, 0.2), "speck": (THIN, THIN, THIN)}
MOTIONS = 8
GRAZED = 2e-4
"""Depth in m by which a motion may cut a corner between two checks, which are up to 8 mm apart."""


def free_motions(world: World, rng: np.random.Generator) -> Iterator[Trajectory]:
    """Motions of the arm alone, up to 0.6 rad a joint, at any speed."""
    limits = world.robots["arm1"].limits
    start = world.hardware["arm1"].q
    while True:
        goal = np.clip(start + rng.uniform(-0.6, 0.6, len(start)), limits.lower, limits.upper)
        motion = point_to_point(start, goal, limits.scaled(rng.choice([0.1, 0.5, 1.0])), 0.004)
        try:
            refuse_contact(CollisionChecker(world, "arm1"), motion)
        except Failure:
            continue
        yield motion


def skin(world: World, q: Vector, rng: np.random.Generator) -> Vector:
    """A point within a millimeter or so of the surface of a link in a configuration."""
    model = world.model
    body = world.arms["arm1"]
    data = mujoco.MjData(model)
    data.qpos[:] = world.data.qpos
    data.qpos[body.qpos_ids] = q
    mujoco.mj_kinematics(model, data)
    meshes = [g for g in sorted(body.geom_ids) if model.geom_contype[g] and model.geom_bodyid[g]]
    geom = meshes[rng.integers(len(meshes) // 2, len(meshes))]
    point = model.geom_size[geom] * rng.choice([-1, 1], 3)
    mesh = int(model.geom_dataid[geom])
    if mesh >= 0:
        first = model.mesh_vertadr[mesh]
        count = model.mesh_vertnum[mesh]
        point = model.mesh_vert[first + rng.integers(count)]
    surface: Vector = data.geom_xpos[geom] + data.geom_xmat[geom].reshape(3, 3) @ point
    return surface + rng.uniform(-THIN, THIN, 3)


def deepest(checker: CollisionChecker, motion: Trajectory) -> float:
    """Largest depth of the arm in the object, m, checked every half millimeter."""
    obj = checker.model.geom("thing").id
    worst = 0.0
    for here, there in pairwise(motion.q[::4]):
        for q in interpolated(here, there, checker.radii, 5e-4)[:-1]:
            checker.place(q)
            found = checker.data.contact
            depths = -found.dist[(found.geom == obj).any(axis=1)]
            worst = max(worst, *depths.tolist(), 0.0)
    return worst


@pytest.mark.parametrize(("shape", "robot"), some(product(SIZES, WIDE), 2))
def test_no_motion_goes_through_a_thin_object(robot: str, shape: str) -> None:
    """Wherever on a link's path the object is, and in any orientation."""
    obj = ObjectSpec(shape="box", size=SIZES[shape], mass=1.0, fixed=True, spawned=False)
    world = World(file_of({"arm1": arm(robot, (0.0, 0.0, 0.6))}, {"thing": obj}))
    rng = np.random.default_rng(WIDE.index(robot))
    refused = 0
    motions = free_motions(world, rng)
    for _ in range(MOTIONS):
        motion = next(motions)
        share = rng.uniform(0.2, 0.8)
        point = skin(world, motion.q[int(share * len(motion))], rng)
        try:
            world.spawn_object(
                "thing", Pose.from_rpy(point.tolist(), rng.uniform(-3, 3, 3).tolist())
            )
        except OverlapError:  # where the arm is already
            continue
        checker = CollisionChecker(world, "arm1")
        try:
            refuse_contact(checker, motion)
        except Failure:
            refused += 1
        else:
            assert deepest(checker, motion) < GRAZED
        world.remove_object("thing")
    assert refused > 0
