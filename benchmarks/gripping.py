"""Creep of an object in a gripper, and the CPU cost of grippers.

    python -m benchmarks.gripping [--robots ur5 panda] [--sets lab rough] [--seeds 3] [--seconds 60]

Each gripper takes each suitable shape of 0.5 kg from a post, with ``--share`` of its force, and
lifts it. Prints the true creep of the object in the gripper, in mm (goals: 0.1 at rest and 0.5 when
shaken, in 60 s each):

- ``rest``: the robot's controller holds it;
- ``carried``: the robot carries it back and forth along a line of 0.16 m at full speed;
- ``shaken``: springs hold the joints, and gravity swings by 8 m/s² at 2 Hz along the axes of the
  tool, one after the other.

Then prints the real-time factors of a UR5 that carries a cube back and forth, alternately in
fingers and by a weld without a gripper; goal for the ratio: 0.8.
"""

from __future__ import annotations

import argparse
import statistics
import time
from typing import Any, Final

import numpy as np

from benchmarks.campaign import Campaign, add_options
from bt_dualarm.core.pose import Pose
from bt_dualarm.robots.gripper import gripper_names, load_gripper
from bt_dualarm.runtime.api import open as open_run
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ArmSpec, TreeFile
from bt_dualarm.spec.node_types import NodeSpec
from bt_dualarm.spec.values import PoseSpec

SHAPES: Final[dict[str, tuple[str, list[float], float]]] = {
    "cube": ("box", [0.05, 0.05, 0.05], 0.025),
    "can": ("cylinder", [0.025, 0.06], 0.03),
    "ball": ("sphere", [0.025], 0.025),
}
"""Shape, size and half the height, m."""

LOAD_CASES: Final = ("rest", "carried", "shaken")
_BASE: Final = [0.0, 0.0, 0.4]
# amplitude of gravity, m/s², and frequency, Hz
_SHAKE_AMPLITUDE = 8.0
_SHAKE_HZ = 2.0
# stiffness of the joint springs, and the armature in kg m² that is added to the joints
_STIFF = 0.25
_HEAVY = 5.0


def tool_at_home(robot: str, gripper: str | None) -> Pose:
    """Pose of the tool at the start, pointing down."""
    spec = ArmSpec(
        robot=robot,
        gripper=gripper,
        base=PoseSpec(xyz=(_BASE[0], _BASE[1], _BASE[2])),
        tree=NodeSpec(kind="succeed", name="succeed", ports={}),
    )
    return World(TreeFile(name="probe", objects={}, arms={"arm1": spec})).arms["arm1"].tool_pose


def tree(
    robot: str, gripper: str | None, obj: str, share: float, then: list[Any]
) -> dict[str, Any]:
    """A tree file in which an arm takes an object from a post, lifts it, and runs other leaves."""
    shape, size, half = SHAPES[obj]
    spec = None if gripper is None else load_gripper(gripper)
    x, y, z = tool_at_home(robot, gripper).position.tolist()
    middle = z - (half + 0.01 if spec is None or spec.cup else 0.001)
    height = middle - half - 0.001
    post = {"shape": "box", "size": [0.02, 0.02, height], "mass": 1, "fixed": True}
    objects_in_world = {
        "post": post | {"pose": {"xyz": [x, y, height / 2]}},
        "thing": {"shape": shape, "size": size, "mass": 0.5, "pose": {"xyz": [x, y, middle]}},
    }
    if spec is None:
        take: list[Any] = [{"approach_and_attach": {"object": "thing", "standoff": 0.02}}]
    else:
        close = {
            "force": max(share * spec.force.most, spec.force.least),
            "object": "thing",
        }
        near = {"move_until_contact": {"distance": 0.02, "force": 10, "speed": 0.02}}
        take = [
            *([near] if spec.cup else []),
            {"close_gripper": close | {"settle": 0.5}},
        ]
    lift = {"move_linear": {"offset": {"xyz": [0, 0, 0.05]}, "speed": 0.3}}
    arm: dict[str, Any] = {"robot": robot, "base": {"xyz": _BASE}}
    arm |= {} if gripper is None else {"gripper": gripper}
    return {
        "bt_dualarm": 1,
        "name": "gripping",
        "world": {"scene": "empty", "time_limit": 900},
        "objects": objects_in_world,
        "arms": {"arm1": arm | {"tree": {"sequence": [*take, lift, {"wait": 1}, *then]}}},
    }


def back_and_forth(times: int) -> list[Any]:
    """Leaves that move the tool along a line and back."""
    moves = [{"move_linear": {"offset": {"xyz": [0, y, 0]}, "speed": 1.0}} for y in (0.16, -0.16)]
    return [{"repeat": {"times": times, "child": {"sequence": moves}}}]


def in_tool(world: World) -> Pose:
    """True pose of the object in the tool frame."""
    return world.arms["arm1"].tool_pose.inverse @ world.object_pose("thing")


