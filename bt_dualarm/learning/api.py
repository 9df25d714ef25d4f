"""The front door: a tree file as a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Literal

from bt_dualarm.core.errors import DualArmError, RunError
from bt_dualarm.runtime.api import Skills, Tree, checked_file
from bt_dualarm.runtime.options import RunOptions, checked_reality, checked_seconds
from bt_dualarm.sim.frame import RendererKind
from bt_dualarm.spec.document import RealitySpec

if TYPE_CHECKING:
    from bt_dualarm.learning.environment import BehaviorEnv


def gym(
    tree: Tree,
    *,
    arm: str | Sequence[str] | None = None,
    action: Literal["joints", "tool"] = "joints",
    step: float = 0.04,
    speed: float = 0.25,
    horizon: float | None = None,
    camera: bool = False,
    privileged: bool = False,
    reward: Callable[[BehaviorEnv], float] | None = None,
    render_mode: str | None = None,
    size: tuple[int, int] = (320, 240),
    params: Mapping[str, object] | None = None,
    reality: str | RealitySpec | Mapping[str, object] | None = None,
    renderer: RendererKind | None = None,
    skills: Skills = (),
) -> BehaviorEnv:
    """A tree file as a Gymnasium environment; actions replace the trees of one or more arms.

    Everything else of the file stays: world, objects, sensors, the trees of other arms, and the
    gates that set-points pass. An action has a number from -1 to 1 for each joint (or for each axis
    of the tool: along x, y, z of the world, then about them), and one for the gripper of an arm
    that has one: -1 closes, 1 opens; a cup sucks below 0. It moves the goal by that fraction of the
    distance that ``speed`` allows in one step.

    Observations are what the arm senses: ``joint_position``, ``joint_velocity``,
    ``external_torque`` (estimated), ``tool_position`` and ``tool_rotation`` (the first two columns
    of the rotation matrix) from the encoders, ``gripper`` (opening or vacuum, and force, as
    fractions of their largest values) and ``image``. With several arms, names begin with ``ARM.``.

    The reward of a step is the change of the share of the file's ``goal`` entries that are met,
    less 1 if an invariant (``always``, ``never``) is violated. An episode terminates when all goals
    are met or an invariant is violated, and is truncated at the horizon. ``info`` has ``time_s``,
    ``goals``, ``is_success``, ``violation``, and ``stopped``: for each arm the code of the failure
    that stopped it during the step, or an empty text.

    Args:
        tree: Tree in any form that `run` takes.
        arm: Arm or arms that actions move; may be left out if the file has one arm.
        action: ``joints`` or ``tool``.
        step: Simulated seconds of one action.
        speed: Largest speed, as a fraction of the joints' velocity limits, above 0 to 1; the tool's
            is 0.5 m/s and 2 rad/s times this fraction. The faster, the later the arm responds: a
            UR5 lags by 0.1 s at 0.25 and by 0.5 s at 1, since its accelerations are limited.
        horizon: Simulated seconds of an episode; by default the file's ``time_limit``.
        camera: Whether the images of the arms' cameras are observed.
        privileged: Whether the true poses of all movable objects are observed, which no arm can
            know: ``objects``, seven numbers each.
        reward: Function of the environment that computes the reward of a step instead.
        render_mode: ``rgb_array``, or None.
        size: Width and height of rendered images in pixels.
        params: Values of the tree's parameters.
        reality: Deviations of the simulated arms from the nominal model.
        renderer: Renderer of the cameras.
        skills: Additional skills.

    Raises:
        DualArmError: Gymnasium is not installed; the message states how to install it.
        RunError: An argument is invalid, or the file has no ``goal`` and no ``reward`` is given.
        SpecError, NoSuchTree: As `run`.
    """
    try:
        from bt_dualarm.learning.environment import BehaviorEnv, Settings, chosen_arms
    except ImportError as error:
        if (error.name or "").partition(".")[0] != "gymnasium":
            raise
        raise DualArmError("bt.gym needs gymnasium: pip install 'bt_dualarm[gym]'") from error
    file, registry = checked_file(tree, params, skills)
    if action not in ("joints", "tool"):
        raise RunError(f"action: {action!r} is neither 'joints' nor 'tool'")
    if render_mode not in (None, "rgb_array"):
        raise RunError(f"render_mode: {render_mode!r} is neither 'rgb_array' nor None")
    checked_seconds(step, "step")
    if step < file.world.timestep or step > 10.0:
        raise RunError(f"step: {step} s is not from {file.world.timestep:g} to 10 s")
    if not 0.0 < speed <= 1.0:
        raise RunError(f"speed: {speed!r} is not above 0 to 1")
    limit = file.world.time_limit
    horizon = limit if horizon is None else min(checked_seconds(horizon, "horizon"), limit)
    names = chosen_arms(file, arm)
    if not file.goal and reward is None:
        raise RunError("rewards come from the file's goals, and it has none: add one, or reward=")
    if camera and not any(file.arms[name].camera for name in names):
        raise RunError(f"camera: {', '.join(names)}: no such arm has a camera in the file")
    realistic = None if reality is None else checked_reality(reality)
    settings = Settings(
        names, action, step, speed, horizon, camera, privileged, reward, render_mode, size
    )
    return BehaviorEnv(file, registry, RunOptions(renderer=renderer, reality=realistic), settings)
