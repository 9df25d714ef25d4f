"""The environment: a run that is advanced by actions, rewarded by the goals of its file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from bt_dualarm.core.errors import DualArmError, RunError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.learning.external_control import ExternalControl, Stick
from bt_dualarm.runtime.options import MOST_SEED, RunOptions
from bt_dualarm.runtime.run import Run
from bt_dualarm.skill.registry import Registry, yaml_name
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.node_types import NodeSpec

Observation: TypeAlias = dict[str, npt.NDArray[Any]]
Action: TypeAlias = npt.NDArray[np.float32]
RewardFunction: TypeAlias = Callable[["BehaviorEnv"], float]
"""Computes the reward of a step; it may read the true world."""

_FAR_M: Final = 10.0
"""Bound of positions in observations, m."""

_TORQUE_SHARE: Final = 2.0
"""Bound of estimated external torques, as a multiple of the joints' limits."""

_SPEED_SHARE: Final = 1.5
"""Bound of measured joint velocities, as a multiple of the joints' limits."""


@dataclass(frozen=True)
class Settings:
    """Settings of an environment, see `bt_dualarm.gym`."""

    arms: tuple[str, ...]
    action: str
    step_s: float
    speed: float
    horizon_s: float
    camera: bool
    privileged: bool
    reward: RewardFunction | None
    render_mode: str | None
    size: tuple[int, int]


