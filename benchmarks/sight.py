"""Perception with the wrist camera: errors of `locate`, success rates of picks and counts.

    python -m benchmarks.sight [--locate 60] [--marker 30] [--pick 100] [--seed 0] [--sets lab]

``--locate``: boxes, cylinders and spheres of 20 to 70 mm in several colors at random poses on the
table, viewed from 0.35 m above by each robot in turn; the error is relative to the simulator, which
no skill reads. ``--marker``: markers of 30 to 45 mm on a gray block, likewise. ``--pick``: the
shipped tree ``pick_by_sight`` with a Panda or a UR5 and a box or cylinder anywhere within reach.
An object counts as picked if it was lifted and truly is at its goal in the end; as placed if the
tree succeeds, too, that is, if the object came to rest when released. A SUCCESS after which it is
not at its goal is false, even if the hand dragged it away afterwards.

Goals in `lab`: 95 % located within 2 mm and 1°, with a marker within 1 mm and 0.5°, 98 % of the
picks, no false success; exits with code 1 if one is missed.

``--sizes N`` views N objects of the declared size, and N for each of six factors by which they are
larger or smaller; all of the latter have to be refused.

``--counts N`` counts each of `SETTINGS` N times with different boxes and cylinders: none to three
objects, apart, touching, stacked, or of another size. A wrong number is a failure in any reality.
A count that is too low does not count as wrong if `count` reports that part of the objects is
outside the image.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

import bt_dualarm as bt
from benchmarks.campaign import Campaign, add_options
from bt_dualarm.core.pose import Vector
from bt_dualarm.spec.values import BITS

ROBOTS = ("panda", "ur3", "ur5", "ur10", "xarm7")
COLORS = ("red", "orange", "yellow", "green", "blue")
TOP = 0.40  # height of the table, m
MIDDLE = (0.35, -0.50)
TREE = Path(__file__).parents[1] / "trees" / "pick_by_sight.yaml"
PUT = (0.20, -0.40)


@dataclass(frozen=True)
class Located:
    """Result of locating one object; mm and degrees."""

    robot: str
    shape: str
    code: str
    error_mm: float
    turned_deg: float
    sigma_mm: float
    views: int


def obj(rng: np.random.Generator, shapes: tuple[str, ...]) -> dict[str, Any]:
    """A random object as in a tree file, without its pose."""
    shape = shapes[int(rng.integers(len(shapes)))]
    edges = rng.uniform(0.02, 0.07, 3).round(4)
    sizes = {
        "box": edges.tolist(),
        "cylinder": [float(edges[0] / 2), float(edges[1])],
        "sphere": [float(edges[0] / 2)],
    }
    color = COLORS[int(rng.integers(len(COLORS)))]
    return {"shape": shape, "size": sizes[shape], "mass": 0.1, "color": color}


def marked(rng: np.random.Generator) -> dict[str, Any]:
    """A gray block with a marker, as in a tree file, without its pose."""
    names = list(BITS)
    marker = {
        "dictionary": names[int(rng.integers(len(names)))],
        "id": int(rng.integers(30)),
        "size": float(rng.uniform(0.03, 0.045)),
    }
    block = {"shape": "box", "size": [0.07, 0.07, 0.04], "mass": 0.1, "color": "gray"}
    return block | {"marker": marker}


def height(one: dict[str, Any]) -> float:
    """Height of the center of an object on the table, m."""
    return TOP + float(one["size"][0] if one["shape"] == "sphere" else one["size"][-1] / 2)


def locate(number: int, reality: str, seed: int, *, by_marker: bool = False) -> Located:
    """Locate one object with one robot."""
    rng = np.random.default_rng((seed, number))
    robot = ROBOTS[number % len(ROBOTS)]
    one = obj(rng, ("box", "box", "cylinder", "sphere"))
    reach = 0.08 if robot == "ur3" else 0.15
    x, y = (middle + float(rng.uniform(-reach, reach)) for middle in MIDDLE)
    if robot == "ur3":
        y += 0.12
    pose = {"xyz": [x, y, height(one)], "rpy": [0, 0, float(rng.uniform(-90, 90))]}
    if by_marker:
        one = marked(rng)
        pose["xyz"][2] = height(one)
    one |= {"pose": pose, "fixed": True}
    look = {"at": {"xyz": [x + 0.03, y - 0.02, TOP]}, "distance": 0.35}
    tree = {
        "sequence": [
            {"look_at": look},
            {"locate": {"object": "thing", "by": "marker" if by_marker else "color"}},
        ]
    }
    base = {"xyz": [0.35, 0.0, TOP], "rpy": [0, 0, -90]}
    file = {
        "bt_dualarm": 1,
        "name": "sight",
        "world": {"scene": "table", "time_limit": 90, "reality": reality},
        "objects": {"thing": one},
        "arms": {"arm1": {"robot": robot, "base": base, "camera": {}, "tree": tree}},
    }
    result = bt.run(file, seed=seed + number, renderer="ray")
    leaves = result.arms["arm1"].leaves
    leaf = leaves.get("sequence/locate") or leaves["sequence/look_at"]
    metrics = leaf.metrics
    return Located(
        robot,
        one["shape"],
        leaf.code or leaf.status,
        1e3 * float(metrics.get("located_error_m", np.nan)),
        float(np.degrees(float(metrics.get("located_turned_rad", np.nan)))),
        1e3 * float(metrics.get("sigma_m", np.nan)),
        int(metrics.get("views", 0)),
    )


SIZES = (1.0, 0.7, 0.86, 0.92, 1.08, 1.14, 1.3)
"""Factors by which objects are larger than declared."""


def locate_resized(number: int, ratio: float, reality: str, seed: int) -> str:
    """Code with which `locate` ends for an object larger than declared by a factor."""
    rng = np.random.default_rng((seed, number, 7))
    robot = ROBOTS[number % len(ROBOTS)]
    declared = obj(rng, ("box", "box", "cylinder", "sphere"))
    real = declared | {"size": [ratio * edge for edge in declared["size"]], "fixed": True}
    reach = 0.08 if robot == "ur3" else 0.15
    x, y = (middle + float(rng.uniform(-reach, reach)) for middle in MIDDLE)
    if robot == "ur3":
        y += 0.12
    real["pose"] = {"xyz": [x, y, height(real)], "rpy": [0, 0, float(rng.uniform(-90, 90))]}
    declared |= {"pose": {"xyz": [5, 5, 5]}, "spawned": False}
    look = {"at": {"xyz": [x + 0.03, y - 0.02, TOP]}, "distance": 0.35}
    tree = [{"look_at": look}, {"locate": {"object": "declared", "score": "real"}}]
    base = {"xyz": [0.35, 0.0, TOP], "rpy": [0, 0, -90]}
    arm = {"robot": robot, "base": base, "camera": {}, "tree": {"sequence": tree}}
    file = {
        "bt_dualarm": 1,
        "name": "sizes",
        "world": {"scene": "table", "time_limit": 90, "reality": reality},
        "objects": {"declared": declared, "real": real},
        "arms": {"arm1": arm},
    }
    leaves = bt.run(file, seed=seed + number, renderer="ray").arms["arm1"].leaves
    leaf = leaves.get("sequence/locate") or leaves["sequence/look_at"]
    return f"{leaf.code or leaf.status}"


def report_sizes(count: int, reality: str, seed: int, campaign: Campaign) -> bool:
    """Print the codes for each size; returns whether no wrong size was accepted."""
    good = True
    for ratio in SIZES:
        cases = [{"ratio": ratio, **case} for case in _cases(count, reality, seed)]
        codes = Counter(code for _, code in campaign.run(locate_resized, cases))
        good &= ratio == 1.0 or not codes["SUCCESS"]
        print(f"{reality}: {ratio:g} times as large: {dict(codes)}", flush=True)
    return good


COUNTING = ("ur5", "panda", "xarm7")
SETTINGS: dict[str, tuple[tuple[float, float, float, float], ...]] = {
    "none": (),
    "one": ((0.0, 0.0, 0.0, 1.0),),
    "two": ((-1.3, 0.0, 0.0, 1.0), (1.3, 0.3, 0.0, 1.0)),
    "three": ((-1.3, 0.0, 0.0, 1.0), (1.3, 0.3, 0.0, 1.0), (0.0, -1.6, 0.0, 1.0)),
    "two touch": ((0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 1.0)),
    "two touch, one apart": ((0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 1.0), (-1.8, 0.0, 0.0, 1.0)),
    "two stacked": ((0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)),
    "two stacked aside": ((1.5, 0.8, 0.0, 1.0), (1.5, 0.8, 1.0, 1.0)),
    "one smaller": ((0.0, 0.0, 0.0, 0.8),),
    "one larger": ((0.0, 0.0, 0.0, 1.25),),
    "one larger, one not": ((-1.4, 0.0, 0.0, 1.0), (1.4, 0.3, 0.0, 1.25)),
}
"""Objects to count: position along and across, in object widths; height above the table, in object
heights; and size as a multiple of the declared one."""


def count_objects(setting: str, number: int, reality: str, seed: int) -> str:
    """Verdict on a result of `count`: right, wrong and why, or the code of its failure."""
    rng = np.random.default_rng((seed, number, 11))
    robot = COUNTING[number % len(COUNTING)]
    kind = obj(rng, ("box", "cylinder"))
    x, y = (middle + float(rng.uniform(-0.08, 0.08)) for middle in MIDDLE)
    angle = float(rng.uniform(-90, 90))
    along = np.array((np.cos(np.radians(angle)), np.sin(np.radians(angle))))
    across = np.array((-along[1], along[0]))
    sizes = kind["size"]
    width = sizes[0] if kind["shape"] == "box" else 2.0 * sizes[0]
    far = max(sizes[1], width) if kind["shape"] == "box" else width
    objects = {"kind": kind | {"pose": {"xyz": [5, 5, 5]}, "spawned": False}}
    for index, (a, b, up, ratio) in enumerate(SETTINGS[setting]):
        step = width if abs(a) == 1.0 else far
        place = np.array((x, y)) + a * step * along + b * far * across
        size = [ratio * edge for edge in sizes]
        pose = {"xyz": [*place.tolist(), TOP + up * sizes[-1] + size[-1] / 2], "rpy": [0, 0, angle]}
        objects[f"thing{index}"] = kind | {"size": size, "pose": pose, "fixed": True}
    look = {"look_at": {"at": {"xyz": [x + 0.02, y - 0.01, TOP]}, "distance": 0.4}}
    base = {"xyz": [0.35, 0.0, TOP], "rpy": [0, 0, -90]}
    tree = {"sequence": [look, {"count": {"object": "kind"}}]}
    file = {
        "bt_dualarm": 1,
        "name": "counts",
        "world": {"scene": "table", "time_limit": 60, "reality": reality},
        "objects": objects,
        "arms": {"arm1": {"robot": robot, "base": base, "camera": {}, "tree": tree}},
    }
    leaves = bt.run(file, seed=seed + number, renderer="ray").arms["arm1"].leaves
    leaf = leaves.get("sequence/count")
    if leaf is None:
        return f"look_at {leaves['sequence/look_at'].code}"
    if leaf.status != "SUCCESS":
        return f"{leaf.code}"
    truth = sum(ratio == 1.0 for *_, ratio in SETTINGS[setting])
    if leaf.metrics["found"] == truth:
        return "right"
    if float(leaf.metrics["found"]) < truth and float(leaf.metrics["beyond_share"]) > 0.0:
        return "outside the image"
    return f"wrong: {kind} by {robot}: {leaf.metrics['found']} of {truth}"


def report_counts(count: int, reality: str, seed: int, campaign: Campaign) -> bool:
    """Print how often each setting was counted correctly; returns whether no number was wrong."""
    good = True
    for setting in SETTINGS:
        cases = [{"setting": setting, **case} for case in _cases(count, reality, seed)]
        verdicts = Counter[str]()
        for case, verdict in campaign.run(count_objects, cases):
            kind, _, why = verdict.partition(": ")
            verdicts[kind] += 1
            if why:
                print(f"   {setting}, {case['number']}: {why}")
        good &= not verdicts["wrong"]
        print(f"{reality}: {setting}: {dict(verdicts)} of {count}", flush=True)
    return good


def _cases(count: int, reality: str, seed: int) -> list[dict[str, Any]]:
    return [{"number": number, "reality": reality, "seed": seed} for number in range(count)]


def run_pick(number: int, reality: str, seed: int) -> dict[str, str]:
    """Outcome of a pick, and why."""
    verdict, why = pick(number, reality, seed, TREE.read_text(encoding="utf-8"))
    outcome = "SUCCESS" if verdict in ("placed", "picked") else "FAILURE"
    return {"outcome": outcome, "code": verdict, "why": why}


def pick(number: int, reality: str, seed: int, text: str) -> tuple[str, str]:
    """Verdict on one pick: placed, picked, lied or failed; and why."""
    rng = np.random.default_rng((seed, number, 1))
    one = obj(rng, ("box", "box", "cylinder"))
    x = MIDDLE[0] + float(rng.uniform(-0.22, 0.22))
    y = -0.48 + float(rng.uniform(-0.18, 0.18))
    turn = float(rng.uniform(-90, 90))
    old = text[text.index("  cube:\n") : text.index("arms:\n")]
    size = one["size"]
    color = one["color"]
    new = (
        f"  cube: {{shape: {one['shape']}, size: {size}, mass: 0.1, color: {color}, "
        f"pose: {{xyz: [{x:.5f}, {y:.5f}, {height(one):.5f}], rpy: [0, 0, {turn:.3f}]}}}}\n\n"
    )
    put = f"at: {{xyz: [{PUT[0]:.2f}, {PUT[1]:.2f}, "
    if f"{put}0.425]" not in text:
        raise ValueError(f"{TREE.name} places its cube elsewhere than {put}0.425]")
    file = text.replace(old, new).replace(f"{put}0.425]", f"{put}{height(one):.5f}]")
    if number % 2:
        file = file.replace("robot: panda", "robot: ur5").replace("panda_hand", "robotiq_2f85")
    with bt.open(file, seed=seed + number, renderer="ray", reality=reality) as run:
        result = run.finish()
        place = run.world.object_pose("cube").position
    failed = [leaf for leaf in result.arms["arm1"].runs if leaf.status == "FAILURE"]
    why = "; ".join(f"{leaf.skill} {leaf.code}: {leaf.reason}" for leaf in failed[:1])
    is_at_goal = float(np.hypot(*(place[:2] - PUT))) < 0.005
    if result.outcome == "SUCCESS":
        return ("placed" if is_at_goal else "false success"), why
    lifted = result.arms["arm1"].leaves.get("sequence/lift")
    picked = is_at_goal and lifted is not None and lifted.status == "SUCCESS"
    return (
        "picked" if picked else "failed"
    ), f"({x:.2f}, {y:.2f}) {one['shape']} {size} {color}: {why}"


def report_located(found: list[Located], label: str, most_mm: float, most_deg: float) -> bool:
    """Print the figures of one reality; returns whether they meet the goal."""
    good = [one for one in found if one.code == "SUCCESS"]
    for one in found:
        if one.code != "SUCCESS" or one.error_mm > most_mm or one.turned_deg > most_deg:
            print("  ", one)
    errors = np.array([(one.error_mm, one.turned_deg) for one in good])
    within = int(((errors[:, 0] <= most_mm) & (errors[:, 1] <= most_deg)).sum())
    print(
        f"{label}: located {len(good)} of {len(found)}; "
        f"{within} within {most_mm:g} mm and {most_deg:g} deg; place "
        f"rms {_rms(errors[:, 0]):.2f}, p95 {np.quantile(errors[:, 0], 0.95):.2f}, "
        f"max {errors[:, 0].max():.2f} mm; turn rms {_rms(errors[:, 1]):.2f}, "
        f"max {errors[:, 1].max():.2f} deg; views {np.mean([one.views for one in good]):.1f}; "
        f"error over sigma {np.mean([one.error_mm / one.sigma_mm for one in good]):.2f}",
        flush=True,
    )
    return within >= 0.95 * len(found)


def _rms(values: Vector) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> int:
    """Parse the options and run the benchmark; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--locate", type=int, default=60, help="objects to locate in each reality")
    parser.add_argument("--marker", type=int, default=30, help="likewise, by markers")
    parser.add_argument("--pick", type=int, default=100, help="picks in each reality")
    parser.add_argument("--sizes", type=int, default=0, help="objects of each size")
    parser.add_argument("--counts", type=int, default=0, help="times each setting is counted")
    parser.add_argument("--seed", type=int, default=0, help="seed of the poses and objects")
    parser.add_argument("--sets", nargs="+", default=["lab", "rough"], help="realities")
    add_options(parser)
    arguments = parser.parse_args()
    with Campaign(arguments) as campaign:
        return run_sets(arguments, campaign)


