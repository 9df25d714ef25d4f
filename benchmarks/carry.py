"""Two arms carry a beam along random paths: arrival and internal force.

    python -m benchmarks.carry [--paths 200] [--speeds 0.2 0.5 1.0] [--pairs ur5+ur5 ur5+panda]
                               [--reality lab] [--seed 0] [--plot carry.svg]

A run grasps a beam of 4 kg, carries it along several random paths with shifts of up to 0.25 m and
rotations of up to 15°, and sets it down. The beam is 1.2 m long (0.8 m for UR3s); no arm can hold
it alone. Runs alternate between the pairs of robots, each with suitable grippers.

A path counts as arrived if the true pose of the beam is within 2 mm and 0.5° of the goal, and as
refused if no arm has moved. Internal force and moment are the part of the hands' true contact
wrenches beyond their shares of the beam's weight and inertia, see
`bt_dualarm.control.internal_wrench`: the larger one of both hands, sampled every 8 ms while both
arms hold the beam. Goal at speed 0.5 in `lab`: all paths that are not refused arrive, with at most
20 N and 5 N m; exits with code 1 if it is missed.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

import bt_dualarm as bt
from benchmarks.campaign import Campaign, add_options
from bt_dualarm.control.internal_wrench import crossed, internal_wrenches
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.sim.world import World

PATHS_PER_RUN = 8
"""Number of paths in one run."""

SAMPLE_STEPS = 4
"""Physics steps between two samples of the internal wrench."""

WITHIN_M = 0.002
WITHIN_RAD = np.radians(0.5)
MOST_N = 20.0
MOST_NM = 5.0
ARMS = ("arm1", "arm2")
GRIPPERS = {"panda": "panda_hand"}
REFUSED = ("OUT_OF_REACH", "PATH_BROKEN", "IN_COLLISION", "NO_PLAN", "SINGULAR", "UNREACHABLE")

LAYOUTS = {"ur3": (0.42, -0.30, 0.8), "ur10": (0.60, -0.60, 1.2)}
"""Half the distance between the bases in m, y of the beam in m and its length in m, by robot."""

LAYOUT = (0.55, -0.45, 1.2)


def task(
    robots: tuple[str, str], speed: float, reality: str, seed: int, paths: int
) -> dict[str, Any]:
    """The tree file of one run."""
    rng = np.random.default_rng(seed)
    half_distance, y, length = LAYOUTS.get(robots[0], LAYOUT)
    start = {"xyz": [0, y, 0.5251], "rpy": [0, 0, 0]}
    goals = [
        [
            {
                "xyz": [float(x), float(y + dy), float(z)],
                "rpy": [0.0, float(pitch), float(yaw)],
            }
            for x, dy, z, pitch, yaw in rng.uniform(
                (-0.12, -0.08, 0.62, -12, -15), (0.12, 0.08, 0.82, 12, 15), (rng.integers(1, 3), 5)
            )
        ]
        for _ in range(paths)
    ]
    arms = {}
    for i, (arm, robot) in enumerate(zip(ARMS, robots, strict=True)):
        leaves: list[dict[str, Any]] = []
        for goal in [*goals, [start]]:
            last = goal == [start]
            ports: dict[str, Any] = {"object": "beam", "with": [ARMS[1 - i]], "speed": speed}
            ports |= {"set_down": last, "tolerance": 0.05, "angle_tolerance": 20}
            leaf = {"carry_together": ports | ({"path": goal} if i == 0 else {})}
            leaves.append(leaf if last else {"force_success": {"child": leaf}})
        arms[arm] = {
            "robot": robot,
            "gripper": GRIPPERS.get(robot, "robotiq_2f85"),
            "base": {
                "xyz": [(-half_distance, half_distance)[i], 0, 0.4],
                "rpy": [0, 0, _yaw(robot)],
            },
            "tree": {"sequence": leaves},
        }
    beam = {"shape": "box", "size": [length, 0.05, 0.05], "mass": 4.0, "pose": start}
    stand = {"shape": "box", "size": [0.3, 0.3, 0.5], "mass": 50, "fixed": True}
    stand["pose"] = {"xyz": [0, y, 0.25]}
    return {
        "bt_dualarm": 1,
        "name": "carry",
        "world": {"scene": "empty", "reality": reality, "seed": seed, "time_limit": 300},
        "objects": {"beam": beam, "stand": stand},
        "arms": arms,
    }


def _yaw(robot: str) -> float:
    """Rotation of a base in degrees with which the robot faces the beam."""
    return 0.0 if robot.startswith("ur") else -90.0


@dataclass
class TrueInternalWrench(IdleObserver):
    """Internal wrench from the true contact forces on an object held by several arms.

    Attributes:
        world: World of the run.
        obj: Name of the object.
        shares: Share of the load of each arm, by name.
        samples: Time in s, force in N and moment in N m, largest of all arms.
    """

    world: World
    obj: str
    shares: dict[str, float]
    samples: list[tuple[float, float, float]] = field(default_factory=list)
    _steps: int = 0

    def __post_init__(self) -> None:
        """Subscribe to the forces of the world."""
        self.world.on_forces.append(self._sample)

    def _sample(self) -> None:
        self._steps += 1
        world = self.world
        if self._steps % SAMPLE_STEPS or set(world.attachments.holders(self.obj)) != set(
            self.shares
        ):
            return
        points, wrenches = self._contacts()
        found = internal_wrenches(list(self.shares.values()), points, wrenches)
        force, moment = (np.linalg.norm(part, axis=1).max() for part in np.split(found, 2, axis=1))
        self.samples.append((world.time, float(force), float(moment)))

    def _contacts(self) -> tuple[Matrix, Matrix]:
        """Positions of the tools, and the wrenches of the hands on the object about them."""
        world = self.world
        data = world.data
        geom = world.object_geom(self.obj)
        bodies = [world.arms[arm] for arm in self.shares]
        points = np.array([data.site_xpos[body.tool_site] for body in bodies])
        wrenches = np.zeros((len(bodies), 6))
        force = np.empty(6)
        for i, pair in enumerate(data.contact.geom.tolist()):
            if geom not in pair:
                continue
            other = pair[0] if pair[1] == geom else pair[1]
            for k, body in enumerate(bodies):
                if other in body.geom_ids:
                    mujoco.mj_contactForce(world.model, data, i, force)
                    sign = 1.0 if pair[1] == geom else -1.0
                    pushed, turned = (
                        sign * force.reshape(2, 3) @ data.contact.frame[i].reshape(3, 3)
                    )
                    lever: Vector = data.contact.pos[i] - points[k]
                    wrenches[k, :3] += pushed
                    wrenches[k, 3:] += turned + crossed(lever[None], pushed[None])[0]
        return points, wrenches


@dataclass
class Results:
    """Results at one speed.

    Attributes:
        outcomes: Number of paths by outcome: ``arrived``, ``refused`` or a failure code.
        errors: Distance in m and angle in rad from the goal of each arrival.
        forces: Internal force of each sample, N.
        moments: Internal moment of each sample, N m.
        most: Largest internal force in N and moment in N m of each run.
    """

    outcomes: Counter[str] = field(default_factory=Counter)
    errors: list[tuple[float, float]] = field(default_factory=list)
    forces: list[float] = field(default_factory=list)
    moments: list[float] = field(default_factory=list)
    most: list[tuple[float, float]] = field(default_factory=list)


def carried(pair: str, speed: float, reality: str, seed: int, count: int) -> dict[str, Any]:
    """Simulate a run: outcomes of its paths, errors of its arrivals and the true forces."""
    first, _, second = pair.partition("+")
    with bt.open(task((first, second), speed, reality, seed, count)) as opened:
        observer = TrueInternalWrench(opened.world, "beam", dict.fromkeys(ARMS, 0.5))
        opened.watch(observer)
        result = opened.finish()
    outcomes = []
    errors = []
    failures = []
    for leaf in result.arms["arm1"].runs:
        if leaf.skill != "carry_together":
            continue
        away = leaf.metrics.get("placed_error_m")
        turned = leaf.metrics.get("placed_turned_rad")
        if leaf.status == "SUCCESS" and away is not None and turned is not None:
            near = away <= WITHIN_M and turned <= WITHIN_RAD
            outcomes.append("arrived" if near else "off")
            errors.append((away, turned))
        else:
            code = leaf.code or leaf.status
            outcomes.append("refused" if code in REFUSED else code)
            failures.append(f"    {leaf.path}: {code}: {leaf.reason}")
    bad = [outcome for outcome in outcomes if outcome not in ("arrived", "refused")]
    return {
        "outcome": "FAILURE" if bad else "SUCCESS",
        "code": ", ".join(bad),
        "outcomes": outcomes,
        "errors": errors,
        "message": failures,
        "samples": observer.samples,
    }


def add(run: dict[str, Any], found: Results) -> tuple[float, float]:
    """Add the results of a run; returns its largest internal force in N and moment in N m."""
    found.outcomes.update(run["outcomes"])
    found.errors += [(away, turned) for away, turned in run["errors"]]
    if not run["samples"]:
        return 0.0, 0.0
    _, forces, moments = np.array(run["samples"]).T
    found.forces += forces.tolist()
    found.moments += moments.tolist()
    found.most.append((float(forces.max()), float(moments.max())))
    return found.most[-1]


def plot(curves: dict[str, list[tuple[float, float, float]]], path: str) -> None:
    """Draw the internal force of some runs over time."""
    import matplotlib as mpl

    mpl.use("svg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(8.0, 3.2), constrained_layout=True)
    for label, samples in curves.items():
        time, force, _ = np.array(samples).T
        axes.plot(time - time[0], force, label=label, linewidth=0.8)
    axes.axhline(MOST_N, color="black", linestyle=":", linewidth=0.8)
    axes.set(
        xlabel="time since both arms hold the beam, s", ylabel="internal force, N", ylim=(0, None)
    )
    axes.legend(frameon=False)
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def main() -> int:
    """Print the results at each speed; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--paths", type=int, default=200)
    parser.add_argument("--speeds", type=float, nargs="+", default=[0.2, 0.5, 1.0])
    parser.add_argument(
        "--pairs", nargs="+", default=["ur5+ur5", "ur5+panda", "panda+xarm7", "ur10+ur10"]
    )
    parser.add_argument("--reality", default="lab")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--plot")
    add_options(parser)
    arguments = parser.parse_args()
    with Campaign(arguments) as campaign:
        return run_speeds(arguments, campaign)