class BehaviorEnv(gymnasium.Env[Any, Any]):
    """A run as a Gymnasium environment; the actions replace the trees of some arms.

    Other arms execute their trees. Equal seeds and actions give equal observations, bit for bit on
    one kind of processor.

    Args:
        file: Checked tree file.
        registry: Skills of the trees.
        options: Options of each run.
        settings: Settings of the environment.

    Attributes:
        run: The current run; None before the first reset.
    """

    observation_space: spaces.Dict[Any]
    action_space: spaces.Box
    metadata: dict[str, Any] = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - as Env declares it

    def __init__(
        self, file: TreeFile, registry: Registry, options: RunOptions, settings: Settings
    ) -> None:
        self.run: Run | None = None
        self.render_mode = settings.render_mode
        self.metadata = {**self.metadata, "render_fps": round(1.0 / settings.step_s)}
        self._settings = settings
        self._sticks = {
            name: Stick(settings.action, settings.speed, settings.step_s)  # type: ignore[arg-type]  # checked
            for name in settings.arms
        }
        self._file, self._registry = _controlled(file, registry, self._sticks)
        self._options = options
        self._ended = True
        # The spaces depend on robots and grippers, which the world has loaded.
        self._open(0)
        self.action_space = spaces.Box(-1.0, 1.0, (sum(self._lengths().values()),), np.float32)
        self._boxes = self._spaces()
        self.observation_space = spaces.Dict({**self._boxes})

    def reset(
        self,
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # as Gymnasium's
    ) -> tuple[Observation, dict[str, Any]]:  # likewise
        """Begin a new run.

        Args:
            seed: Seed of the run, as for `bt_dualarm.run`; by default drawn from `np_random`.
            options: Not used.

        Raises:
            RunError: The seed is out of range.
        """
        del options
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(MOST_SEED, endpoint=True))
        self._open(drawn if seed is None else seed)
        self._ended = False
        self._share = self._goals_share()
        return self._observation(), self._info()

    def step(
        self, action: Action
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:  # as Gymnasium's
        """Execute an action for the duration of a step.

        Returns:
            Observation; reward; whether the goals are met or an invariant is violated; whether the
            time is over; information, see `bt_dualarm.gym`.

        Raises:
            gymnasium.error.ResetNeeded: The episode has ended, or not begun.
            RunError: The action has another shape, or numbers that are not finite.
        """
        if self.run is None or self._ended:
            raise gymnasium.error.ResetNeeded("the episode has ended or not begun: call reset()")
        self._push(self._checked(action))
        if not self.run.done:
            self.run.step(self._settings.step_s)
        share = self._goals_share()
        violation = self.run.violation
        if self._settings.reward is not None:
            reward = float(self._settings.reward(self))
        else:
            reward = share - self._share - (1.0 if violation else 0.0)
        self._share = share
        terminated = bool(violation) or (bool(self._file.goal) and share >= 1.0)
        late = self.run.time >= self._settings.horizon_s - 1e-6
        truncated = not terminated and (late or self.run.done)
        self._ended = terminated or truncated
        return self._observation(), reward, terminated, truncated, self._info()

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Image of the world, of shape (height, width, 3); None without a ``render_mode``."""
        if self.render_mode is None or self.run is None:
            return None
        return self.run.render(size=self._settings.size)

    def close(self) -> None:
        """Close the run and release its resources."""
        if self.run is not None:
            self.run.close()
            self.run = None
        self._ended = True

    def _open(self, seed: int) -> None:
        for stick in self._sticks.values():
            stick.forget()
        if self.run is not None:
            self.run.reset(seed)
        else:
            options = RunOptions(**{**vars(self._options), "seed": seed})
            self.run = Run(self._file, self._registry, options)
        # The first tick hands the arms over, and the first image is taken.
        self.run.step(self.run.world.timestep)

    def _checked(self, action: Action) -> Vector:
        try:
            values = np.asarray(action, dtype=float)
        except (TypeError, ValueError):
            raise RunError(f"action: {action!r} is no array of numbers"[:400]) from None
        if values.shape != self.action_space.shape or not np.isfinite(values).all():
            raise RunError(
                f"action: expected {self.action_space.shape[0]} finite numbers from -1 to 1, "
                f"not an array of shape {values.shape}: {values!r}"[:400]
            )
        return np.clip(values, -1.0, 1.0)

    def _push(self, action: Vector) -> None:
        at = 0
        for name, length in self._lengths().items():
            part = action[at : at + length]
            at += length
            stick = self._sticks[name]
            if name in self._world.grippers:
                stick.grip = 0.5 * (float(part[-1]) + 1.0)
                part = part[:-1]
            stick.push(part)

    def _lengths(self) -> dict[str, int]:
        """Number of values of the action for each arm."""
        world = self._world
        return {
            name: (world.robots[name].dof if self._settings.action == "joints" else 6)
            + (name in world.grippers)
            for name in self._settings.arms
        }

    @property
    def _world(self) -> Any:  # Any: `World`, whose attributes are not narrowed
        if self.run is None:
            raise DualArmError("the environment is closed")
        return self.run.world

    def _prefix(self, arm: str) -> str:
        return f"{arm}." if len(self._settings.arms) > 1 else ""

    def _spaces(self) -> dict[str, spaces.Box]:
        found: dict[str, spaces.Box] = {}
        world = self._world
        for name in self._settings.arms:
            first = self._prefix(name)
            limits = world.robots[name].limits
            slack = 0.1
            found[f"{first}joint_position"] = _box(limits.lower - slack, limits.upper + slack)
            for key, most in (
                ("joint_velocity", _SPEED_SHARE * limits.velocity),
                ("external_torque", _TORQUE_SHARE * limits.effort),
                ("tool_position", np.full(3, _FAR_M)),
                ("tool_rotation", np.ones(6)),
            ):
                found[f"{first}{key}"] = _box(-most, most)
            if name in world.grippers:
                found[f"{first}gripper"] = _box(np.array([0.0, -1.5]), np.full(2, 1.5))
            camera = self._file.arms[name].camera
            if self._settings.camera and camera is not None:
                width, height = camera.resolution
                found[f"{first}image"] = spaces.Box(0, 255, (height, width, 3), np.uint8)
        if self._settings.privileged:
            count = 7 * len(self._movable())
            found["objects"] = _box(np.full(count, -_FAR_M), np.full(count, _FAR_M))
        return found

    def _movable(self) -> list[str]:
        return [name for name, obj in self._file.objects.items() if not obj.fixed]

    def _observation(self) -> Observation:
        """Readings of the sensors, clipped to the space."""
        found: Observation = {}
        world = self._world
        for name in self._settings.arms:
            first = self._prefix(name)
            hardware = world.hardware[name]
            tool: Pose = world.nominal[name].tool_pose_at(hardware.q)
            found[f"{first}joint_position"] = hardware.q
            found[f"{first}joint_velocity"] = hardware.v
            torque = self._sticks[name].torque
            dof = world.robots[name].dof
            found[f"{first}external_torque"] = np.zeros(dof) if torque is None else torque()
            found[f"{first}tool_position"] = tool.position
            found[f"{first}tool_rotation"] = tool.rotation_matrix[:, :2].T.ravel()
            if name in world.grippers:
                gripper = world.grippers[name]
                description = gripper.gripper
                opening = (
                    gripper.width / description.stroke if description.fingers else gripper.vacuum
                )
                found[f"{first}gripper"] = np.array(
                    [opening, gripper.force / description.force.most]
                )
            key = f"{first}image"
            if key in self._boxes:
                frame = self._sticks[name].frame
                shape = self._boxes[key].shape
                found[key] = np.zeros(shape, np.uint8) if frame is None else frame
        if self._settings.privileged:
            poses = np.zeros((len(self._movable()), 7))
            for pose, name in zip(poses, self._movable(), strict=True):
                if name in world.objects:
                    true = world.object_pose(name)
                    pose[:] = [*true.position, *true.quaternion]
            found["objects"] = poses.ravel()
        return {
            key: np.clip(values, space.low, space.high).astype(space.dtype)
            for key, space in self._boxes.items()
            for values in (found[key],)
        }

    def _goals_share(self) -> float:
        """Fraction of the goals that are met now."""
        if self.run is None or not self._file.goal:
            return 0.0
        goals = self.run.goals
        return sum(goal.met for goal in goals.values()) / len(goals)

    def _info(self) -> dict[str, Any]:  # as Gymnasium's
        if self.run is None:
            return {}
        goals = self.run.goals
        return {
            "time_s": self.run.time,
            "goals": {name: goal.met for name, goal in goals.items()},
            "is_success": bool(goals) and all(goal.met for goal in goals.values()),
            "violation": self.run.violation,
            "stopped": {name: stick.stopped for name, stick in self._sticks.items()},
        }


def _box(low: Vector, high: Vector) -> spaces.Box:
    return spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)


def _controlled(
    file: TreeFile, registry: Registry, sticks: Mapping[str, Stick]
) -> tuple[TreeFile, Registry]:
    """The file with external control instead of the trees of some arms, and its skills."""
    skills = dict(registry.skills)
    arms = dict(file.arms)
    for number, (name, stick) in enumerate(sticks.items()):
        skill = type(f"ExternalControl{number}", (ExternalControl,), {"stick": stick})
        skill.__doc__ = ExternalControl.__doc__
        kind = yaml_name(skill)
        skills[kind] = skill
        arms[name] = arms[name].model_copy(update={"tree": NodeSpec(kind, kind, {})})
    return file.model_copy(update={"arms": arms}), Registry(skills, registry.kinds)


def chosen_arms(file: TreeFile, given: str | Sequence[str] | None) -> tuple[str, ...]:
    """Arms that actions move.

    Raises:
        RunError: One is unknown, named twice, or not in the world from the start; or none is named
            although the file has several.
    """
    if given is None:
        if len(file.arms) > 1:
            raise RunError(f"arm: the file has several; name one or more of {', '.join(file.arms)}")
        return tuple(file.arms)
    names = (given,) if isinstance(given, str) else tuple(given)
    if not names or len(set(names)) < len(names):
        raise RunError(f"arm: {given!r} must name arms of the file, each once")
    for name in names:
        if name not in file.arms:
            raise RunError(f"arm: there is no arm {name!r}; the file has {', '.join(file.arms)}")
        if not file.arms[name].spawned:
            raise RunError(f"arm: {name} is not in the world at the start (spawned: false)")
    return names
