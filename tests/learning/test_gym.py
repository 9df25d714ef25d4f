"""A tree file as a Gymnasium environment: checker, seeds, vectors, limits, rewards, errors."""

from __future__ import annotations

import logging
import sys
import warnings
from collections.abc import Iterator
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv

import bt_dualarm as bt
from bt_dualarm.core.errors import DualArmError, RunError
from bt_dualarm.runtime.arm_runtime import IdleObserver

REACH = """\
bt_dualarm: 1
name: reach
world: {scene: empty, reality: lab, time_limit: 2}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.4]}
    posture: present
    tree: {reach_to_pose: {offset: {xyz: [0, 0.1, 0]}}}
goal:
  near: {tool: arm1, height: [0.2, 0.9]}
  left: {tool: arm1, at: {xyz: [0.655, 0.16, 0.70]}, within: 0.02}
never:
  high: {tool: arm1, height: [0.78, 3]}
"""

CELL = """\
bt_dualarm: 1
name: two_arms
world: {scene: table, reality: lab, time_limit: 5}
objects:
  cube:
    {shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, color: red, pose: {xyz: [0.35, -0.45, 0.425]}}
arms:
  arm1:
    robot: panda
    base: {xyz: [0.35, 0, 0.40], rpy: [0, 0, -90]}
    gripper: panda_hand
    camera: {mount: wrist, resolution: [32, 24], fov: 50, fps: 20}
    tree: {wait: {seconds: 1}}
  arm2:
    robot: ur5
    base: {xyz: [-0.6, -0.3, 0.4]}
    gripper: suction_cup
    tree: {sequence: [{wait: {seconds: 0.1}}, {set: {key: done, value: 1}}]}
goal:
  lifted: {object: cube, height: [0.5, 2]}
"""


@pytest.fixture
def reach() -> Iterator[Any]:
    env = bt.gym(REACH, action="tool")
    yield env
    env.close()


@pytest.mark.parametrize(
    "given",
    [
        {"tree": REACH, "action": "joints"},
        {"tree": REACH, "action": "tool", "render_mode": "rgb_array"},
        {"tree": CELL, "arm": "arm1", "action": "tool", "camera": True, "privileged": True},
        {"tree": CELL, "arm": ["arm1", "arm2"], "horizon": 0.2},
    ],
)
def test_environment_passes_the_checker_of_gymnasium(given: dict[str, Any]) -> None:
    env = bt.gym(**given)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env, skip_render_check=True)
    env.close()


def rollout(env: Any, seed: int, count: int) -> list[Any]:
    """Observations, rewards and end flags of seeded actions."""
    env.action_space.seed(1)
    found = [env.reset(seed=seed)[0]]
    for _ in range(count):
        observation, *rest = env.step(env.action_space.sample())
        found.append((observation, *rest[:3]))
    return found


def equal(one: Any, other: Any) -> bool:
    """Bitwise equality of nested results."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(equal(one[key], other[key]) for key in one)
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(map(equal, one, other))
    return bool(np.array_equal(one, other))


def test_equal_seeds_and_actions_give_equal_episodes(reach: Any) -> None:
    first = rollout(reach, 3, 12)
    other = rollout(reach, 4, 12)
    assert equal(first, rollout(reach, 3, 12)), "earlier episodes have no effect"
    assert not equal(first, other), "the seed samples another robot"
    fresh = bt.gym(REACH, action="tool")
    assert equal(first, rollout(fresh, 3, 12)), "the same in another environment"
    fresh.close()


def test_episodes_without_a_seed_differ_and_their_sequence_is_repeatable(reach: Any) -> None:
    def seeds() -> list[int]:
        reach.reset(seed=7)
        found = []
        for _ in range(2):
            reach.reset()
            found.append(reach.run.seed)
        return found

    first = seeds()
    assert len(set(first)) == 2
    assert seeds() == first


def test_vector_environments_agree_with_single_ones() -> None:
    """Both of Gymnasium's wrappers agree; the second runs each environment in its own process."""
    make = partial(bt.gym, REACH, action="tool", speed=1.0)
    single = make()
    actions = np.random.default_rng(0).uniform(-1, 1, (5, 2, 6)).astype(np.float32)
    expected = []
    for number in range(2):
        single.reset(seed=3 + number)
        expected.append([single.step(action) for action in actions[:, number]])
    single.close()
    for vector in (SyncVectorEnv([make, make]), AsyncVectorEnv([make, make])):
        vector.reset(seed=3)
        for count, action in enumerate(actions):
            observation, reward, *_ = vector.step(action)
            for number in range(2):
                then = expected[number][count]
                assert equal({key: each[number] for key, each in observation.items()}, then[0])
                assert reward[number] == then[1]
        vector.close()