def run_locate(**case: Any) -> dict[str, Any]:  # Any: arguments of `locate`
    """Result of locating an object as JSON values."""
    found = locate(**case)
    outcome = "SUCCESS" if found.code == "SUCCESS" else "FAILURE"
    return {"outcome": outcome, "code": found.code, "found": asdict(found)}


def run_sets(arguments: argparse.Namespace, campaign: Campaign) -> int:
    """Locate and pick in each reality and print the figures; returns the exit code."""
    good = True
    seed = arguments.seed
    for reality in arguments.sets:
        has_goals = reality == "lab"
        if arguments.locate:
            cases = _cases(arguments.locate, reality, seed)
            found = [Located(**one["found"]) for _, one in campaign.run(run_locate, cases)]
            good &= report_located(found, reality, 2.0, 1.0) or not has_goals
        if arguments.marker:
            cases = [
                {**case, "by_marker": True} for case in _cases(arguments.marker, reality, seed)
            ]
            found = [Located(**one["found"]) for _, one in campaign.run(run_locate, cases)]
            good &= report_located(found, f"{reality}, markers", 1.0, 0.5) or not has_goals
        if arguments.sizes:
            good &= report_sizes(arguments.sizes, reality, seed, campaign)
        if arguments.counts:
            good &= report_counts(arguments.counts, reality, seed, campaign)
        verdicts = Counter[str]()
        for case, one in campaign.run(run_pick, _cases(arguments.pick, reality, seed)):
            verdicts[one["code"]] += 1
            if one["code"] != "placed":
                print(f"   {case['number']} {one['code']} {one['why']}", flush=True)
        if arguments.pick:
            print(f"{reality}: {dict(verdicts)} of {arguments.pick} picks", flush=True)
            taken = verdicts["picked"] + verdicts["placed"]
            enough = taken >= 0.98 * arguments.pick and not verdicts["false success"]
            good &= enough or not has_goals
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
