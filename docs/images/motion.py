"""Draw the figure of docs/motion.md: one curve from its waypoints to its executed error.

    .venv/bin/python docs/images/motion.py

A UR5 draws a 1:2 Lissajous curve at full speed, with and without 1 kg. What is drawn is what the
program plans, sends and measures; the picture's description keeps its figures, and a test compares
them with those of a new run.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.control.controller import JointController
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.core.share import share_dir
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.planning.problem import trace
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.runtime.assembly import CONTROL_PERIOD
from bt_dualarm.runtime.plots import COLORS
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import ObjectSpec, TreeFile
from bt_dualarm.spec.values import PoseSpec
from bt_dualarm.trajectory.paths import Axes, CartesianPath, lissajous
from bt_dualarm.trajectory.trajectory import Trajectory, use_of_limits

TARGET: Final = Path(__file__).with_suffix(".svg")
YZ: Final[Axes] = (np.array((0.0, 1.0, 0.0)), np.array((0.0, 0.0, 1.0)))
PAYLOADS_KG: Final = (0.0, 1.0)
EVERY: Final = 6
"""Number of set-points for each that is drawn: more than a screen can show anyway."""


@dataclass(frozen=True, eq=False)
class Run:
    """One curve, planned, sent and executed.

    Attributes:
        path: Path of the tool.
        motion: Motion of the joints, as planned.
        shortest_s: Least duration that the limits allow, in s.
        sent: Set-points that reached the controller.
        errors: Distances of the tool from its plan in m, by the mass in kg at the tool.
        limits: Limits of the arm's joints.
    """

    path: CartesianPath
    motion: Trajectory
    shortest_s: float
    sent: Trajectory
    errors: dict[float, Vector]
    limits: JointLimits

    @property
    def facts(self) -> dict[str, float]:
        """The figures that the page speaks of."""
        use = use_of_limits(self.sent, self.limits)
        return {
            "duration_s": self.motion.duration,
            "shortest_s": self.shortest_s,
            "velocity_share": use.velocity,
            "acceleration_share": use.acceleration,
            "jerk_share": use.jerk,
            **{
                f"{name}_mm_{mass:.0f}_kg": 1e3 * value
                for mass, error in self.errors.items()
                for name, value in (
                    ("rms", float(np.sqrt(np.mean(error**2)))),
                    ("max", error.max()),
                )
            },
        }


def run() -> Run:
    """Plan the curve of ``trees/lissajous.yaml`` and follow it at full speed, with each payload."""
    file = load_tree_file(share_dir("trees") / "lissajous.yaml", Registry.load().kinds)
    errors = {}
    for mass in reversed(PAYLOADS_KG):  # what is drawn besides the error is that of the first
        world = world_with(file, mass)
        controller = JointController(world, "arm1", float(CONTROL_PERIOD), Reservations())
        robot = world.robots["arm1"]
        start = controller.setpoint.q
        kinematics = Kinematics(robot, world.arms["arm1"].base)
        path = lissajous(kinematics.forward(start), YZ, (0.1, 0.1), (1, 2), waypoints=20)
        motion, shortest = trace(kinematics, path, start, robot.limits, float(CONTROL_PERIOD))
        planned = np.array([kinematics.matrix(q)[:3, 3] for q in motion.q])
        sent, executed = follow(world, controller, motion)
        errors[mass] = np.linalg.norm(executed - planned, axis=1)
    return Run(path, motion, shortest, sent, dict(reversed(errors.items())), robot.limits)


def world_with(file: TreeFile, mass: float) -> World:
    """The file's world, its arm with a cube of so many kg at its tool."""
    if not mass:
        return World(file)
    tool = World(file).arms["arm1"].tool_pose
    place = tool.apply(np.array((0.0, 0.0, 0.045))).tolist()
    pose = PoseSpec(xyz=tuple(place))
    cube = ObjectSpec(shape="box", size=(0.05, 0.05, 0.05), mass=mass, pose=pose)
    world = World(file.model_copy(update={"objects": {"payload": cube}}))
    world.attach("arm1", "payload")
    return world


