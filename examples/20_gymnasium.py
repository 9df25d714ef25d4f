"""Use a tree file as a Gymnasium environment: check it, control it, step several at once.

Needs the extra ``gym`` (``pip install 'bt_dualarm[gym]'``).

Prints::

    action: 7 numbers; observation: external_torque, gripper, joint_position, joint_velocity, ...
    Gymnasium's checker accepts it
    reached in 2.0... s: reward 1.0, {'there': True}
    two at once: rewards [0. 0.], tools [0.7 0.7] m high
"""

from functools import partial

import numpy as np
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv

import bt_dualarm as bt

# Rewards and ends of episodes come from `goal` (and `always`, `never`). Actions replace the arm's
# tree, which may solve the task itself: `bt-run` of the same file gives demonstrations.
TREE = """
bt_dualarm: 1
name: reach
world: {scene: empty, reality: lab, time_limit: 4}
arms:
  arm1:
    robot: ur5
    gripper: robotiq_2f85
    base: {xyz: [0, 0, 0.40]}
    posture: present
    tree: {reach_to_pose: {to: {xyz: [0.70, 0.25, 0.60]}}}
goal:
  there: {tool: arm1, at: {xyz: [0.70, 0.25, 0.60]}, within: 0.02}
"""
TARGET = np.array([0.70, 0.25, 0.60])

make = partial(bt.gym, TREE, action="tool")
env = make()
names = ", ".join(env.observation_space.spaces)
print(f"action: {len(env.action_space.sample())} numbers; observation: {names}")
check_env(env, skip_render_check=True)
print("Gymnasium's checker accepts it")

# A proportional controller as the policy; the tool's pose is that of the encoders.
observation, info = env.reset(seed=3)  # the seed samples friction, masses, sensor errors
total = 0.0
terminated = truncated = False
while not (terminated or truncated):
    toward = np.clip(8.0 * (TARGET - observation["tool_position"]), -1.0, 1.0)
    action = np.array([*toward, 0, 0, 0, 1], np.float32)  # turn about no axis, keep the hand open
    observation, reward, terminated, truncated, info = env.step(action)
    total += reward
print(f"reached in {info['time_s']:.2f} s: reward {total}, {info['goals']}")
env.close()

# `AsyncVectorEnv` does the same with a process for each environment.
vector = SyncVectorEnv([make, make])
vector.reset(seed=5)  # the first with 5, the second with 6
for _ in range(5):
    observations, rewards = vector.step(np.zeros((2, 7), np.float32))[:2]
heights = observations["tool_position"][:, 2].round(2)
print(f"two at once: rewards {rewards}, tools {heights} m high")
vector.close()
