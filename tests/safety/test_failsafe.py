"""Reservations: each is clear of those of the other arms, so that arms never collide."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.collision.distance import ArmDistance, BoundingSpheres, apart
from bt_dualarm.control.controller import JointController
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.safety.failsafe import FailSafeCheck, Reservations
from bt_dualarm.safety.guard import CLEAR_M, FLOOR_M
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.path_timing import point_to_point
from bt_dualarm.trajectory.set_points import SetPoint
from tests.families import some
from tests.sim.worlds import arm, box, file_of

PERIOD = 0.004
NEAR = np.array((0.0, -0.6, 0.9, -1.9, -1.57, 0.0))
"""Joint positions in rad at which two arms that face each other touch, or nearly."""

KEEP = {"arm1": CLEAR_M, "arm2": CLEAR_M}


@pytest.fixture
def reservations() -> Reservations:
    return Reservations()


@pytest.fixture
def world() -> World:
    return World(file_of({"arm1": arm("ur5"), "arm2": arm("ur5", (1.1, 0.0, 0.4), 180.0)}))


def deviation_of(arm: str, reservations: Reservations) -> float:
    reservation = reservations.of(arm)
    assert reservation is not None
    return reservation.deviation


def path(start: Vector, end: Vector, world: World) -> Matrix:
    return point_to_point(start, end, world.robots["arm1"].limits, PERIOD).q


def test_a_path_into_the_reservation_of_another_arm_is_refused(
    world: World, reservations: Reservations
) -> None:
    """Where the other arm will be counts, not where it is."""
    first, second = (FailSafeCheck(world, name, PERIOD, reservations) for name in ("arm1", "arm2"))
    home = world.arms["arm1"].q
    assert first.reserve_trajectory(path(home, NEAR, world), 0.0, KEEP).clear
    before = reservations.of("arm1")
    verdict = second.reserve_trajectory(path(home, NEAR, world), 0.0, KEEP)
    assert verdict.gap.meters < CLEAR_M
    assert verdict.spare == pytest.approx(verdict.gap.meters - CLEAR_M)
    assert verdict.gap.second.startswith("arm1/")
    assert reservations.of("arm2") is None
    assert reservations.of("arm1") is before


@pytest.mark.parametrize("seed", range(8))
def test_a_third_arm_does_not_change_the_clearance_of_two_others(seed: int) -> None:
    """Its reserved region and its initial distance matter only between it and each other arm."""
    rng = np.random.default_rng(seed)
    pair = {"arm1": arm("ur5"), "arm2": arm("ur5", (1.1, 0.0, 0.4), 180.0)}
    side = rng.choice((-1.0, 1.0)) * rng.uniform(1.4, 1.8)
    place = (float(rng.uniform(0.2, 0.9)), float(side), 0.4)
    goal = NEAR + rng.uniform(-0.6, 0.6, 6)
    verdicts = []
    for arms in (pair, {**pair, "arm3": arm("ur5", place, float(rng.uniform(-180, 180)))}):
        world = World(file_of(arms))
        reservations = Reservations()
        checks = {name: FailSafeCheck(world, name, PERIOD, reservations) for name in arms}
        if "arm3" in arms:
            assert checks["arm2"].others == ("arm1", "arm3")
            sent = SetPoint(world.arms["arm3"].q, np.zeros(6), np.zeros(6))
            keep = dict.fromkeys(checks["arm3"].others, CLEAR_M)
            assert checks["arm3"].reserve_region(sent, 0.0, keep, (0.1, 0.05, 0.02)) > 0.0
            assert deviation_of("arm3", reservations) > CLEAR_M
        first = path(world.arms["arm1"].q, goal, world)
        checks["arm1"].reserve_regardless(first, 0.0)
        rows = path(world.arms["arm2"].q, NEAR, world)
        keep = {**KEEP, "arm3": 0.001}  # as if it had been that near at the beginning
        verdicts.append(checks["arm2"].reserve_trajectory(rows, 0.0, keep))
    assert verdicts[1] == verdicts[0]


def test_a_place_is_free_once_the_other_arm_has_left_it(
    world: World, reservations: Reservations
) -> None:
    """Paths are compared at the same times: an arm that leaves makes room for one that comes."""
    first, second = (FailSafeCheck(world, name, PERIOD, reservations) for name in ("arm1", "arm2"))
    home = world.arms["arm2"].q
    limits = world.robots["arm1"].limits
    aside = home + np.array((1.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    leaving = point_to_point(NEAR, aside, limits.scaled(0.2), PERIOD)
    first.reserve_regardless(leaving.q, 0.0)
    coming = point_to_point(home, NEAR, limits, PERIOD, 2.0 * leaving.duration)
    assert not second.reserve_trajectory(path(home, NEAR, world), 0.0, KEEP).clear
    assert second.reserve_trajectory(coming.q, 0.0, KEEP).clear


def test_a_region_is_reserved_only_if_it_is_free(world: World, reservations: Reservations) -> None:
    """The faster an arm is, the farther it moves before it can stop."""
    own = FailSafeCheck(world, "arm2", PERIOD, reservations)
    still = np.zeros(6)
    here = world.arms["arm2"].q
    slow = SetPoint(here, still, still)
    fast = SetPoint(here, still + 2.0, still)
    waits = (10.0, 0.02)
    assert own.reserve_region(slow, 0.0, KEEP, waits) == 0.02
    assert deviation_of("arm2", reservations) > 0.0
    assert own.reserve_region(fast, 0.0, KEEP, waits) == 0.0


def test_arms_out_of_each_others_reach_are_not_checked(
    reservations: Reservations,
) -> None:
    """At any speed and for any duration; the reservation still covers all that the arm can do."""
    world = World(file_of({"arm1": arm("ur5"), "arm2": arm("ur5", (2.8, 0.0, 0.4), 180.0)}))
    own, other = (FailSafeCheck(world, name, PERIOD, reservations) for name in ("arm1", "arm2"))
    fast = SetPoint(world.arms["arm1"].q, np.full(6, 2.0), np.zeros(6))
    assert own.reserve_region(fast, 0.0, KEEP, (10.0, 0.02)) == 10.0
    assert deviation_of("arm1", reservations) > 2.0
    here = world.arms["arm2"].q
    assert other.reserve_trajectory(path(here, NEAR, world), 0.0, KEEP).spare == float("inf")
    assert other.present(here, 0.0) == {}


def test_precomputed_bounds_hold_in_every_posture() -> None:
    """Balls, and distances of points from joints: computed in one posture, they hold in all."""
    rng = np.random.default_rng(0)
    world = World(file_of({"arm1": arm("ur5"), "arm2": arm("panda", (3.0, 0.0, 0.4), 180.0)}))
    hulls = {name: BoundingSpheres(world, name) for name in world.arms}
    for _ in range(50):
        for name, hull in hulls.items():
            limits = world.robots[name].limits
            world.data.qpos[world.arms[name].qpos_ids] = rng.uniform(limits.lower, limits.upper)
            world.sense()
            spheres = hull.spheres()
            away = np.linalg.norm(spheres[:, :3] - hull.ball[0, :3], axis=1) + spheres[:, 3]
            assert away.max() <= hull.ball[0, 3] + 1e-9
            assert (hull.levers(spheres).max(axis=0) <= hull.spans + 1e-9).all()


@pytest.mark.parametrize("seed", range(3))
def test_spheres_contain_the_arm_and_its_object(seed: int) -> None:
    """Their distance is never more than the true one; no motion goes farther than the bound."""
    obj = box((0.487, 0.109, 0.79))
    world = World(
        file_of({"arm1": arm("ur5"), "arm2": arm("panda", (1.0, 0.0, 0.4), 180.0)}, {"cube": obj})
    )
    world.attach("arm1", "cube")
    rng = np.random.default_rng(seed)
    separation = ArmDistance(world, "arm1")
    hulls = [BoundingSpheres(world, name) for name in world.arms]
    turn = rng.uniform(-0.05, 0.05, 6)
    before = hulls[0].spheres()
    bound = hulls[0].reach(hulls[0].levers(before), np.abs(turn))
    world.data.qpos[world.arms["arm1"].qpos_ids] += turn
    world.sense()
    arm1 = np.arange(len(before))[:-1]  # the cube is not moved with the arm here
    moved = np.linalg.norm(hulls[0].spheres()[arm1, :3] - before[arm1, :3], axis=1)
    assert moved.max() <= bound
    assert bound < 2.0 * moved.max() + 0.1
    far = hulls[0].reach(hulls[0].levers(before), np.ones(6))
    assert far == pytest.approx(6.0 * hulls[0].span)
    for name in world.arms:
        body = world.arms[name]
        world.data.qpos[body.qpos_ids] += rng.uniform(-0.5, 0.5, len(body.qpos_ids))
    world.sense()
    true = separation.gap({}, 2.0).meters
    assert apart(hulls[0].spheres(), hulls[1].spheres()) <= true + 1e-6


@pytest.mark.parametrize("seed", some(range(3), 2))
def test_arms_with_random_goals_never_collide(
    world: World, reservations: Reservations, seed: int
) -> None:
    """Whatever motion is begun, stopped or streamed; both head for one place again and again.

    They keep the guard's distance, slightly less with each motion, minus the error of the servos.
    """
    rng = np.random.default_rng(seed)
    separation = ArmDistance(world, "arm1")
    controllers = [JointController(world, name, PERIOD, reservations) for name in world.arms]
    nearest = float("inf")
    for step in range(3000):
        for controller in controllers:
            if step % 2 == 0:
                controller.update(world.time)
            if controller.motion is None and rng.random() < 0.05:
                begin(controller, world, rng)
            elif rng.random() < 0.001:
                controller.stop()
        world.step()
        if step % 4 == 0:
            nearest = min(nearest, separation.gap({}).meters)
    held = sum(int(str(controller.guard["stopped"])) for controller in controllers)
    assert held > 0
    assert nearest > FLOOR_M - 0.001


def begin(controller: JointController, world: World, rng: np.random.Generator) -> None:
    """Begin a motion, or a stream of its set-points, to near the place that both head for."""
    start = controller.setpoint
    goal = NEAR + rng.uniform(-0.5, 0.5, 6)
    limits = world.robots["arm1"].limits
    motion = point_to_point(start.q, goal, limits.scaled(float(rng.uniform(0.3, 1.0))), PERIOD)
    if rng.random() < 0.5:
        controller.follow(motion)
        return
    began = world.time
    controller.stream(lambda time: SetPoint(*motion.at(time - began)))
