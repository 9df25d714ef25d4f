"""Speed of a run relative to a lower bound: bare physics and the same frames.

    python benchmarks/real_time.py [TREE] [--param grasp=attach] [--repeats 3] [--renderer ray]

The tree is run as ``bt-run`` does without a record. In another run, the state before each step, the
torques and joint friction of the step, and the state and region of each frame are recorded. Then,
in the same process, MuJoCo alone makes each of these steps (``mj_step``) and the renderer alone
draws each of these frames, from exactly these states; only the time of both is counted, not that of
restoring the states. Not included: the correction of held objects, sensors, drives, lens
distortion, and image noise.

Prints the real-time factor by wall-clock time, the CPU times of the run and of the bound, their
ratio, and the CPU time of each part of a run. Times are the best of the repeats, because other
programs can only add to them.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

import mujoco
import numpy as np

from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.runtime.options import RunOptions, find_tree
from bt_dualarm.runtime.outcome import RunResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry


class Step(NamedTuple):
    """One step of physics.

    Attributes:
        state: State before it (``mjSTATE_INTEGRATION``), of shape (n,).
        torques: Controls, of shape (nu,).
        friction: Dry friction and damping of the joints, which the world sets, of shape (2, nv).
    """

    state: Vector
    torques: Vector
    friction: Matrix


class Drawing(NamedTuple):
    """One rendered frame.

    Attributes:
        positions: Positions of the state, see `_positions`, which the camera may have extrapolated
            for motion blur.
        camera: Positions and rotations of all cameras, which the camera may have shaken.
        rest: Other positional arguments of the renderer.
        options: Keyword arguments of the renderer.
    """

    positions: tuple[Any, ...]
    camera: tuple[Any, ...]
    rest: tuple[Any, ...]
    options: dict[str, Any]


@dataclass
class Segment:
    """The steps and frames between two changes of the model.

    Attributes:
        model: Compiled model at that time.
        steps: The steps.
        drawings: The frames.
    """

    model: Any
    steps: list[Step] = field(default_factory=list)
    drawings: list[Drawing] = field(default_factory=list)


class Script:
    """Records all calls of physics and renderer."""

    def __init__(self, opened: Run) -> None:
        self.segments: list[Segment] = []
        self._world = opened.assembly.world
        self._generation = -1
        _replace(self._world, "step", self._step)
        if opened.assembly.renderer is not None:
            _replace(opened.assembly.renderer, "render", self._render)

    def _current(self) -> Segment:
        world: World = self._world
        if self._generation != world.generation:
            self._generation = world.generation
            self.segments.append(Segment(world.model))
        return self.segments[-1]

    def _step(self, original: Callable[[], None]) -> None:
        world: World = self._world
        segment = self._current()
        state = world.state()
        friction = np.array((world.model.dof_frictionloss, world.model.dof_damping))
        original()  # the drives set the torques at its beginning
        segment.steps.append(Step(state, world.data.ctrl.copy(), friction))

    def _render(
        self, original: Callable[..., Any], model: Any, data: Any, *rest: Any, **options: Any
    ) -> Any:
        positions = tuple(part.copy() for part in _positions(data))
        camera = tuple(part.copy() for part in _camera(data))
        self._current().drawings.append(Drawing(positions, camera, rest, options))
        return original(model, data, *rest, **options)

    def replay(self, render: Callable[..., Any] | None) -> tuple[float, float]:
        """CPU times of the same steps and of the same frames, s."""
        physics = 0.0
        drawing = 0.0
        for segment in self.segments:
            model = segment.model
            data = mujoco.MjData(model)
            for step in segment.steps:
                mujoco.mj_setState(model, data, step.state, mujoco.mjtState.mjSTATE_INTEGRATION)
                data.ctrl[:] = step.torques
                model.dof_frictionloss[:], model.dof_damping[:] = step.friction
                began = time.thread_time()
                mujoco.mj_step(model, data)
                physics += time.thread_time() - began
            if render is None:  # no arm has a camera
                continue
            for one in segment.drawings:
                _restore(_positions(data), one.positions)
                mujoco.mj_kinematics(model, data)
                mujoco.mj_camlight(model, data)
                _restore(_camera(data), one.camera)
                began = time.thread_time()
                render(model, data, *one.rest, **one.options)
                drawing += time.thread_time() - began
        return physics, drawing


def _positions(data: Any) -> tuple[Any, ...]:
    """Arrays that determine the poses of all bodies."""
    return data.qpos, data.mocap_pos, data.mocap_quat


def _camera(data: Any) -> tuple[Any, ...]:
    """Poses of all cameras."""
    return data.cam_xpos, data.cam_xmat


def _restore(arrays: tuple[Any, ...], values: tuple[Any, ...]) -> None:
    """Copy values into arrays."""
    for array, value in zip(arrays, values, strict=True):
        array[:] = value


class Stopwatch:
    """CPU time spent in each part of a run."""

    def __init__(self, opened: Run) -> None:
        self.spent: dict[str, float] = {}
        arms = opened.assembly.arms
        world = opened.assembly.world
        for part, owner, names in (
            ("physics", world, ("step",)),
            ("control", arms, ("control",)),
            ("camera and vision", arms, ("capture", "deliver")),
            ("trees and skills", arms, ("tick",)),
        ):
            for name in names:
                _replace(owner, name, self._timed(part))

    def _timed(self, part: str) -> Callable[..., Any]:
        def measured(original: Callable[..., Any], *arguments: Any) -> Any:
            began = time.thread_time()
            try:
                return original(*arguments)
            finally:
                self.spent[part] = self.spent.get(part, 0.0) + time.thread_time() - began

        return measured


def _replace(owner: Any, name: str, by: Callable[..., Any]) -> None:
    """Wrap a method of one object in a function whose first argument is the method."""
    original = getattr(owner, name)
    setattr(owner, name, lambda *arguments, **options: by(original, *arguments, **options))


def _observe_nothing(opened: Run) -> None:
    """Add nothing to a run."""
    del opened


def play(
    tree: str,
    renderer: Any,
    instrument: Callable[[Run], None],
    params: Mapping[str, str] = MappingProxyType({}),
) -> tuple[RunResult, float]:
    """Run a tree to its end; returns its result and the CPU time of its steps, s."""
    registry = Registry.load()
    file = load_tree_file(find_tree(tree), registry.kinds, params)
    with Run(file, registry, RunOptions(renderer=renderer)) as opened:
        instrument(opened)
        began = time.thread_time()
        return opened.finish(), time.thread_time() - began


def main() -> int:
    """Parse the options and run the benchmark; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("tree", nargs="?", default="pick_and_track")
    parser.add_argument("--param", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--renderer", choices=("auto", "gl", "ray"), default="ray")
    arguments = parser.parse_args()
    params = dict(param.split("=", 1) for param in arguments.param)

    def again(instrument: Callable[[Run], None]) -> tuple[RunResult, float]:
        return play(arguments.tree, arguments.renderer, instrument, params)

    plain = [again(_observe_nothing) for _ in range(arguments.repeats)]
    run = min((result for result, _ in plain), key=lambda result: result.wall_time_s)
    spent = min(spent for _, spent in plain)
    watches: list[Stopwatch] = []
    _, watched = again(lambda opened: watches.append(Stopwatch(opened)))
    scripts: list[Script] = []
    renderers: list[Any] = []

    def record_calls(opened: Run) -> None:
        renderers.append(getattr(opened.assembly.renderer, "render", None))
        scripts.append(Script(opened))

    again(record_calls)
    (script,) = scripts
    (render,) = renderers
    (watch,) = watches
    replays = [script.replay(render) for _ in range(arguments.repeats)]
    physics = min(physics for physics, _ in replays)
    floor = physics + min(drawing for _, drawing in replays)
    frames = sum(len(segment.drawings) for segment in script.segments)
    steps = sum(len(segment.steps) for segment in script.segments)
    report(run, spent, (physics, steps), (floor, frames))
    breakdown(watched, watch)
    return 0 if run.outcome == "SUCCESS" else 1


def report(run: RunResult, spent: float, bare: tuple[float, int], drawn: tuple[float, int]) -> None:
    """Print the real-time factor and the ratio to the bound, with their parts.

    Args:
        run: Result of the plain run.
        spent: CPU time of its steps, s.
        bare: CPU time of the steps of physics alone, s, and their number.
        drawn: CPU time of steps and frames, s, and the number of frames.
    """
    (physics, steps) = bare
    (floor, frames) = drawn
    print(f"{run.outcome}: {run.sim_time_s:.2f} s simulated in {run.wall_time_s:.2f} s")
    print(f"real-time factor  {run.real_time_factor:6.2f}")
    print(
        f"run               {spent:6.2f} s of CPU: {run.sim_time_s / spent:.2f} simulated s per s"
    )
    print(f"bare physics      {physics:6.2f} s ({1e6 * physics / steps:.1f} us per step)")
    print(f"and {frames:4} frames   {floor:6.2f} s")
    print(f"run / bare        {spent / floor:6.2f}")


def breakdown(whole: float, watch: Stopwatch) -> None:
    """Print the CPU time of each part of a run that took ``whole`` s with stopwatches."""
    rest = whole - sum(watch.spent.values())
    for part, seconds in {**watch.spent, "the rest": rest}.items():
        share = np.divide(100 * seconds, whole)
        print(f"  {part:18} {seconds:6.2f} s  {share:4.1f} %")


if __name__ == "__main__":
    sys.exit(main())
