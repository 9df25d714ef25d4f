"""Sensors and drives change readings and torques exactly as declared."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from bt_dualarm.core.pose import Vector
from bt_dualarm.sim.devices import ArmDrives
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import DriveErrors, EncoderErrors
from tests.sim.bench import STEP, Bench, BenchDrives, BenchEncoders
from tests.sim.worlds import arm, file_of

EFFORT = np.array([150.0, 28.0])


def encoders(dof: int = 1, **errors: float) -> BenchEncoders:
    return BenchEncoders(EncoderErrors(**errors), dof, seed=0)


def drives(gain: tuple[float, float] = (1.0, 1.0), **errors: Any) -> BenchDrives:
    return BenchDrives(DriveErrors(**errors), np.array(gain), EFFORT)


def response(drive: BenchDrives, torques: list[Vector]) -> Vector:
    """Torques that the first joint gets for commands, one per step."""
    return np.array([drive.passed(torque)[0] for torque in torques])


def impulse(steps: int) -> list[Vector]:
    return [np.array([10.0 * (k == 0), 0.0]) for k in range(steps)]


def test_exact_encoder_reads_true_values() -> None:
    exact = encoders(2)
    q = np.array([0.1, -2.0])
    v = np.array([1.0, 2.0])
    exact.read(q, v, 0.0)
    assert (exact.q == q).all()
    assert (exact.v == v).all()


def test_readings_are_multiples_of_the_resolution() -> None:
    coarse = encoders(resolution=0.1)
    step = math.radians(0.1)
    for q in np.linspace(-1, 1, 50):
        coarse.read(np.array([q]), np.zeros(1), 0.0)
        assert coarse.q[0] / step == pytest.approx(round(coarse.q[0] / step), abs=1e-9)
        assert abs(coarse.q[0] - q) <= 0.5 * step + 1e-12


def test_noise_has_the_given_deviation() -> None:
    noisy = encoders(2, noise=0.01)
    read = []
    for k in range(5000):
        noisy.read(np.zeros(2), np.zeros(2), k * STEP)
        read.append(noisy.q)
    assert np.std(read) == pytest.approx(math.radians(0.01), rel=0.03)
    assert abs(np.mean(read)) < math.radians(0.001)


@pytest.mark.parametrize("window", [0.002, 0.004, 0.01])
@pytest.mark.parametrize("cutoff", [0.0, 50.0])
def test_velocity_of_a_ramp_is_exact(window: float, cutoff: float) -> None:
    """After the window and five time constants of the filter."""
    one = encoders(window=window, cutoff=cutoff)
    for k in range(100):
        one.read(np.array([0.3 * k * STEP]), np.array([99.0]), k * STEP)
    assert one.v[0] == pytest.approx(0.3, rel=1e-6)


def test_differenced_velocity_lags_by_half_its_window() -> None:
    """On a parabola it is the velocity of half a window ago; no encoder can do better."""
    one = encoders(window=0.004)
    for k in range(20):
        one.read(np.array([(k * STEP) ** 2]), np.zeros(1), k * STEP)
    assert one.v[0] == pytest.approx(2 * (19 * STEP - 0.002))


def test_second_reading_at_the_same_time_replaces_the_first() -> None:
    once = encoders(window=0.004, cutoff=50.0)
    twice = encoders(window=0.004, cutoff=50.0)
    for k in range(10):
        q = np.array([math.sin(k)])
        once.read(q, np.zeros(1), k * STEP)
        twice.read(q + 1.0, np.zeros(1), k * STEP)
        twice.read(q, np.zeros(1), k * STEP)
        assert twice.v == pytest.approx(once.v)


@pytest.mark.parametrize("delay", [0.0, 0.001, 0.002, 0.003, 0.007])
def test_torque_arrives_after_its_delay(delay: float) -> None:
    """The impulse is preserved, and its center is delayed as declared."""
    got = response(drives(delay=delay, gain=(1.0, 1.0)), [np.zeros(2), *impulse(20)])
    times = np.arange(-1, 20) * STEP
    assert got.sum() == pytest.approx(10.0)
    assert got @ times / got.sum() == pytest.approx(delay)


def test_slow_drive_responds_as_a_first_order_lag() -> None:
    got = response(drives(bandwidth=20.0), [np.zeros(2), *[np.array([10.0, 0.0])] * 50])
    times = np.arange(51) * STEP
    assert got == pytest.approx(10 * (1 - np.exp(-2 * math.pi * 20.0 * times)))


def test_torques_are_multiples_of_the_quantum() -> None:
    drive = drives(quantum=0.01)
    for torque in np.linspace(-20, 20, 37):
        got = drive.passed(np.array([torque, 0.0]))[0]
        assert got / 1.5 == pytest.approx(round(got / 1.5), abs=1e-9)
        assert abs(got - torque) <= 0.75 + 1e-9


def test_each_joint_has_its_gain_and_effort_limit() -> None:
    drive = drives(gain=(1.1, 0.8))
    assert drive.passed(np.array([10.0, 10.0])) == pytest.approx([11.0, 8.0])
    assert drive.passed(np.array([149.0, -28.0])) == pytest.approx([150.0, -22.4])


def test_ideal_drives_pass_torques_at_once() -> None:
    world = World(file_of({"arm1": arm("ur5")}))
    torque: Vector = np.linspace(0.0, 5.0, 6)
    world.hardware["arm1"].command(torque)
    assert (world.data.ctrl == torque).all()


def test_readings_are_interpolated_between_their_times() -> None:
    """Outside of the kept interval, the reading is that of its nearer end."""
    world = World(file_of({"arm1": arm("ur5")}))
    hardware = world.hardware["arm1"]
    body = world.arms["arm1"]
    seen = {}
    for _ in range(10):
        world.step()
        seen[world.time] = body.q
    times = list(seen)
    for time, q in seen.items():
        assert hardware.q_at(time) == pytest.approx(q)
    middle = 0.5 * (times[3] + times[4])
    assert hardware.q_at(middle) == pytest.approx(0.5 * (seen[times[3]] + seen[times[4]]))
    assert hardware.q_at(times[-1] + 1.0) == pytest.approx(body.q)


def test_two_arms_with_one_seed_differ() -> None:
    arms = {"arm1": arm("ur5"), "arm2": arm("ur5", (2.0, 0.0, 0.4))}
    world = World(file_of(arms, reality="lab"))
    one, other = (world.devices.sampled[name] for name in arms)
    assert (one.gain != other.gain).all()
    assert (one.friction.viscous != other.friction.viscous).all()


SENSED = {
    "late": EncoderErrors(resolution=0.01, noise=0.02, window=0.01, cutoff=80.0),
    "ideal": EncoderErrors(),
    "early": EncoderErrors(noise=0.01, window=0.004),
}
DRIVEN = {
    "late": ArmDrives(DriveErrors(delay=0.007, quantum=0.001), np.full(2, 1.1), EFFORT),
    "ideal": ArmDrives(DriveErrors(), np.ones(3), np.full(3, 9.0)),
    "early": ArmDrives(DriveErrors(delay=0.003, bandwidth=60.0), np.ones(1), np.ones(1)),
}


def simulated(names: set[str]) -> dict[str, list[Vector]]:
    """Readings and torques of arms on a bench, one of which is added after 300 steps."""
    bench = Bench(SENSED, DRIVEN)
    rng = np.random.default_rng(1)
    seen: dict[str, list[Vector]] = {name: [] for name in names}
    for k in range(1200):
        for name, one in DRIVEN.items():
            truth = rng.normal(size=(3, len(one.effort)))
            if name not in names or k < (300 if name == "late" else 0):
                continue
            if name not in bench.hardware:
                bench.begin(name, seed=7)
            bench.place(name, *truth[:2])
            bench.hardware[name].command(truth[2])
        bench.drive()
        bench.read(k * STEP)
        if k % 5 == 0:  # again at the same time, as after a recompilation
            bench.read(k * STEP)
        for name, one_arm in bench.hardware.items():
            seen[name].append(np.concatenate((one_arm.q, one_arm.v, bench.torque(name))))
    return seen


@pytest.mark.parametrize("name", SENSED)
def test_sensors_and_drives_of_arms_are_independent(name: str) -> None:
    """Bit for bit, for any windows and delays of the others, and any time of its addition."""
    together = simulated(set(SENSED))[name]
    alone = simulated({name})[name]
    np.testing.assert_array_equal(together, alone)
    assert np.std(together, axis=0).min() > 0.0


def test_arm_has_no_readings_from_before_its_addition() -> None:
    bench = Bench(SENSED, DRIVEN)
    bench.begin("early")
    for k in range(10):
        bench.read(k * STEP)
    bench.begin("late")
    bench.place("late", np.array([0.5, -0.5]), np.zeros(2))
    for k in range(9, 12):
        bench.read(k * STEP)
    assert bench.hardware["late"].q_at(0.0) == pytest.approx([0.5, -0.5], abs=0.01)