def test_zero_action_keeps_the_arm_in_place(reach: Any) -> None:
    start, _ = reach.reset(seed=0)
    for _ in range(10):
        observation, *_ = reach.step(np.zeros(6, np.float32))
    away = np.abs(observation["joint_position"] - start["joint_position"]).max()
    assert away < 1e-3, "rad, in lab"


@pytest.mark.parametrize("axis", range(6))
def test_action_moves_the_tool_along_one_axis_of_the_world(reach: Any, axis: int) -> None:
    action = np.zeros(6, np.float32)
    action[axis] = -0.8
    before, _ = reach.reset(seed=0)
    for count in range(22):
        after, *_ = reach.step(action if count < 10 else np.zeros(6, np.float32))
    moved = after["tool_position"] - before["tool_position"]
    turns = [columns_of(each["tool_rotation"]) for each in (before, after)]
    turned = turns[1] @ turns[0].T
    angles = 0.5 * np.array(
        [turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]
    )
    # Ten steps of 40 ms at 0.8 of a quarter of 0.5 m/s and 2 rad/s.
    expected = np.zeros(6)
    expected[axis] = -0.04 if axis < 3 else -np.sin(0.16)
    assert np.abs(np.concatenate([moved, angles]) - expected).max() < 2e-3


def columns_of(rotation: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Rotation matrix from its first two columns."""
    first, second = rotation[:3].astype(float), rotation[3:].astype(float)
    return np.column_stack([first, second, np.cross(first, second)])


class SetPoints(IdleObserver):
    """Records the set-point of an arm after each step."""

    def __init__(self, run: bt.Run) -> None:
        self._run = run
        self.rows: list[np.ndarray[Any, Any]] = []

    def after_step(self, time: float) -> None:
        (arm,) = self._run.assembly.arms.present
        self.rows.append(np.array(arm.controller.setpoint))


def test_extreme_actions_stay_within_all_limits() -> None:
    """Actions jump between their bounds in each step."""
    env = bt.gym(REACH.replace("never:", "nothing:").split("nothing:")[0], speed=1.0)
    env.reset(seed=2)
    run = env.run
    assert run is not None
    found = SetPoints(run)
    run.watch(found)
    rng = np.random.default_rng(5)
    for _ in range(40):
        *_, terminated, truncated, _ = env.step(rng.choice([-1.0, 1.0], 6).astype(np.float32))
        if terminated or truncated:
            break
    rows = np.array(found.rows)
    limits = run.world.robots["arm1"].limits
    assert len(rows) > 300
    assert (rows[:, 0] >= limits.lower - 1e-9).all()
    assert (rows[:, 0] <= limits.upper + 1e-9).all()
    assert (np.abs(rows[:, 1]) <= limits.velocity * (1 + 1e-9)).all()
    assert (np.abs(rows[:, 2]) <= limits.acceleration * (1 + 1e-9)).all()
    assert np.abs(rows[:, 1]).max() > 0.1, "it moves"
    env.close()


def test_goals_reward_and_terminate(reach: Any) -> None:
    """One of two goals is met at the start; the other is worth 0.5 and ends the episode."""
    reach.reset(seed=1)
    rewards = []
    for _ in range(45):
        _, reward, terminated, truncated, info = reach.step(go_left(reach))
        rewards.append(reward)
        if terminated or truncated:
            break
    assert (terminated, truncated) == (True, False)
    assert info["is_success"]
    assert info["goals"] == {"near": True, "left": True}
    assert sum(rewards) == rewards[-1] == 0.5
    with pytest.raises(gymnasium.error.ResetNeeded):
        reach.step(np.zeros(6, np.float32))


def go_left(env: Any) -> np.ndarray[Any, Any]:
    """An action toward the second goal of `REACH`, by the true pose."""
    away = np.array([0.655, 0.16, 0.70]) - env.run.arms["arm1"].tool_pose.position
    return np.clip(np.array([*(15 * away), 0, 0, 0]), -1, 1).astype(np.float32)


def test_violated_invariant_costs_and_terminates(reach: Any) -> None:
    reach.reset(seed=1)
    up = np.array([0, 0, 1, 0, 0, 0], np.float32)
    for _ in range(45):
        _, reward, terminated, truncated, info = reach.step(up)
        if terminated or truncated:
            break
    assert (terminated, truncated) == (True, False)
    assert "never high is violated" in info["violation"]
    assert reward == -1.0
    assert not info["is_success"]


def test_horizon_truncates_the_episode() -> None:
    for horizon, steps in ((0.2, 5), (None, 50)):
        env = bt.gym(REACH, horizon=horizon)
        env.reset(seed=0)
        count = 0
        truncated = False
        while not truncated:
            *_, terminated, truncated, info = env.step(np.zeros(6, np.float32))
            assert not terminated
            count += 1
        assert count == steps
        assert info["time_s"] == pytest.approx(horizon or 2.0, abs=0.05)
        env.close()


def test_reward_may_be_a_function_of_the_user() -> None:
    env = bt.gym(REACH, reward=lambda env: -float(env.run.time))  # type: ignore[union-attr]  # it is open
    env.reset(seed=0)
    assert env.step(np.zeros(6, np.float32))[1] == pytest.approx(-0.042)
    env.close()


def test_two_arms_have_gripper_actions_images_and_object_poses() -> None:
    env = bt.gym(CELL, arm=["arm1", "arm2"], action="tool", camera=True, privileged=True)
    observation, _ = env.reset(seed=0)
    assert env.action_space.shape == (14,)
    assert observation["arm1.gripper"][0] == pytest.approx(1.0, abs=0.02)
    action = np.zeros(14, np.float32)
    action[6] = -1.0  # close
    action[13] = -1.0  # suck
    for _ in range(25):
        observation, *_ = env.step(action)
    assert observation["arm1.gripper"][0] < 0.05
    assert env.run is not None
    assert env.run.world.grippers["arm2"].commanded.width == 0.0
    assert observation["arm1.image"].shape == (24, 32, 3)
    assert observation["arm1.image"].any(), "an image was delivered"
    assert "arm2.image" not in observation
    np.testing.assert_allclose(observation["objects"][:3], [0.35, -0.45, 0.425], atol=2e-3)
    env.close()


def test_other_arms_execute_their_trees() -> None:
    env = bt.gym(CELL, arm="arm1")
    env.reset(seed=0)
    for _ in range(5):
        env.step(np.zeros(8, np.float32))
    assert env.run is not None
    assert env.run.arms["arm2"].outcome is bt.Outcome.SUCCESS
    assert env.run.arms["arm1"].outcome is None
    env.close()


def test_contact_stops_the_arm_which_then_accepts_actions_again() -> None:
    """Pressed onto the table, it stops with a code; commanded upwards, it moves again."""
    tree = CELL.replace("tree: {wait: {seconds: 1}}", "collision: {stop: true}\n    tree: wait_1")
    tree = tree.replace("wait_1", "{wait: {seconds: 1}}")
    env = bt.gym(tree, arm="arm1", action="tool", speed=0.5)
    start, _ = env.reset(seed=0)
    down = np.array([0, 0, -1, 0, 0, 0, 1], np.float32)
    codes = set()
    for _ in range(100):
        observation, *_, info = env.step(down)
        codes.add(info["stopped"]["arm1"])
        if len(codes) > 1:
            break
    assert codes - {""} <= {"COLLISION", "FORCE_LIMIT", "IN_COLLISION"}
    assert len(codes) == 2
    low = observation["tool_position"][2]
    assert np.abs(observation["tool_position"][:2] - start["tool_position"][:2]).max() < 2e-3
    for _ in range(40):
        observation, *_, info = env.step(-down)
    assert info["stopped"]["arm1"] == ""
    assert observation["tool_position"][2] > low + 0.05
    env.close()


def test_arms_do_not_collide() -> None:
    """The guard keeps arms apart that are driven at each other."""
    tree = {
        "bt_dualarm": 1,
        "arms": {
            name: {
                "robot": "ur5",
                "base": {"xyz": [x, 0, 0], "rpy": [0, 0, yaw]},
                "posture": "present",
                "tree": {"wait": {"seconds": 1}},
            }
            for name, x, yaw in (("arm1", 0.0, 0), ("arm2", 1.6, 180))
        },
        "goal": {"far": {"tool": "arm1", "height": [5, 6]}},
    }
    env = bt.gym(tree, arm=["arm1", "arm2"], action="tool", speed=1.0)
    env.reset(seed=0)
    assert env.run is not None
    toward = np.array([1, 0, 0, 0, 0, 0, -1, 0, 0, 0, 0, 0], np.float32)
    nearest = np.inf
    for _ in range(60):
        env.step(toward)
        world = env.run.world
        names = [
            {
                world.model.body(int(world.model.geom_bodyid[geom])).name.split("/")[0]
                for geom in pair
            }
            for pair in world.data.contact.geom[world.data.contact.dist <= 0.0]
        ]
        assert {"arm1", "arm2"} not in names
        tools = [env.run.arms[name].tool_pose for name in ("arm1", "arm2")]
        nearest = min(nearest, tools[0].distance(tools[1]))
    assert nearest < 0.3, "they came close"
    env.close()


def test_images_are_rendered_on_request() -> None:
    env = bt.gym(REACH, render_mode="rgb_array", size=(64, 48))
    env.reset(seed=0)
    image = env.render()
    assert image is not None
    assert image.shape == (48, 64, 3)
    assert env.metadata["render_fps"] == 25
    env.close()


def test_many_episodes_log_nothing(reach: Any, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        for _ in range(3):
            reach.reset()
            reach.step(np.ones(6, np.float32))
    assert caplog.records == []


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"tree": CELL}, "arm: the file has several; name one or more of arm1, arm2"),
        ({"tree": CELL, "arm": "arm3"}, "there is no arm 'arm3'; the file has arm1, arm2"),
        ({"tree": CELL, "arm": ["arm1", "arm1"]}, "must name arms of the file, each once"),
        ({"tree": REACH, "action": "torque"}, "action: 'torque' is neither 'joints' nor 'tool'"),
        ({"tree": REACH, "step": 0}, "step: 0 is not a number of seconds above 0"),
        ({"tree": REACH, "step": 11}, "step: 11 s is not from 0.002 to 10 s"),
        ({"tree": REACH, "speed": 2}, "speed: 2 is not above 0 to 1"),
        ({"tree": REACH, "horizon": -1}, "horizon: -1 is not a number of seconds"),
        ({"tree": REACH, "camera": True}, "camera: arm1: no such arm has a camera"),
        ({"tree": REACH, "render_mode": "human"}, "render_mode: 'human' is neither"),
        ({"tree": REACH.split("goal:")[0]}, "it has none: add one"),
        ({"tree": REACH.replace("ur5", "ur55")}, "there is no robot 'ur55'"),
    ],
)
def test_wrong_argument_is_reported(given: dict[str, Any], message: str) -> None:
    with pytest.raises(DualArmError, match=message):
        bt.gym(**given)


@pytest.mark.parametrize("action", [[0.0] * 5, [np.nan] + [0.0] * 5, [[0.0] * 6]])
def test_wrong_action_is_refused(reach: Any, action: Any) -> None:
    reach.reset(seed=0)
    with pytest.raises(RunError, match="action: expected 6 finite numbers from -1 to 1"):
        reach.step(np.array(action, np.float32))


def test_action_that_is_no_array_is_refused(reach: Any) -> None:
    reach.reset(seed=0)
    with pytest.raises(RunError, match="action: 'left' is no array of numbers"):
        reach.step("left")


def test_missing_gymnasium_is_reported_with_the_command_to_install_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "bt_dualarm.learning.environment", raising=False)
    with pytest.raises(
        DualArmError, match=r"bt\.gym needs gymnasium: pip install 'bt_dualarm\[gym\]'"
    ):
        bt.gym(REACH)
