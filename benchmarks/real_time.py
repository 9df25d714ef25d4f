"""How fast a run is, against the least that it can cost: bare physics and the same frames.

    python benchmarks/real_time.py [TREE] [--param grasp=attach] [--repeats 3] [--renderer ray]

The tree is run as ``bt-run`` does without a record; then, in the same process, MuJoCo alone goes
through the same steps with the same torques, and the renderer alone draws the same parts of the
same frames. Prints the real-time factor by the clock on the wall, and in seconds of CPU what the
run takes, the ratio of the two, and what each part of a run costs. Times are the best of the
repeats: other programs only ever add to them.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import mujoco
import numpy as np

from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.core.pose import Vector
from bt_dualarm.runtime.options import RunOptions, find_tree
from bt_dualarm.runtime.outcome import RunResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry


@dataclass
class Segment:
    """The steps between two changes of the world's parts.

    Attributes:
        model: Compiled model with the parts of that time.
        state: State at the first of the steps, of shape (n,).
        torques: Control vectors, one a step.
        frames: Arguments of each frame that was drawn, with the number of the step.
    """

    model: Any
    state: Vector
    torques: list[Vector] = field(default_factory=list)
    frames: list[tuple[int, tuple[Any, ...], dict[str, Any]]] = field(default_factory=list)


class Script:
    """Writes down all that physics and renderer were asked to do."""

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
            self.segments.append(Segment(world.model, world.state()))
        return self.segments[-1]

    def _step(self, original: Callable[[], None]) -> None:
        self._current().torques.append(self._world.data.ctrl.copy())
        original()

    def _render(
        self, original: Callable[..., Any], model: Any, data: Any, *rest: Any, **options: Any
    ) -> Any:
        segment = self._current()
        segment.frames.append((len(segment.torques), rest, options))
        return original(model, data, *rest, **options)

    def replay(self, render: Callable[..., Any] | None) -> float:
        """CPU time in s of the same steps, with the same frames if there is a renderer."""
        took = 0.0
        for segment in self.segments:
            data = mujoco.MjData(segment.model)
            kind = mujoco.mjtState.mjSTATE_INTEGRATION
            mujoco.mj_setState(segment.model, data, segment.state, kind)
            frames = list(reversed(segment.frames)) if render else []
            began = time.thread_time()
            for number, torques in enumerate(segment.torques):
                while frames and frames[-1][0] == number:
                    _, rest, options = frames.pop()
                    render and render(segment.model, data, *rest, **options)
                data.ctrl[:] = torques
                mujoco.mj_step(segment.model, data)
            took += time.thread_time() - began
        return took


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
    """Put a function before a method of one object; it is given the method first."""
    original = getattr(owner, name)
    setattr(owner, name, lambda *arguments, **options: by(original, *arguments, **options))


def _leave_alone(opened: Run) -> None:
    """Run it as it is."""
    del opened


def play(
    tree: str,
    renderer: Any,
    look: Callable[[Run], None],
    params: Mapping[str, str] = MappingProxyType({}),
) -> tuple[RunResult, float]:
    """Run a tree to its end; its result, and the seconds of CPU that its steps took."""
    registry = Registry.load()
    file = load_tree_file(find_tree(tree), registry.kinds, params)
    with Run(file, registry, RunOptions(renderer=renderer)) as opened:
        look(opened)
        began = time.thread_time()
        return opened.finish(), time.thread_time() - began


def main() -> int:
    """Read the arguments, run, report."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("tree", nargs="?", default="pick_and_track")
    parser.add_argument("--param", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--renderer", choices=("auto", "gl", "ray"), default="ray")
    arguments = parser.parse_args()
    params = dict(param.split("=", 1) for param in arguments.param)

    def again(look: Callable[[Run], None]) -> tuple[RunResult, float]:
        return play(arguments.tree, arguments.renderer, look, params)

    plain = [again(_leave_alone) for _ in range(arguments.repeats)]
    run = min((result for result, _ in plain), key=lambda result: result.wall_time_s)
    spent = min(spent for _, spent in plain)
    watches: list[Stopwatch] = []
    _, watched = again(lambda opened: watches.append(Stopwatch(opened)))
    scripts: list[Script] = []
    renderers: list[Any] = []

    def write_down(opened: Run) -> None:
        renderers.append(getattr(opened.assembly.renderer, "render", None))
        scripts.append(Script(opened))

    again(write_down)
    (script,) = scripts
    (render,) = renderers
    (watch,) = watches
    physics = min(script.replay(None) for _ in range(arguments.repeats))
    floor = min(script.replay(render) for _ in range(arguments.repeats))
    frames = sum(len(segment.frames) for segment in script.segments)
    steps = sum(len(segment.torques) for segment in script.segments)
    report(run, spent, (physics, steps), (floor, frames))
    breakdown(watched, watch)
    return 0 if run.outcome == "SUCCESS" else 1


def report(run: RunResult, spent: float, bare: tuple[float, int], drawn: tuple[float, int]) -> None:
    """Print the two figures that matter, and what they are made of.

    Args:
        run: Result of the run as it is.
        spent: Seconds of CPU that it took.
        bare: Seconds and number of the steps of physics alone.
        drawn: Seconds of both, and number of frames.
    """
    (physics, steps) = bare
    (floor, frames) = drawn
    print(f"{run.outcome}: {run.sim_time_s:.2f} s simulated in {run.wall_time_s:.2f} s")
    print(f"real-time factor  {run.real_time_factor:6.2f}")
    print(f"run               {spent:6.2f} s of CPU: {run.sim_time_s / spent:.2f} simulated s a s")
    print(f"bare physics      {physics:6.2f} s ({1e6 * physics / steps:.1f} us a step)")
    print(f"and {frames:4} frames   {floor:6.2f} s")
    print(f"run / bare        {spent / floor:6.2f}")


def breakdown(whole: float, watch: Stopwatch) -> None:
    """Print what each part of a run of so many seconds costs, with stopwatches in it."""
    rest = whole - sum(watch.spent.values())
    for part, seconds in {**watch.spent, "the rest": rest}.items():
        share = np.divide(100 * seconds, whole)
        print(f"  {part:18} {seconds:6.2f} s  {share:4.1f} %")


if __name__ == "__main__":
    sys.exit(main())
