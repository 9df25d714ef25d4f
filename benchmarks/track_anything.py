"""Tracking of arbitrary motions by all robots, with a theoretical bound for each.

    python -m benchmarks.track_anything [--trials N] [--seed S] [--robot NAME ...]
        [--motion KIND ...] [--reality lab rough] [--camera FPS/MS ...] [--share 0.8] [--free]
        [--lines]

Each trial has a random plane, curve, reality and camera. The curve is timed with the follower's own
limits along the true path, and then scaled in time: ``--share 0.8`` needs 80 % of the top speed,
which is 64 % of the accelerations; above 1 no arm can follow. With two numbers, each trial draws a
value between them. `track` ends by ``until_still``. With ``--free`` the curve is tilted out of the
plane by up to 45°, and is followed in space. Prints median and 95th percentile of the true RMS
error in the plane, minus its mean, during the motion, by follower and by kind of motion, and the
bound: the error of the filter with an ideal arm, true positions and the measured noise. Then prints
the outcomes, the number of SUCCESS with a true error above ``max_error``, the reasons of failures
for motions beyond the follower, and the number of runs that did not end.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from benchmarks.campaign import Campaign, add_options, registry
from benchmarks.following_trial import DISTANCE_M, LOOKS
from benchmarks.measured_robots import MEASURED
from benchmarks.vantage import BASE, POSTURE, Vantage, vantage
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.perception.target_filter import TargetEstimate
from bt_dualarm.planning.problem import trace
from bt_dualarm.robots.robot_description import load_robot, robot_names
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.values import Plane
from bt_dualarm.spec.yaml_reader import Data
from bt_dualarm.trajectory.paths import CartesianPath, line, through
from bt_dualarm.trajectory.trajectory import Trajectory

MOTIONS: Final = (
    "circle",
    "square",
    "spiral",
    "rotating",
    "spline",
    "stop-and-go",
    "hidden 0.2 s",
    "hidden 1 s",
)
COMES_TO_REST: Final = "comes to rest"
"""A short motion that tests whether ``until_still`` ends; only used if `--motion` names it."""

CAMERAS: Final = ("60/20", "30/35", "90/0", "40/49")
"""Frame rates in Hz and latencies in ms."""

_REST_S = 3.0  # before the target moves
_MOVE_S = 10.0  # wait for the motion; it may be missed if the target is hidden meanwhile
_AFTER_S = 15.0  # time after the motion within which `track` has to end
_STILL_S = 1.0
_REGAINED_S = 0.5
_STEP_M = 0.03
_CALM_S = 1.0  # time after the motion in which the tool may come to rest
_SETTLED_S = 1.0
_PERIOD_S = 0.01  # of the samples of a motion
_SIZE_M = 0.05
_HIDDEN_M = 5.0  # behind the camera
_PREDICTIONS_PER_FRAME = 4
_FRAMES_BEFORE = 0.5  # s at rest before the motion, for the bound


@dataclass(frozen=True)
class Case:
    """One trial.

    Attributes:
        robot: Name of the robot in the catalog.
        motion: Kind of motion, one of `MOTIONS`, or `COMES_TO_REST`.
        plane: A named plane of the world.
        reality: Model mismatch of the follower.
        camera: Frame rate in Hz and latency in ms, as ``60/20``.
        share: Speed of the target as a fraction of the fastest that the follower could execute.
        sized: Whether the target's size is known.
        seed: Seed of the curve and of the run.
        free: Whether the curve is tilted out of the plane and followed in space.
    """

    robot: str
    motion: str
    plane: str
    reality: str
    camera: str
    share: float
    sized: bool
    seed: int
    free: bool = False

    def __str__(self) -> str:
        sized = "free" if self.free else "sized" if self.sized else "-"
        return (
            f"{self.robot:<6} {self.plane} {self.motion:<12} {self.reality:<5} "
            f"{self.camera:<6} {self.share:g} {sized:<5} {self.seed}"
        )

    @property
    def fps(self) -> float:
        """Frame rate, Hz."""
        return float(self.camera.partition("/")[0])

    @property
    def latency(self) -> float:
        """Age of an image when it arrives, s."""
        return 1e-3 * float(self.camera.partition("/")[2])


@dataclass(frozen=True)
class Measured:
    """Measurements of one trial.

    Attributes:
        rms: RMS of the true error in the plane, minus its mean, during the motion, m.
        whole: The same from `_SETTLED_S` to the end of `track`, m.
        bound: RMS error of the filter with an ideal arm, m.
        code: Failure code of `track`; ``SUCCESS`` without one, ``ENDLESS`` if it did not end.
        cause: Its metric ``cause``, if any.
        judged: The metric ``error_rms_m``, m.
        allowed: The metric ``max_error_m``, m.
        regained: Time from the target's return to within `allowed` of it, s; NaN if never hidden.
        ended: Time from the end of the motion to that of `track`, s.
        shake: Root mean square distance of the tool from its mean, from `_CALM_S` after the motion
            on, m; NaN if `track` ended before.
    """

    rms: float
    whole: float
    bound: float
    code: str
    cause: str
    judged: float
    allowed: float
    regained: float
    ended: float
    shake: float


@dataclass(frozen=True, eq=False)
class Course:
    """Motion of the target in the plane.

    Attributes:
        positions: Positions every `_PERIOD_S`, of shape (n, 2), m.
        hidden: Times from and until which the target is hidden, s.
        turning: Frequency at which it rotates back and forth, rad/s; 0 for none.
    """

    positions: Matrix
    hidden: tuple[float, float] = (np.inf, np.inf)
    turning: float = 0.0

    def at(self, time: float) -> Vector:
        """Position ``time`` seconds after the motion began, of shape (2,), m."""
        index = min(max(time / _PERIOD_S, 0.0), len(self.positions) - 1.0)
        first = min(int(index), len(self.positions) - 2)
        share = index - first
        position: Vector = (1.0 - share) * self.positions[first] + share * self.positions[first + 1]
        return position

    @property
    def duration(self) -> float:
        """Length of the motion, s."""
        return _PERIOD_S * (len(self.positions) - 1)


@dataclass
class _Carrier(IdleObserver):
    """Moves the target, and records the positions of tool and target."""

    world: World
    place: Vector
    normal: Vector
    curve: Matrix
    course: Course
    rows: list[tuple[float, ...]] = field(default_factory=list)

    def after_step(self, time: float) -> None:
        since = time - _REST_S
        at = self.course.at(since)
        body = self.world.object_body("cube")
        normal = self.normal
        behind = _HIDDEN_M if self.course.hidden[0] <= since < self.course.hidden[1] else 0.0
        model = self.world.model
        looking = self.world.data.site_xpos[self.world.arms["arm1"].tool_site] - self.place
        side = float(np.sign(normal @ looking))
        model.body_pos[body] = self.place + at @ self.curve + behind * side * normal
        if self.course.turning and since > 0.0:
            angle = 0.5 * np.sin(self.course.turning * since)
            model.body_quat[body] = (np.cos(0.5 * angle), *(np.sin(0.5 * angle) * normal))
        tool = self.world.arms["arm1"].tool_pose.position
        self.rows.append((time, *tool.tolist(), *(self.place + at @ self.curve).tolist()))


def add_case_options(
    parser: argparse.ArgumentParser, motions: Sequence[str], default: Sequence[str]
) -> None:
    """Add the options that `cases` reads, except ``reality`` and ``free``."""
    parser.add_argument("--trials", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--robot", nargs="+", default=list(MEASURED), choices=robot_names())
    parser.add_argument("--motion", nargs="+", default=list(default), choices=motions)
    parser.add_argument("--plane", nargs="+", default=list(LOOKS), choices=list(LOOKS))
    parser.add_argument(
        "--camera", nargs="+", type=_camera, default=list(CAMERAS), metavar="FPS/MS"
    )
    parser.add_argument(
        "--share",
        type=float,
        nargs="+",
        default=[0.8],
        help="fraction of the follower's speed; two numbers are a random range",
    )


def _camera(text: str) -> str:
    """Check the frame rate and the latency of a camera, as ``60/20``."""
    fps, _, latency = text.partition("/")
    try:
        possible = float(fps) > 0.0 and float(latency) >= 0.0
    except ValueError:
        possible = False
    if not possible:
        raise argparse.ArgumentTypeError(
            f"{text!r}: frame rate in Hz and latency in ms are expected, as in 60/20"
        )
    return text


def cases(options: argparse.Namespace) -> Iterator[Case]:
    """All trials: each robot by each motion in random order, everything else at random."""
    rng = np.random.default_rng(options.seed)

    def share() -> float:
        """The given share, or a random one of the range."""
        low, *high = options.share
        return round(float(rng.uniform(low, high[0])), 3) if high else float(low)

    pairs: list[tuple[str, str]] = []
    for _ in range(options.trials):
        if not pairs:
            pairs = list(itertools.product(options.robot, options.motion))
        robot, motion = pairs.pop(int(rng.integers(len(pairs))))
        yield Case(
            robot,
            motion,
            str(rng.choice(options.plane)),
            str(rng.choice(options.reality)),
            str(rng.choice(options.camera)),
            share(),
            bool(rng.integers(2)),
            int(rng.integers(1, 10**6)),
            options.free,
        )


def course(case: Case, viewpoint: Vantage, axes: Matrix) -> Course:
    """The target's motion, timed by the limits of the follower.

    Raises:
        Failure: The follower cannot execute the random curve at any speed.
    """
    rng = np.random.default_rng(case.seed)
    robot = load_robot(case.robot)
    xyz, rpy = BASE
    arm = Kinematics(robot, Pose.from_rpy(xyz, np.radians(rpy).tolist()))
    tool = Pose.from_matrix(arm.matrix(viewpoint.q))

    if case.motion == COMES_TO_REST:
        length = rng.uniform(0.4, 1.2)
        angle = rng.uniform(0.0, 2.0 * np.pi)
        done = np.minimum(np.arange(0.0, length + _PERIOD_S, _PERIOD_S) / length, 1.0)[:, None]
        smooth = done**3 * (10.0 - 15.0 * done + 6.0 * done**2)
        return Course(_STEP_M * smooth * np.array((np.cos(angle), np.sin(angle))))

    def pose(at: Vector) -> Pose:
        return Pose(tool.position + at @ axes, tool.quaternion)

    def timed(path: CartesianPath) -> Matrix:
        motion: Trajectory = trace(
            arm, path, viewpoint.q, robot.limits, _PERIOD_S * case.share
        ).motion
        points = [axes @ (arm.matrix(q)[:3, 3] - tool.position) for q in motion.q]
        return np.array(points)

    radius = rng.uniform(0.04, 0.09)
    phase = rng.uniform(0.0, 2.0 * np.pi)
    sense = rng.choice((-1.0, 1.0))
    if case.motion in ("square", "stop-and-go"):
        if case.motion == "square":
            angles = phase + sense * 0.5 * np.pi * np.arange(9)
            corners = radius * np.column_stack((np.cos(angles), np.sin(angles)))
        else:
            corners = rng.uniform(-0.09, 0.09, (6, 2))
        pieces = []
        for begin, end in itertools.pairwise(corners):
            pieces.append(timed(line(pose(begin), pose(end))))
            if case.motion == "stop-and-go":
                pause = int(rng.uniform(0.2, 0.8) / _PERIOD_S)
                pieces.append(np.tile(pieces[-1][-1], (pause, 1)))
        return Course(np.vstack(pieces))
    if case.motion == "spline":
        angles = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False) + rng.uniform(-0.3, 0.3, 8)
        radii = rng.uniform(0.03, 0.09, 8)
    else:
        turns = 3 if case.motion == "spiral" else 2
        angles = phase + sense * np.linspace(0.0, 2.0 * np.pi * turns, 24 * turns + 1)
        grown = np.linspace(0.2, 1.0, len(angles))
        radii = radius * (grown if case.motion == "spiral" else np.ones(len(angles)))
    points = radii[:, None] * np.column_stack((np.cos(angles), np.sin(angles)))
    path = through([pose(at) for at in points], closed=case.motion == "spline")
    positions = timed(path)
    duration = _PERIOD_S * (len(positions) - 1)
    hidden = (np.inf, np.inf)
    if case.motion.startswith("hidden"):
        begin = rng.uniform(0.3, 0.6) * duration
        hidden = (begin, begin + float(case.motion.split()[1]))
    return Course(positions, hidden, rng.uniform(1.0, 2.0) if case.motion == "rotating" else 0.0)


def follow(case: Case, registry: Registry) -> Measured:
    """Run one trial.

    Raises:
        Failure: As `course`.
    """
    viewpoint = vantage(case.robot, LOOKS[case.plane])
    axes = np.array(Plane.model_validate(case.plane).axes)
    normal = np.cross(*axes)
    curve = axes
    if case.free:
        axes = np.vstack((axes, normal))
        curve = axes[:2] @ _tilt(axes, np.random.default_rng(case.seed))
    path = course(case, viewpoint, curve)
    place = viewpoint.ahead(DISTANCE_M)
    end = _REST_S + path.duration
    with tempfile.TemporaryDirectory() as folder:
        start = place + path.at(0.0) @ curve
        tree = _tree(case, viewpoint.write_description(Path(folder)), start, end + _AFTER_S)
        file = load_tree_file(tree, registry.kinds, folder=Path(folder))
        with Run(file, registry, RunOptions(seed=case.seed, renderer="ray")) as run:
            carrier = _Carrier(run.world, place, normal, curve, path)
            run.watch(carrier)
            leaf = run.finish().arms["arm1"].runs[0]
    rows = np.array(carrier.rows)
    during = rows[(rows[:, 0] >= _REST_S) & (rows[:, 0] <= end)]
    away = _errors(during, axes)
    noise = float(leaf.metrics.get("sighting_sd_m", 1e-4))
    code = "SUCCESS" if str(leaf.status) == "SUCCESS" else str(leaf.code or "ENDLESS")
    if code in ("HALTED", "TIMEOUT"):
        code = "ENDLESS"
    allowed = float(leaf.metrics.get("max_error_m", 0.01))
    calm = rows[rows[:, 0] > end + _CALM_S, 1:4] @ axes.T
    return Measured(
        rms=_rms(away),
        whole=_rms(_errors(rows[rows[:, 0] >= _SETTLED_S], axes)),
        bound=bound(case, path, noise),
        code=code,
        cause=str(leaf.metrics.get("cause", "")),
        judged=float(leaf.metrics.get("error_rms_m", np.nan)),
        allowed=allowed,
        regained=_regained(path, rows, axes, allowed),
        ended=float(rows[-1, 0]) - end,
        shake=float(np.sqrt(calm.var(axis=0).sum())) if len(calm) else np.nan,
    )


def _tilt(axes: Matrix, rng: np.random.Generator) -> Matrix:
    """Matrix, applied from the right, of a rotation by up to 45° about a direction in the plane."""
    about = rng.uniform(0.0, 2.0 * np.pi)
    turn = (
        rng.uniform(0.25, 1.0)
        * 0.25
        * np.pi
        * (np.array((np.cos(about), np.sin(about))) @ axes[:2])
    )
    matrix: Matrix = Rotation.from_rotvec(turn).as_matrix().T
    return matrix


def _errors(rows: Matrix, axes: Matrix) -> Vector:
    """Distances of the true error vectors of the tool from their mean, of shape (n,), m.

    Args:
        rows: Time, tool and target, of shape (n, 7), s and m.
        axes: Unit vectors along which the distance counts, of shape (k, 3).
    """
    error = (rows[:, 1:4] - rows[:, 4:7]) @ axes.T
    distances: Vector = np.linalg.norm(error - error.mean(axis=0), axis=1)
    return distances


def _rms(away: Vector) -> float:
    return float(np.sqrt(np.mean(away**2))) if len(away) else np.nan


def _regained(path: Course, rows: Matrix, axes: Matrix, allowed: float) -> float:
    """Time from the end of the occlusion until the error stays within ``allowed`` for 0.1 s, s.

    The error excludes its mean from the start of the motion to the occlusion: the mean over the
    whole motion would contain the occlusion. NaN if the target was not hidden, if it came to rest
    before it could have been regained, or if `track` ended before it reappeared.
    """
    times = rows[:, 0] - _REST_S
    begin, back = path.hidden
    if back + _REGAINED_S >= path.duration or back >= times[-1]:
        return np.nan
    error = (rows[:, 1:4] - rows[:, 4:7]) @ axes.T
    away = np.linalg.norm(error - error[(times > 0.0) & (times < begin)].mean(axis=0), axis=1)
    late = times >= back
    good = away[late] <= allowed
    since = times[late] - back
    for index in range(len(good)):
        if good[index : np.searchsorted(since, since[index] + 0.1)].all():
            return float(since[index])
    return np.inf


def bound(case: Case, path: Course, noise: float) -> float:
    """Error of the filter with an ideal arm, m: true positions and white noise, predicted to now.

    Between two frames the age of the newest sighting grows from the latency by one period.
    While the target is hidden there are no sightings.
    """
    rng = np.random.default_rng(case.seed)
    times = _PERIOD_S * np.arange(len(path.positions))
    spline = CubicSpline(times, path.positions)
    estimate = TargetEstimate()
    errors = []
    for stamp in np.arange(-_FRAMES_BEFORE, path.duration, 1.0 / case.fps):
        hidden = path.hidden[0] <= stamp < path.hidden[1]
        if not hidden:
            sighting = spline(max(stamp, 0.0)) + rng.normal(0.0, noise, 2)
            estimate.update(float(stamp), sighting, max(noise, 1e-6))
        for share in range(_PREDICTIONS_PER_FRAME):
            now = float(stamp) + case.latency + share / _PREDICTIONS_PER_FRAME / case.fps
            if 0.0 <= now <= path.duration:
                errors.append(estimate.predict(now).position - spline(now))
    return float(np.sqrt(np.mean(np.sum(np.square(errors), axis=1))))


def _tree(case: Case, robot: str, start: Vector, limit: float) -> dict[str, Data]:
    """The tree file of a trial."""
    xyz, rpy = BASE
    cube: dict[str, Data] = {
        "shape": "box",
        "size": [_SIZE_M] * 3,
        "mass": 0.1,
        "color": "yellow",
        "fixed": True,
        "pose": {"xyz": start.tolist()},
    }
    camera: dict[str, Data] = {
        "mount": "wrist",
        "resolution": [320, 240],
        "fov": 50,
        "fps": case.fps,
        "latency": case.latency,
    }
    track: dict[str, Data] = {
        "plane": "free" if case.free else case.plane,
        "distance": DISTANCE_M,
        "score": "cube",
        "until_still": _STILL_S,
        "move_timeout": _MOVE_S,
    }
    if case.sized or case.free:
        track["target_size"] = _SIZE_M
    arm: dict[str, Data] = {
        "robot": robot,
        "base": {"xyz": list(xyz), "rpy": list(rpy)},
        "posture": POSTURE,
        "camera": camera,
        "tree": {"track": track},
    }
    world: dict[str, Data] = {"scene": "empty", "time_limit": limit, "reality": case.reality}
    return {"bt_dualarm": 1, "world": world, "objects": {"cube": cube}, "arms": {"arm1": arm}}


def summary(results: list[tuple[Case, Measured]]) -> Iterator[str]:
    """Lines of the tables."""
    yield f"{'':<14} {'trials':>6} {'median':>8} {'p95':>8} {'bound':>8}  mm RMS; outcomes"
    groups: dict[str, list[Measured]] = defaultdict(list)
    for case, found in results:
        for name in (case.robot, case.motion, f"{case.camera} {case.reality}", "all"):
            groups[name].append(found)
    order = [
        *MEASURED,
        *MOTIONS,
        COMES_TO_REST,
        *sorted(name for name in groups if "/" in name),
        "all",
    ]
    for name in filter(groups.__contains__, order):
        measurements = groups[name]
        rms = 1e3 * np.array([one.rms for one in measurements])
        median_bound = 1e3 * np.median([one.bound for one in measurements])
        codes = Counter(f"{one.code} {one.cause}".strip() for one in measurements)
        text = ", ".join(f"{count} {code}" for code, count in codes.most_common())
        yield (
            f"{name:<14} {len(rms):6d} {np.median(rms):8.2f} {np.percentile(rms, 95):8.2f} "
            f"{median_bound:8.2f}  {text}"
        )
    all_runs = [one for _, one in results]
    if not all_runs:
        return
    yield f"SUCCESS with a true RMS above max_error: {sum(map(_is_false, all_runs))}"
    worse = sum(one.code == "SUCCESS" and one.rms > one.allowed for one in all_runs)
    yield f"the same during the motion alone, without the rests: {worse}"
    refused = [(case, one) for case, one in results if case.share > 1.0 and one.code != "SUCCESS"]
    if refused:
        right = sum(_is_cause_right(case, one) for case, one in refused)
        yield f"beyond the follower, with the right reason: {right} of {len(refused)}"
    shakes = [1e3 * one.shake for one in all_runs if not np.isnan(one.shake)]
    yield (
        f"ended at most {max(one.ended for one in all_runs):.2f} s after the motion; "
        f"{len(shakes)} after more than {_CALM_S:g} s, during which the tool shook by at most "
        f"{max(shakes, default=0.0):.2f} mm RMS"
    )
    yield f"did not end: {sum(one.code == 'ENDLESS' for one in all_runs)}"
    times = [one.regained for one in all_runs if not np.isnan(one.regained)]
    if times:
        soon = sum(time <= _REGAINED_S for time in times)
        yield f"regained within {_REGAINED_S:g} s of the target's return: {soon} of {len(times)}"


def main(arguments: list[str]) -> int:
    """Print the tables; returns 1 after a false SUCCESS or a run that did not end."""
    parser = argparse.ArgumentParser(description="following any motion")
    add_case_options(parser, (*MOTIONS, COMES_TO_REST), default=MOTIONS)
    parser.add_argument("--reality", nargs="+", default=["lab", "rough"])
    parser.add_argument("--free", action="store_true", help="curves in space, followed in space")
    parser.add_argument("--lines", action="store_true", help="print each trial")
    add_options(parser)
    options = parser.parse_args(arguments)
    results: list[tuple[Case, Measured]] = []
    with Campaign(options) as campaign:
        for fields, result in campaign.run(run_trial, [asdict(case) for case in cases(options)]):
            case = Case(**fields)
            if "found" not in result:
                print(f"{case}: rejected: {result['why']}", flush=True)
                continue
            found = Measured(**result["found"])
            results.append((case, found))
            if options.lines:
                print(
                    f"{case}: {1e3 * found.rms:6.2f} mm, bound {1e3 * found.bound:5.2f}, "
                    f"judged {1e3 * found.judged:6.2f} of {1e3 * found.allowed:.1f} "
                    f"{found.code} {found.cause}".rstrip(),
                    flush=True,
                )
        for text in summary(results):
            print(text)
        return int(any(one.code == "ENDLESS" or _is_false(one) for _, one in results))


def run_trial(**fields: Any) -> dict[str, Any]:  # Any: fields of `Case`
    """Measurements of a trial, or why its curve was rejected."""
    try:
        found = follow(Case(**fields), registry())
    except Failure as failure:
        return {"outcome": "SKIPPED", "why": str(failure)}
    is_good = found.code == "SUCCESS" and not _is_false(found)
    outcome = "SUCCESS" if is_good else "FAILURE"
    return {"outcome": outcome, "code": found.code, "found": asdict(found)}


def _is_cause_right(case: Case, found: Measured) -> bool:
    """Whether the cause of a failure is right for a target that is too fast for the follower.

    Right are the speed; the latency, if an ideal arm with that camera would not follow either; and
    the occlusion, if there was one.
    """
    if found.code != "NOT_FOLLOWING":
        return False
    if found.cause == "latency":
        return found.bound > found.allowed
    return found.cause == "speed" or (found.cause == "occlusion" and "hidden" in case.motion)


def _is_false(found: Measured) -> bool:
    """Whether it is a SUCCESS with a larger true error than allowed."""
    return found.code == "SUCCESS" and found.whole > found.allowed


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