def run_speeds(arguments: argparse.Namespace, campaign: Campaign) -> int:
    """Run the paths at each speed and print the results; returns the exit code."""
    missed = False
    curves: dict[str, list[tuple[float, float, float]]] = {}
    for speed in arguments.speeds:
        found = Results()
        cases = [
            {
                "pair": arguments.pairs[number % len(arguments.pairs)],
                "speed": speed,
                "reality": arguments.reality,
                "seed": arguments.seed + number,
                "count": min(arguments.paths - PATHS_PER_RUN * number, PATHS_PER_RUN),
            }
            for number in range(-(-arguments.paths // PATHS_PER_RUN))
        ]
        for case, run in campaign.run(carried, cases):
            for line in run["message"]:
                print(line, flush=True)
            most = add(run, found)
            print(f"  {case['pair']}: {most[0]:.1f} N, {most[1]:.1f} N m at most", flush=True)
            if run["samples"]:
                curves.setdefault(f"speed {speed:g}", run["samples"])
        missed |= report(speed, found) and speed == 0.5 and arguments.reality == "lab"
    if arguments.plot:
        plot(curves, arguments.plot)
    return int(missed)


def report(speed: float, found: Results) -> bool:
    """Print the results; returns whether a goal was missed."""
    outcomes = ", ".join(f"{count} {name}" for name, count in found.outcomes.most_common())
    print(f"speed {speed:g}: {outcomes}")
    if not found.errors or not found.forces:
        return True
    away, turned = np.array(found.errors).T
    forces = np.array(found.forces)
    moments = np.array(found.moments)
    print(
        f"  arrival: median {1e3 * np.median(away):.2f} mm and "
        f"{np.degrees(np.median(turned)):.2f}°, "
        f"largest {1e3 * away.max():.2f} mm and {np.degrees(turned.max()):.2f}°"
    )
    for name, values, unit in (("force", forces, "N"), ("moment", moments, "N m")):
        print(
            f"  internal {name}: median {np.median(values):.1f} {unit}, "
            f"99 % {np.quantile(values, 0.99):.1f} {unit}, largest {values.max():.1f} {unit}"
        )
    bad = set(found.outcomes) - {"arrived", "refused"}
    return bool(bad) or forces.max() > MOST_N or moments.max() > MOST_NM


if __name__ == "__main__":
    sys.exit(main())
