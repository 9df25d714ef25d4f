"""Two arms that obstruct each other: python -m benchmarks.two_arms [REACHES [SEED]].

A UR5 and a Panda stand face to face and reach for random poses in the space between them, both at
once, without knowledge of each other's goals; the arm that finishes first moves behind its base.
Prints how many of the reaches succeeded, why the others failed, in how many physics steps the arms
touched, and their smallest distance.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from typing import Any

import numpy as np

from benchmarks.campaign import Campaign, add_options, registry
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.outcome import RunResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.contact_monitor import arms_of_geoms
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry

REACHES = 200
PER_RUN = 20
SEED = 7

HEAD = """
bt_dualarm: 1
name: two_arms
world: {scene: empty, time_limit: 600}
arms:
"""
ARM = """
  NAME:
    robot: ROBOT
    base: {xyz: [X, 0, 0.3], rpy: [0, 0, YAW]}
    tree:
      sequence:
"""
LEAF = """
        - force_success:
            child:
              reach_to_pose:
                {to: {xyz: XYZ, quat: QUAT}, speed: 0.5, give_way: true, patience: 20}
"""
LAST = """
        - force_success:
            child:
              reach_to_pose:
                {to: {xyz: [X, 0.25, 0.9], quat: [0, 1, 0, 0]}, give_way: true, patience: 20}
"""
BEHIND = {"arm1": -0.3, "arm2": 1.3}
"""Where an arm that has finished moves along x, out of reach of the other one."""


class Contacts(IdleObserver):
    """Counts the physics steps in which the arms touch."""

    def __init__(self, world: World) -> None:
        self.steps = 0
        self.first_s = float("inf")
        self._world = world
        self._owners = arms_of_geoms(world)

    def after_step(self, time: float) -> None:
        """Count the step if the arms touch."""
        data = self._world.data
        if data.ncon:
            owners = self._owners[data.contact.geom]
            touching = (owners >= 0).all(axis=1) & (owners[:, 0] != owners[:, 1])
            if (touching & (data.contact.dist < 0.0)).any():
                self.steps += 1
                self.first_s = min(self.first_s, time)


def target(arm: Kinematics, rng: np.random.Generator) -> Pose:
    """A random reachable pose of the tool in the box between the arms, pointing down."""
    while True:
        place = rng.uniform((0.3, -0.35, 0.5), (0.7, 0.35, 0.9))
        turn = rng.uniform((155, -25, -180), (205, 25, 180))
        pose = Pose.from_rpy(place.round(3).tolist(), np.radians(turn.round(1)).tolist())
        try:
            arm.solve(pose, arm.robot.postures["home"])
        except Failure:
            continue
        return pose


def tree(rng: np.random.Generator, reaches: int) -> str:
    """A tree file in which both arms reach for poses in the box between them."""
    text = HEAD
    for name, robot, x, yaw in (("arm1", "ur5", 0.0, 0), ("arm2", "panda", 1.0, 180)):
        text += ARM.replace("NAME", name).replace("ROBOT", robot)
        text = text.replace("X,", f"{x},").replace("YAW", str(yaw))
        base = Pose.from_rpy((x, 0.0, 0.3), (0.0, 0.0, np.radians(yaw)))
        arm = Kinematics(load_robot(robot), base)
        for _ in range(reaches // 2):
            pose = target(arm, rng)
            text += LEAF.replace("XYZ", str(pose.position.tolist())).replace(
                "QUAT", str(pose.quaternion.tolist())
            )
        text += LAST.replace("[X", f"[{BEHIND[name]}")
    return text


def run(text: str, seed: int, skills: Registry) -> tuple[RunResult, Contacts]:
    """Run a tree file; returns the result and the contacts of the arms."""
    file = load_tree_file(text, skills.kinds)
    with Run(file, skills, RunOptions(seed=seed)) as opened_run:
        contacts = Contacts(opened_run.world)
        opened_run.watch(contacts)
        return opened_run.finish(), contacts


def reach(text: str, number: int) -> dict[str, Any]:
    """Outcome of the reaches of a file."""
    result, contacts = run(text, number, registry())
    messages = []
    if contacts.steps:
        messages.append(f"run {number}: the arms touch at {contacts.first_s:.2f} s")
    codes = []
    nearest = float("inf")
    for arm in result.arms.values():
        nearest = min(nearest, float(arm.guard.get("nearest_arm_m", "inf")))
        leaves = [leaf for leaf in arm.runs if leaf.skill == "reach_to_pose"][: PER_RUN // 2]
        codes += [leaf.code or leaf.status for leaf in leaves]
        for leaf in leaves:
            if leaf.status != "SUCCESS":
                when = f"{leaf.started_s:.1f}-{leaf.ended_s:.1f} s"
                messages.append(f"run {number} {arm.name} {when}: {leaf.code}: {leaf.reason}")
    return {
        "outcome": "FAILURE" if contacts.steps else "SUCCESS",
        "message": messages,
        "codes": codes,
        "nearest_m": nearest,
        "contacts": contacts.steps,
        "sim_time_s": result.sim_time_s,
    }


def main() -> None:
    """Print the outcomes of all reaches, and the reason of each failure."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("reaches", type=int, nargs="?", default=REACHES)
    parser.add_argument("seed", type=int, nargs="?", default=SEED)
    add_options(parser)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    cases = [
        {"text": tree(rng, PER_RUN), "number": number}
        for number in range(-(-options.reaches // PER_RUN))
    ]
    codes: Counter[str] = Counter()
    touched = 0
    nearest = float("inf")
    sim = 0.0
    began = time.perf_counter()
    with Campaign(options) as campaign:
        for _, found in campaign.run(reach, cases):
            touched += found["contacts"]
            sim += found["sim_time_s"]
            nearest = min(nearest, found["nearest_m"])
            codes.update(found["codes"])
            for line in found["message"]:
                print(line, flush=True)
        wall = time.perf_counter() - began
        count = sum(codes.values())
        share = codes["SUCCESS"] / max(count, 1)
        print(f"{count} reaches in {sim:.0f} s simulated, {wall:.0f} s wall-clock time")
        print(f"succeeded            {codes['SUCCESS']:4d}  {100 * share:.1f} %")
        for code, number in codes.most_common():
            if code != "SUCCESS":
                print(f"{code:20} {number:4d}")
        print(f"steps with a contact {touched:4d}")
        print(f"nearest              {1e3 * nearest:6.1f} mm")


if __name__ == "__main__":
    main()
