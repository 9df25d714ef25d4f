"""Path error and settling time of curves with an arm that deviates from its model.

    python -m benchmarks.path_reality [--robots ur5 panda] [--sets ideal lab rough] [--seeds 10]

A circle of 0.1 m and a 1:2 Lissajous curve at speed 1.0, without a load, with 1 kg known to the
controller, and with 1 kg unknown to it. A seed is one robot with its own deviations from the model.
The error is the distance between the simulated tool and its planned position at the same time, over
all set-points; the settling time is that from the last set-point until the encoders meet the
criterion for the end of a motion. Goals: 0.10 mm RMS and at most 0.3 mm in `lab`, 0.3 and 1.0 mm in
`rough`, 0.3 s, no failure.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

import numpy as np

from benchmarks.campaign import Campaign, add_options, registry
from benchmarks.motion import BASE, PAYLOAD_KG, POSTURES, cases
from bt_dualarm.arm.motions import SETTLE_S, SETTLED_RAD
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.control.controller import JointController
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.planning.problem import trace
from bt_dualarm.robots.robot_description import load_robot, robot_names
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.sim.world import World
from bt_dualarm.spec.node_types import NodeType
from bt_dualarm.trajectory.path_timing import point_to_point
from bt_dualarm.trajectory.trajectory import Trajectory

PERIOD = 0.004
LOADS = ("none", "known", "unknown")
_STEADY_S = 0.3  # time for which it stands at the curve's start


@dataclass(frozen=True)
class Figures:
    """Errors of one robot on one curve in mm, and its settling time in s.

    Attributes:
        rms: RMS error over all set-points, mm.
        worst: Largest error, mm.
        rest: Time from the last set-point until the arm rests there, s.
        fault: Reason of a failure, or empty.
        thirds: RMS errors of the first, second and last third of the curve, mm.
    """

    rms: float
    worst: float
    rest: float
    fault: str
    thirds: tuple[float, ...] = ()


def measured(world: World, motion: Trajectory, planned: Matrix) -> Figures:
    """Follow a motion and compare the true tool position with the plan at each set-point.

    Args:
        world: World with the arm ``arm1`` at the motion's start.
        motion: Motion of its joints.
        planned: Tool positions at the motion's set-points, of shape (n, 3), m.
    """
    controller = JointController(world, "arm1", PERIOD, Reservations())
    body = world.arms["arm1"]
    steps = round(PERIOD / world.timestep)

    def advance() -> None:
        controller.update(world.time)
        for _ in range(steps):
            world.step()

    limits = world.robots["arm1"].limits
    entry = point_to_point(controller.setpoint.q, motion.q[0], limits, PERIOD)
    controller.follow(entry)
    for _ in range(len(entry) + round(_STEADY_S / PERIOD)):
        advance()
    controller.follow(motion)
    true = []
    for _ in range(len(motion)):
        true.append(body.tool_pose.position)
        advance()
    began = world.time
    while world.time - began < SETTLE_S:
        error = np.abs(world.hardware["arm1"].q - motion.q[-1]).max()
        if controller.at_rest and error < SETTLED_RAD:
            break
        advance()
    distance = 1e3 * np.linalg.norm(np.array(true) - planned, axis=1)
    rest = world.time - began
    fault = "" if controller.fault is None else str(controller.fault)
    if not fault and rest >= SETTLE_S:
        fault = "does not come to rest"
    thirds = tuple(_rms(part) for part in np.array_split(distance, 3))
    return Figures(_rms(distance), float(distance.max()), rest, fault, thirds)


def _rms(values: Vector) -> float:
    return float(np.sqrt((values**2).mean()))


def world_of(
    name: str,
    tool: Pose,
    reality: str | Mapping[str, object],
    load: str,
    seed: int,
    kinds: Mapping[str, NodeType],
) -> World:
    """A world with the robot at the curve's start and the load at its tool.

    Args:
        name: Name of the robot.
        tool: Pose of its tool there.
        reality: Name of a set, or fields as in a file.
        load: One of `LOADS`.
        seed: Seed of the robot's deviations from the model.
        kinds: Node types.
    """
    fields = {"set": reality} if isinstance(reality, str) else dict(reality)
    tree = {
        "bt_dualarm": 1,
        "name": "path",
        "world": {
            "scene": "empty",
            "seed": seed,
            "reality": {**fields, "payload": {"known": load != "unknown"}},
        },
        "arms": {
            "arm1": {
                "robot": name,
                "base": {"xyz": BASE.position.tolist()},
                "posture": POSTURES.get(name, "home"),
                "tree": "succeed",
            }
        },
    }
    if load != "none":
        at = tool @ Pose.from_rpy((0.0, 0.0, 0.045))  # clear of a hand
        pose = {"xyz": at.position.tolist(), "quat": at.quaternion.tolist()}
        cube = {"shape": "box", "size": [0.05, 0.05, 0.05], "mass": PAYLOAD_KG, "pose": pose}
        tree["objects"] = {"payload": cube}
    world = World(load_tree_file(tree, kinds), seed)
    if load != "none":
        world.attach("arm1", "payload")
    return world


def curves(name: str) -> Iterator[tuple[Pose, Trajectory, Matrix]]:
    """Start pose of the tool, joint motion and planned tool positions of each curve."""
    robot = load_robot(name)
    kinematics = Kinematics(robot, BASE)
    start = robot.postures[POSTURES.get(name, "home")]
    tool = kinematics.forward(start)
    for case in cases(tool, 1.0)[:2]:
        motion = trace(kinematics, case.path, start, robot.limits, PERIOD).motion
        yield tool, motion, np.array([kinematics.matrix(q)[:3, 3] for q in motion.q])


def follow(name: str, reality: str, load: str, curve: int, seed: int) -> dict[str, Any]:
    """Figures of one robot on one curve."""
    tool, motion, planned = _curves(name)[curve]
    world = world_of(name, tool, reality, load, seed, registry().kinds)
    found = measured(world, motion, planned)
    return {"outcome": "FAILURE" if found.fault else "SUCCESS", "figures": asdict(found)}


@cache
def _curves(name: str) -> list[tuple[Pose, Trajectory, Matrix]]:
    return list(curves(name))


def row(name: str, reality: str, load: str, seeds: int, campaign: Campaign) -> str:
    """Table row of a robot in a reality with a load, over all curves and seeds."""
    batch = range(1) if reality == "ideal" else range(seeds)
    settings = {"name": name, "reality": reality, "load": load}
    cases = [{**settings, "curve": curve, "seed": seed} for curve in range(2) for seed in batch]
    found = [Figures(**one["figures"]) for _, one in campaign.run(follow, cases)]
    rms = [one.rms for one in found]
    faults = [one.fault for one in found if one.fault]
    return (
        f"{name:6} {reality:6} load {load:8} rms {np.mean(rms):.4f} (worst {max(rms):.4f}), "
        f"max {max(one.worst for one in found):.4f} mm, "
        f"rest {max(one.rest for one in found):.3f} s, {len(faults)} of {len(found)} failed"
        + "".join(f"\n    {fault}" for fault in faults[:2])
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--robots", nargs="+", default=["ur5", "panda"], choices=robot_names())
    parser.add_argument("--sets", nargs="+", default=["ideal", "lab", "rough"])
    parser.add_argument("--seeds", type=int, default=10)
    add_options(parser)
    arguments = parser.parse_args()
    with Campaign(arguments) as campaign:
        for name in arguments.robots:
            for reality in arguments.sets:
                for load in LOADS:
                    print(row(name, reality, load, arguments.seeds, campaign), flush=True)


if __name__ == "__main__":
    main()