def follow(
    world: World, controller: JointController, motion: Trajectory
) -> tuple[Trajectory, Matrix]:
    """The set-points that were sent, and where the tool was at each of them, of shape (n, 3)."""
    running = controller.follow(motion, along_path=True)
    sent = []
    while not running.done:
        controller.update(world.time)
        sent.append(controller.setpoint)
        for _ in range(round(motion.dt / world.timestep)):
            world.step()
    q, v, a = (np.array([getattr(point, name) for point in sent]) for name in "qva")
    tool = np.array([place for place, _ in running.take_measured()])
    return Trajectory(motion.dt, q, v, a), tool


def draw(run: Run) -> Figure:
    """The path at the left; at the right what was sent, as shares of the limits, and the errors."""
    figure = Figure(figsize=(10.0, 6.4), layout="constrained")
    grid = figure.add_gridspec(4, 2, width_ratios=(1.0, 1.5))
    facts = run.facts
    _draw_path(figure.add_subplot(grid[:, 0]), run)
    sent = run.sent
    limits = run.limits
    jerk = np.diff(sent.a, axis=0, append=sent.a[-1:]) / sent.dt
    time = np.arange(len(sent)) * sent.dt
    for row, (name, values, limit) in enumerate(
        (
            ("velocity", sent.v, limits.velocity),
            ("acceleration", sent.a, limits.acceleration),
            ("jerk", jerk, limits.jerk),
        )
    ):
        axes = figure.add_subplot(grid[row, 1])
        for joint, color in enumerate(COLORS):
            share = values[::EVERY, joint] / limit[joint]
            axes.plot(time[::EVERY], share, color=color, linewidth=0.9)
        for bound in (-1.0, 1.0):
            axes.axhline(bound, color="black", linewidth=0.8, linestyle="--")
        axes.set(ylabel=name, ylim=(-1.15, 1.15), xlim=(0, time[-1]), xticklabels=[])
        axes.set_title(
            f"share of the {name} limit, joint by joint: at most {facts[name + '_share']:.3f}",
            fontsize=8,
            loc="left",
        )
    axes = figure.add_subplot(grid[3, 1])
    for (mass, error), color in zip(run.errors.items(), COLORS, strict=False):
        label = f"{mass:.0f} kg: rms {facts[f'rms_mm_{mass:.0f}_kg']:.4f} mm"
        axes.plot(time[::EVERY], 1e3 * error[::EVERY], color=color, linewidth=0.9, label=label)
    axes.set(ylabel="mm", xlabel="s", xlim=(0, time[-1]))
    axes.set_ylim(0.0, 1.5e3 * max(error.max() for error in run.errors.values()))
    axes.legend(fontsize=7, frameon=False, loc="upper right")
    axes.set_title("distance of the tool from its planned position", fontsize=8, loc="left")
    return figure


def _draw_path(axes: Any, run: Run) -> None:
    points = run.path.positions @ np.array(YZ).T
    waypoints = run.path.waypoints @ np.array(YZ).T
    facts = run.facts
    axes.plot(*points.T, color="black", linewidth=1.0)
    axes.plot(*waypoints.T, "o", color=COLORS[1], markersize=4)
    axes.set(xlabel="y in m", ylabel="z in m", aspect="equal")
    axes.set_title(
        f"20 waypoints, {facts['duration_s']:.3f} s; TOPP-RA's bound {facts['shortest_s']:.3f} s",
        fontsize=8,
        loc="left",
    )


def main() -> None:
    """Write the picture; the same bytes for the same figures."""
    one = run()
    style: Any = {"svg.fonttype": "none", "svg.hashsalt": "bt_dualarm", "font.size": 8}
    with mpl.rc_context(style):
        facts = json.dumps(one.facts)
        draw(one).savefig(TARGET, metadata={"Date": None, "Description": facts})


if __name__ == "__main__":
    main()
