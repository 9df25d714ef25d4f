"""The true state is never read: a plant whose state is falsified between steps behaves the same.

The falsified data are all numeric arrays of MuJoCo's state, and the masses, inertias and friction
of arms in its model. Between two physics steps, while trees tick and controllers compute, all of
them are wrong; the step itself gets the true values back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt
import pytest

import bt_dualarm as bt
from bt_dualarm.core.pose import Matrix
from bt_dualarm.sim.camera import calibration_of
from bt_dualarm.sim.world import World

Numbers: TypeAlias = npt.NDArray[np.float64]

OF_THE_MODEL = (
    "body_mass", "body_inertia", "body_ipos", "body_iquat", "body_subtreemass", "body_invweight0",
    "dof_armature", "dof_damping", "dof_frictionloss", "dof_M0", "dof_invweight0", "cam_fovy",
)  # fmt: skip
"""Sampled quantities of a plant, and derived ones. Geometry is that of the robot description."""

COMMANDED = frozenset({"ctrl", "act", "act_dot"})
"""Arrays that controllers write."""

TREE = """\
bt_dualarm: 1
world: {scene: table, seed: 3, reality: REALITY, time_limit: 20}
objects:
  cube: {shape: box, size: [0.05, 0.05, 0.05], mass: 0.4, pose: {xyz: [0.487, 0.109, 0.79]}}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.40]}
    tree:
      sequence:
        - move_joints: {by: [0, 10, 0, 0, 0, 20], speed: 0.5}
        - circle: {radius: 0.05, speed: 0.5}
  arm2:
    robot: panda
    base: {xyz: [1.3, 0, 0.40], rpy: [0, 0, 180]}
    camera: {}
    tree:
      sequence: [{move_linear: {offset: {xyz: [0, 0, -0.1]}}}, {go_home: {speed: 0.5}}]
"""


def floats(owner: Any, names: Iterator[str]) -> Iterator[tuple[str, Numbers]]:
    """Nonempty numeric arrays among the named attributes, as views."""
    for name in names:
        value = getattr(owner, name, None)
        if isinstance(value, np.ndarray) and value.dtype == np.float64 and value.size:
            yield name, value


def rows_of_arms(model: mujoco.MjModel) -> dict[int, npt.NDArray[np.int64]]:
    """Rows of arms in an array, by the length of the array; those of objects are not falsified."""
    arm_bodies = [i for i in range(model.nbody) if "/" in model.body(i).name]
    dofs = np.flatnonzero(np.isin(model.dof_bodyid, arm_bodies))
    joints = np.flatnonzero(np.isin(model.jnt_bodyid, arm_bodies))
    return {
        model.nbody: np.array(arm_bodies),
        model.nv: dofs,
        model.nq: model.jnt_qposadr[joints].astype(np.int64),
        model.njnt: joints,
        model.ngeom: np.flatnonzero(np.isin(model.geom_bodyid, arm_bodies)),
    }


class Poison:
    """Replaces `World.step` by one that falsifies the state after each step.

    Args:
        world: World to poison.
        wanted: Predicate of the names of arrays; all by default.
    """

    def __init__(self, world: World, selects: Callable[[str], bool] = lambda _: True) -> None:
        self.names: set[str] = set()
        self.truth: list[Numbers] = []
        self._world = world
        self._wanted = selects
        self._step = world.step
        self._saved: list[tuple[Numbers, Numbers]] = []
        self._rng = np.random.default_rng(0)
        world.step = self.step  # type: ignore[method-assign]  # that is the poison

    def step(self) -> None:
        for array, true in self._saved:
            array[...] = true
        self._saved.clear()
        self._step()
        data = self._world.data
        self.truth.append(np.concatenate((data.qpos, data.qvel, data.ctrl)))
        self.spoil()

    def spoil(self) -> None:
        model = self._world.model
        data = self._world.data
        rows = rows_of_arms(model)
        state = ((n, a) for n, a in floats(data, iter(dir(data))) if n not in COMMANDED)
        for name, array in (*state, *floats(model, iter(OF_THE_MODEL))):
            if not self._wanted(name):
                continue
            self.names.add(name)
            self._saved.append((array, array.copy()))
            which = rows.get(len(array), slice(None))
            part = array[which]
            array[which] = part * self._rng.uniform(0.5, 2.0) + self._rng.uniform(0.1, 0.5)


def states_of(reality: str, selects: Callable[[str], bool] | None) -> tuple[Matrix, set[str]]:
    """True states at every step of 1.2 s, and names of falsified arrays; none for ``None``."""
    tree = TREE.replace("REALITY", reality)
    with bt.open(tree, renderer="ray") as run:
        poison = Poison(run.world, selects or (lambda _: False))
        run.step(1.2)
        return np.array(poison.truth), poison.names


@pytest.mark.parametrize("reality", ["ideal", "lab"])
def test_falsified_true_state_changes_nothing(reality: str) -> None:
    """Plans, guards and controllers of two arms near each other are identical, bit for bit."""
    sound, _ = states_of(reality, None)
    poisoned, names = states_of(reality, lambda _: True)
    assert {"qpos", "qvel", "xpos", "site_xpos", "geom_xpos", "qfrc_bias", *OF_THE_MODEL} <= names
    assert len(names) > 50
    np.testing.assert_array_equal(poisoned, sound)
    assert np.abs(np.diff(sound[:, -13:], axis=0)).max() > 0.1, "the arms should have moved"


def test_reading_the_falsified_state_would_be_noticed() -> None:
    """Encoders that read the falsified state change the motion: the test above can fail."""
    sound, _ = states_of("ideal", None)
    with bt.open(TREE.replace("REALITY", "ideal"), renderer="ray") as run:
        poison = Poison(run.world, lambda name: name == "qpos")
        spoil = poison.spoil

        def spoil_and_read() -> None:
            spoil()
            run.world.sense()

        poison.spoil = spoil_and_read  # type: ignore[method-assign]  # sensors after the poison
        run.step(0.2)
        read = np.array(poison.truth)
    assert np.abs(read - sound[: len(read)]).max() > 1e-3


def test_pose_of_an_image_is_not_the_true_one() -> None:
    """It comes from encoders and calibration, not from the plant's camera."""
    with bt.open(TREE.replace("REALITY", "lab"), renderer="ray") as run:
        run.step(0.1)
        known = calibration_of(run.world, "arm2", 3)
        before = known.pose_at(run.time)
        poison = Poison(run.world)
        poison.spoil()
        after = known.pose_at(run.time)
        assert (after.position == before.position).all()
        assert (after.quaternion == before.quaternion).all()