def lift_object(run: Run) -> str:
    """Step until the object is lifted and at rest; returns the reason of a failure, or empty."""
    begun = run.world.object_pose("thing").position[2]
    rested = 0
    while not run.done and rested < 5:
        run.step(0.2)
        high = run.world.object_pose("thing").position[2] - begun > 0.045
        still = float(np.abs(run.world.object_velocity("thing")).max()) < 2e-3
        rested = rested + 1 if high and still else 0
    if rested:
        return ""
    bad = [leaf for leaf in run.result.arms["arm1"].leaves.values() if leaf.code]
    return bad[0].reason if bad else "nothing was lifted"


def shake(world: World, seconds: float) -> None:
    """Swing gravity along the axes of the tool, with the joints held by springs."""
    model = world.model
    data = world.data
    step = world.timestep
    body = world.arms["arm1"]
    dofs = body.dof_ids
    at = body.q.copy()
    gravity = model.opt.gravity.copy()
    axes = body.tool_pose.rotation_matrix.T
    model.dof_armature[dofs] += _HEAVY
    data.ctrl[body.actuator_ids] = 0.0
    count = round(seconds / step)
    for number in range(count + round(1.0 / step)):
        swing = _SHAKE_AMPLITUDE * np.sin(2 * np.pi * _SHAKE_HZ * number * step) * (number < count)
        model.opt.gravity[:] = gravity + swing * axes[min(3 * number // count, 2)]
        springs = _HEAVY * (_STIFF * (at - body.q) / step - body.v) / step
        world.hardware["arm1"].command(np.zeros(len(dofs)))
        data.qfrc_applied[dofs] = data.qfrc_bias[dofs] + springs
        world.step()


def drift(
    robot: str,
    gripper: str,
    obj: str,
    way: str,
    seed: int,
    reality: str,
    seconds: float,
    share: float,
) -> str:
    """Creep of an object in mm and degrees, as text."""
    then = back_and_forth(max(1, round(seconds / 1.6))) if way == "carried" else []
    then = [{"wait": seconds}] if way == "rest" else then
    file = tree(robot, gripper, obj, share, then)
    with open_run(file, seed=seed, reality=reality) as run:
        refused = lift_object(run)
        if refused:
            return f"refused: {refused}"
        before = in_tool(run.world)
        began = run.time
        if way == "shaken":
            shake(run.world, seconds)
        while not run.done and way != "shaken":
            run.step(0.5)
        took = seconds if way == "shaken" else run.time - began
        return f"{difference(before, in_tool(run.world))}, {took:.0f} s"


def difference(before: Pose, after: Pose) -> str:
    """Distance in mm and angle in degrees between two poses, as text."""
    turned = np.degrees(after.angle(before))
    return f"{1e3 * after.distance(before):.4f} mm, {turned:.3f}°"


def cost(gripper: str | None, times: int) -> float:
    """CPU seconds per simulated second of carrying a cube back and forth."""
    with open_run(tree("ur5", gripper, "cube", 0.4, back_and_forth(times)), seed=1) as run:
        refused = lift_object(run)
        if refused:
            raise RuntimeError(refused)
        began = run.time
        cpu = time.process_time()
        while not run.done:
            run.step(0.5)
        return (time.process_time() - cpu) / (run.time - began)


def arguments() -> argparse.Namespace:
    """Options of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", nargs="+", default=["ur5"])
    parser.add_argument("--grippers", nargs="+", default=list(gripper_names()))
    parser.add_argument("--shapes", nargs="+", default=list(SHAPES))
    parser.add_argument("--ways", nargs="+", default=list(LOAD_CASES))
    parser.add_argument("--sets", nargs="+", default=["lab"])
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--share", type=float, default=0.5)
    parser.add_argument("--pairs", type=int, default=3)
    add_options(parser)
    return parser.parse_args()


def main() -> None:
    """Print both figures."""
    args = arguments()
    each = (
        (robot, gripper, obj, way, reality, seed)
        for robot in args.robots
        for gripper in args.grippers
        for obj in args.shapes
        if obj != "ball" or load_gripper(gripper).fingers
        for way in args.ways
        for reality in args.sets
        for seed in range(1, args.seeds + 1)
    )
    names = ("robot", "gripper", "obj", "way", "reality", "seed")
    settings = {"seconds": args.seconds, "share": args.share}
    cases = [{**dict(zip(names, one, strict=True)), **settings} for one in each]
    with Campaign(args) as campaign:
        for case, text in campaign.run(drift, cases):
            print(*(case[name] for name in names), text, flush=True)
    # In this process, because CPU time is measured.
    ratios = []
    for _ in range(args.pairs):
        bare = cost(None, 20)
        held = cost("robotiq_2f85", 20)
        ratios.append(bare / held)
        print(f"real-time factor {1 / bare:.1f} by a weld, {1 / held:.1f} in fingers", flush=True)
    if ratios:
        print(f"ratio {statistics.median(ratios):.2f} (goal: 0.8)")


if __name__ == "__main__":
    main()
