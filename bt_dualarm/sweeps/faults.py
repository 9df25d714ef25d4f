"""Which faults of which leaves a tree handles: every leaf is made to fail, raise and hang in turn.

The tree first runs without faults. Then each leaf that ran gets each effect in each phase, one per
trial, on the engine of sweeps. Leaves that only run when something has failed, as those of a
fallback do, get theirs together with the fault that made them run. A fault is handled if the run
succeeds all the same, its goals included.
"""

from __future__ import annotations

import html
import math
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from bt_dualarm.behaviors.language import LANGUAGE
from bt_dualarm.core.share import write_text
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.runtime.api import registry_of
from bt_dualarm.runtime.file_check import check as check_tree
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.runtime.options import RunOptions, find_tree
from bt_dualarm.runtime.outcome import Ending
from bt_dualarm.runtime.run import Run
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.checks import outcomes_in
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.faults import (
    CAMERA_FAULTS,
    EFFECTS,
    JOINT_FAULTS,
    KINDS,
    OBJECT_FAULTS,
    PHASES,
    LeafFault,
    PushedObject,
    SwappedObject,
    leaf_paths,
    unique_names,
)
from bt_dualarm.spec.node_types import NodeSpec, all_of
from bt_dualarm.spec.yaml_reader import Data, TreeInput, is_yaml, read_tree, with_tuples
from bt_dualarm.sweeps.engine import Engine
from bt_dualarm.sweeps.job import CRASHED
from bt_dualarm.sweeps.manifest import Manifest, NoTrials, SweepError, checked
from bt_dualarm.sweeps.sweep import Progress, run_sweep
from bt_dualarm.sweeps.trial import RECORDS, Branch, BranchObserver, Rules

if TYPE_CHECKING:
    import pyarrow as pa

PAGE: Final = "faults.html"

PAIRS: Final = "pairs"
"""Folder of the sweep over pairs of faults, below the output folder; likewise `HARDWARE`."""

HARDWARE: Final = "hardware"

AFTER_FAULTS: Final = "after_faults"
"""Likewise for faults of leaves that did not run without faults."""

ALWAYS: Final = "always"
"""Moment of a fault that happens in each run of its leaf, before its first step."""

MOMENTS: Final = {effect: (*PHASES, ALWAYS) if effect == "fail" else PHASES for effect in EFFECTS}
"""Moments at which each effect is injected. A `retry` must end a leaf that always fails, too."""

_PREFIX: Final = "injected_"
_FIELDS: Final = ("arm", "leaf", "effect", "phase", "after", "times")
_TYPES: Final = {"after": "duration", "times": "integer"}
_EACH_RUN: Final = 1_000_000

_BREACHES: Final = frozenset(
    str(one) for one in (Ending.INVARIANT, Ending.DIVERGED, Ending.ERROR, Ending.OVERRUN)
)
"""Endings of runs that broke a rule, whatever their trees report."""


@dataclass(frozen=True)
class FaultTrial:
    """What became of a run with faults.

    Attributes:
        sentence: The faults that were injected.
        outcome: Outcome of the run.
        code: Code of the decisive failure, empty for SUCCESS.
        reason: Its sentence.
        ending: Why the run ended.
        broken_rule: Sentence on a rule of every run that was broken, otherwise empty.
        record: Path of its record from the output folder; there is one unless it succeeded.
    """

    sentence: str
    outcome: str
    code: str
    reason: str
    ending: str
    broken_rule: str
    record: str

    @property
    def is_handled(self) -> bool:
        """Whether the task succeeded anyway, and no rule was broken."""
        return self.outcome == "SUCCESS" and not self.is_breach

    @property
    def is_breach(self) -> bool:
        """Whether the run broke a rule: a false success, an invariant, a crash, a hanging tick."""
        is_bad = self.outcome in ("FALSE_SUCCESS", CRASHED, "ERROR") or self.ending in _BREACHES
        return is_bad or bool(self.broken_rule) or self.code == "NOT_REPEATABLE"

    @property
    def why(self) -> str:
        """Why it ended in this way, in a sentence."""
        return self.broken_rule or self.reason or self.ending

    @property
    def end(self) -> str:
        """How the run ended, in a word or a sentence."""
        return self.broken_rule or self.code or self.ending


@dataclass(frozen=True)
class LeafTrial(FaultTrial):
    """What became of the run with one fault of a leaf.

    Attributes:
        arm: Name of the arm.
        leaf: Path of the leaf.
        effect: ``fail``, ``raise`` or ``hang``.
        moment: ``start``, ``during``, ``end`` or ``always``.
    """

    arm: str
    leaf: str
    effect: str
    moment: str


@dataclass(frozen=True)
class FaultCampaign:
    """Result of injecting faults into every leaf of a tree.

    Attributes:
        title: Path or name of the tree.
        trees: Root of each arm's tree, by the arm's name.
        faults: All faults, in the order of the trees.
        never_ran: Paths of leaves, by arm, that did not run without faults.
        branches: Branches of each tree, by arm: every node and each status that it may return.
        taken: Those of them that the run without faults or any trial took.
        pairs: Sampled pairs of faults of leaves.
        hardware: Sampled faults of hardware and world.
    """

    title: str
    trees: Mapping[str, NodeSpec]
    faults: tuple[LeafTrial, ...]
    never_ran: Mapping[str, tuple[str, ...]]
    branches: Mapping[str, frozenset[Branch]]
    taken: Mapping[str, frozenset[Branch]]
    pairs: tuple[FaultTrial, ...] = ()
    hardware: tuple[FaultTrial, ...] = ()

    @property
    def coverage(self) -> float:
        """Fraction of the branches of all trees that were taken in any of the trials."""
        return sum(map(len, self.taken.values())) / sum(map(len, self.branches.values()))

    @property
    def trials(self) -> tuple[FaultTrial, ...]:
        """All trials."""
        return (*self.faults, *self.pairs, *self.hardware)

    def of(self, arm: str, leaf: str) -> tuple[LeafTrial, ...]:
        """Faults of one leaf."""
        return tuple(one for one in self.faults if (one.arm, one.leaf) == (arm, leaf))


def inject_faults(
    tree: TreeInput,
    out: Path,
    engine: Callable[[], Engine],
    *,
    seed: int = 0,
    pairs: int = 0,
    hardware: int = 0,
    skills: tuple[Path, ...] = (),
    stop: StopRequest | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> FaultCampaign:
    """Inject every effect in every phase into every leaf, one per trial, and sampled faults.

    Args:
        tree: Path or name of a tree, YAML text, or a mapping.
        out: Output folder, as for a sweep; trials that have run before are kept.
        engine: Returns the engine; the caller closes it.
        seed: Seed of all trials, and of the samples.
        pairs: Number of pairs of these faults to sample; a trial has one pair.
        hardware: Number of faults of hardware and world to sample; a trial has one.
        skills: Folders of additional skills.
        stop: Request to end early.
        progress: Called after each change.

    Raises:
        SweepError: The tree does not succeed without faults, or has faults of its own.
        SpecError: The tree has errors.
    """
    if isinstance(tree, str) and not is_yaml(tree):
        tree = find_tree(tree)
    folder = tree.parent if isinstance(tree, Path) else Path()
    registry = registry_of(skills)
    file = check_tree(tree, registry.kinds, build=False).runnable()
    if file.faults:
        raise SweepError(f"{file.name} has faults of its own: leave out its section 'faults'")
    durations, taken = _without_faults(file, seed, registry)
    longest = max((end for ran in durations.values() for _, end in ran.values()), default=0.0)
    data = read_tree(tree, folder).data
    rng = np.random.default_rng([seed, zlib.crc32(b"faults")])

    def tables(
        content: dict[str, Data], points: list[Mapping[str, Data]], at: Path, rules: Rules = "all"
    ) -> pa.Table:
        manifest = Manifest(
            content,
            (seed,),
            # A hanging leaf must not take longer than its own timeouts may.
            duration=min(file.world.time_limit, 3.0 * longest + 30.0),
            skills=skills,
            folder=folder,
            explicit=tuple(points),
        )
        trials = checked(manifest)
        return run_sweep(trials, at, engine, rules=rules, stop=stop, progress=progress).table

    stop = stop or StopRequest()
    single = _faults_of(durations)
    table = tables(_with_faults(data, ("",)), single, out)
    campaign = _campaign(file, registry, durations, taken, table)
    later = _later_faults(campaign, table)
    if later and not stop.asked:
        with suppress(NoTrials):
            table = tables(_with_faults(data, _TWO), later, out / AFTER_FAULTS)
            campaign = _with_later(campaign, table)
    # A request to end early may come before the first trial of a sample: the others are shown.
    points = _sampled_pairs(single, pairs, rng) if pairs else []
    if points and not stop.asked:  # a single leaf has no pairs
        with suppress(NoTrials):
            table = tables(_with_faults(data, _TWO), points, out / PAIRS)
            campaign = replace(campaign, pairs=_pair_trials(table))
    if hardware and not stop.asked:
        sampled = sampled_hardware(file, _joints_of(file), longest, hardware, rng)
        content = _with_hardware(data, sampled)
        points = [{f"{_PREFIX}{name}": 1.0} for name in sampled]
        with suppress(NoTrials):
            table = tables(content, points, out / HARDWARE, "contact")
            campaign = replace(campaign, hardware=_hardware_trials(sampled, table))
    write_text(out / PAGE, _page(campaign, out))
    return campaign


def _without_faults(
    file: TreeFile, seed: int, registry: Registry
) -> tuple[dict[str, dict[str, tuple[float, float]]], Mapping[str, Collection[Branch]]]:
    """Start and end in s of each leaf that runs, by arm and path, and the branches taken.

    Raises:
        SweepError: The tree does not succeed.
    """
    branches = BranchObserver()
    with Run(file, registry, RunOptions(seed=seed)) as run:
        run.watch(branches)
        result = run.finish()
    if result.outcome != "SUCCESS" or not result.goals_met:
        raise SweepError(
            f"{file.name} does not succeed without faults ({result.outcome}): run it with bt-run "
            "first"
        )
    durations = {
        arm.name: {
            path: (leaf.runs[0].started_s, leaf.runs[0].ended_s or result.sim_time_s)
            for path, leaf in arm.leaves.items()
        }
        for arm in result.arms.values()
    }
    return durations, branches.taken


_TWO: Final = ("first_", "second_")
"""Prefixes of the parameters of the two faults of a pair."""


def _with_faults(data: Data, prefixes: Sequence[str]) -> dict[str, Data]:
    """The tree with a fault for each prefix, whose fields are parameters."""
    params = {
        f"{_PREFIX}{prefix}{name}": {"type": _TYPES.get(name, "text")}
        for prefix in prefixes
        for name in _FIELDS
    }
    given = data.get("params") or {}
    faults = {
        f"{prefix}injected": {name: f"{{{_PREFIX}{prefix}{name}}}" for name in _FIELDS}
        for prefix in prefixes
    }
    return {**data, "params": {**given, **params}, "faults": faults}


def _sampled_pairs(
    single: Sequence[Mapping[str, Data]], count: int, rng: np.random.Generator
) -> list[Mapping[str, Data]]:
    """Pairs of faults of different leaves, each pair once; fewer if there are not so many."""
    found: dict[tuple[int, int], Mapping[str, Data]] = {}
    for _ in range(20 * count):
        if len(found) == count or len(single) < 2:
            break
        first, second = sorted(int(index) for index in rng.choice(len(single), 2, replace=False))
        places = {
            tuple(single[index][f"{_PREFIX}{name}"] for name in ("arm", "leaf"))
            for index in (first, second)
        }
        if len(places) == 2:
            found[first, second] = {
                f"{_PREFIX}{prefix}{name}": single[index][f"{_PREFIX}{name}"]
                for prefix, index in zip(_TWO, (first, second), strict=True)
                for name in _FIELDS
            }
    return [*found.values()]


def _pair_trials(table: pa.Table) -> tuple[FaultTrial, ...]:
    trials = []
    for row in table.to_pylist():
        sentence = " + ".join(" ".join(_given(row, prefix)) for prefix in _TWO)
        trials.append(FaultTrial(sentence, **_ending_of(row, f"{PAIRS}/")))
    return tuple(trials)


# Faults of hardware and world

_LASTING_S: Final = (0.5, 2.0, None)
"""Durations of sampled faults; None for one that does not end."""

_PUSH_S: Final = 0.2
_PUSH_WEIGHTS: Final = 3.0
"""Force of a sampled push, in weights of the object."""


def _joints_of(file: TreeFile) -> dict[str, tuple[str, ...]]:
    return {
        name: tuple(load_robot(arm.robot, file.root, arm.locked).joints)
        for name, arm in file.arms.items()
    }


def sampled_hardware(
    file: TreeFile,
    joints: Mapping[str, Sequence[str]],
    longest: float,
    count: int,
    rng: np.random.Generator,
) -> dict[str, dict[str, Data]]:
    """Faults of hardware and world that fit a file, all kinds about equally often.

    Args:
        file: The file.
        joints: Names of the joints of each arm, by the arm's name.
        longest: Simulated seconds within which they begin.
        count: Number of faults.
        rng: Random generator.

    Returns:
        Faults by name, as below ``faults`` in a file.
    """
    arms = [*file.arms]
    cameras = [name for name, arm in file.arms.items() if arm.camera is not None]
    movable = [name for name, one in file.objects.items() if one.spawned and one.is_free]
    kinds = [
        name
        for name, kind in KINDS.items()
        if kind is not LeafFault
        and (kind not in CAMERA_FAULTS or cameras)
        and (kind not in OBJECT_FAULTS or movable)
        and (kind is not SwappedObject or len(movable) > 1)
    ]
    order: list[str] = []
    while len(order) < count:
        order += [kinds[index] for index in rng.permutation(len(kinds))]

    def one_of(names: Sequence[str]) -> str:
        return names[int(rng.integers(len(names)))]

    found: dict[str, dict[str, Data]] = {}
    for number, name in enumerate(order[:count], 1):
        kind = KINDS[name]
        begin = round(float(rng.uniform(0.0, longest)), 3)
        lasting = _LASTING_S[int(rng.integers(len(_LASTING_S)))]
        fault: dict[str, Data] = {"kind": name, "begin": begin}
        if kind in OBJECT_FAULTS:
            fault["object"] = one_of(movable)
        else:
            fault["arm"] = one_of(cameras if kind in CAMERA_FAULTS else arms)
        if kind in JOINT_FAULTS:
            fault["joint"] = one_of(joints[fault["arm"]])
        if kind is SwappedObject:
            fault["other"] = one_of([other for other in movable if other != fault["object"]])
        if kind is PushedObject:
            angle = float(rng.uniform(0.0, 2.0 * math.pi))
            force = _PUSH_WEIGHTS * 9.81 * file.objects[fault["object"]].total_mass
            direction = (math.cos(angle), math.sin(angle), 0.0)
            fault["force"] = [round(min(force, 1000.0) * part, 3) for part in direction]
            lasting = _PUSH_S
        if lasting is not None:
            fault["until"] = round(begin + lasting, 3)
        found[f"hardware_{number}"] = fault
    return found


def _with_hardware(data: Data, sampled: Mapping[str, Mapping[str, Data]]) -> dict[str, Data]:
    """The tree with all sampled faults; a parameter for each decides whether it happens."""
    params = {
        f"{_PREFIX}{name}": {"type": "number", "default": 0.0, "range": [0.0, 1.0]}
        for name in sampled
    }
    given = data.get("params") or {}
    faults = {
        name: {**fault, "probability": f"{{{_PREFIX}{name}}}"} for name, fault in sampled.items()
    }
    return {**data, "params": {**given, **params}, "faults": faults}


def _hardware_trials(
    sampled: Mapping[str, Mapping[str, Data]], table: pa.Table
) -> tuple[FaultTrial, ...]:
    trials = []
    for row in table.to_pylist():
        name = next(name for name in sampled if row.get(f"param.{_PREFIX}{name}"))
        fault = KINDS[sampled[name]["kind"]].model_validate(with_tuples(dict(sampled[name])))
        lasted = f"{fault.begin:g} s on"
        if "until" in sampled[name]:
            lasted = f"{fault.begin:g} to {fault.until:g} s"
        trials.append(FaultTrial(f"{fault.sentence}, {lasted}", **_ending_of(row, f"{HARDWARE}/")))
    return tuple(trials)


def _ending_of(row: Mapping[str, Data], folder: str = "") -> dict[str, str]:
    names = "outcome", "code", "reason", "ending", "broken_rule"
    found = {name: str(row.get(name) or "") for name in names}
    return found | {"record": f"{folder}{RECORDS}/{row['identity']}"}


def _given(row: Mapping[str, Data], prefix: str = "") -> tuple[str, str, str, str]:
    """Arm, leaf, effect and moment of an injected fault of a leaf."""
    values = {name: row[f"param.{_PREFIX}{prefix}{name}"] for name in _FIELDS}
    moment = ALWAYS if values["times"] > 1 else values["phase"]
    return values["arm"], values["leaf"], values["effect"], moment


def _fault(arm: str, leaf: str, effect: str, moment: str, duration: float) -> dict[str, Data]:
    """Fields of a fault of a leaf that takes a duration in s."""
    phase, times = ("start", _EACH_RUN) if moment == ALWAYS else (moment, 1)
    after = round(0.5 * duration, 3) if phase == "during" else 0.0
    return dict(zip(_FIELDS, (arm, leaf, effect, phase, after, times), strict=True))


def _faults_of_leaf(arm: str, leaf: str, duration: float) -> Iterator[dict[str, Data]]:
    for effect, moments in MOMENTS.items():
        for moment in moments:
            fault = _fault(arm, leaf, effect, moment, duration)
            if moment != "during" or fault["after"] > 0.0:  # what takes no time has no middle
                yield fault


def _faults_of(
    durations: Mapping[str, Mapping[str, tuple[float, float]]],
) -> list[Mapping[str, Data]]:
    return [
        {f"{_PREFIX}{name}": value for name, value in fault.items()}
        for arm, leaves in durations.items()
        for leaf, (start, end) in leaves.items()
        for fault in _faults_of_leaf(arm, leaf, end - start)
    ]


def _branches_in(row: Mapping[str, Data], arm: str) -> Iterator[tuple[str, str, float]]:
    """Path, status and duration in s of each branch that a trial took."""
    for line in (row.get(f"branches.{arm}") or "").splitlines():
        path, status, seconds = line.rsplit("\t", 2)
        yield path, status, float(seconds)


def _later_faults(campaign: FaultCampaign, table: pa.Table) -> list[Mapping[str, Data]]:
    """Faults of leaves that ran only because of another fault, each with the first such fault."""
    waiting = {(arm, path) for arm, paths in campaign.never_ran.items() for path in paths}
    found: list[Mapping[str, Data]] = []
    for row in table.to_pylist():
        if row.get("outcome") == CRASHED:
            continue
        first = {f"{_PREFIX}{_TWO[0]}{n}": row[f"param.{_PREFIX}{n}"] for n in _FIELDS}
        for arm in campaign.trees:
            for path, _, seconds in _branches_in(row, arm):
                if (arm, path) in waiting:
                    waiting.remove((arm, path))
                    found += [
                        first | {f"{_PREFIX}{_TWO[1]}{n}": value for n, value in fault.items()}
                        for fault in _faults_of_leaf(arm, path, seconds)
                    ]
    return found


def _with_later(campaign: FaultCampaign, table: pa.Table) -> FaultCampaign:
    """Add the faults of leaves that did not run without faults to a campaign."""
    more = []
    for row in table.to_pylist():
        first, second = (_given(row, prefix) for prefix in _TWO)
        sentence = f"{' '.join(second)} after {' '.join(first)}"
        more.append(LeafTrial(sentence, **_ending_of(row, f"{AFTER_FAULTS}/"), **_place(second)))
    return replace(
        campaign,
        faults=(*campaign.faults, *more),
        taken=_more_taken(campaign.branches, campaign.taken, table),
    )


def _place(given: tuple[str, str, str, str]) -> dict[str, str]:
    return dict(zip(("arm", "leaf", "effect", "moment"), given, strict=True))


def _more_taken(
    branches: Mapping[str, frozenset[Branch]],
    taken: Mapping[str, Collection[Branch]],
    table: pa.Table,
) -> dict[str, frozenset[Branch]]:
    """The branches taken so far or in a trial of the table, of those that there are."""
    found = {arm: set(taken.get(arm, ())) for arm in branches}
    for row in table.to_pylist():
        for arm, seen in found.items():
            seen |= {(path, status) for path, status, _ in _branches_in(row, arm)}
    return {arm: branches[arm] & seen for arm, seen in found.items()}


def _campaign(
    file: TreeFile,
    registry: Registry,
    durations: Mapping[str, Mapping[str, tuple[float, float]]],
    taken: Mapping[str, Collection[Branch]],
    table: pa.Table,
) -> FaultCampaign:
    faults = []
    for row in table.to_pylist():
        given = _given(row)
        faults.append(LeafTrial(" ".join(given), **_ending_of(row), **_place(given)))
    trees = {name: arm.tree for name, arm in file.arms.items()}
    never = {
        arm: tuple(path for path in leaf_paths(root) if path not in durations.get(arm, {}))
        for arm, root in trees.items()
    }
    branches = {arm: _branches_of(root, registry) for arm, root in trees.items()}
    found = _more_taken(branches, taken, table)
    return FaultCampaign(file.name, trees, tuple(faults), never, branches, found)


def _branches_of(root: NodeSpec, registry: Registry) -> frozenset[Branch]:
    """Every node of a tree with each status that it may return as far as the file tells."""
    outcomes = outcomes_in(root, all_of(LANGUAGE, registry.kinds))
    found: set[Branch] = set()
    for node, path, _ in _walked(root):
        found |= {(path, "SUCCESS")} if outcomes[node].succeeds else set()
        found |= {(path, "FAILURE")} if outcomes[node].fails else set()
    return frozenset(found)


def _walked(root: NodeSpec) -> Iterator[tuple[NodeSpec, str, int]]:
    """Each node of a tree from the top down, with its path and depth; the root's is 1."""
    waiting = [(root, root.name, 1)]
    while waiting:
        node, path, depth = waiting.pop()
        yield node, path, depth
        names = unique_names(node.children)
        below = [(c, f"{path}/{n}", depth + 1) for c, n in zip(node.children, names, strict=True)]
        waiting += reversed(below)


# The annotated tree, in the terminal and as a page.


def marks_of(faults: Sequence[LeafTrial], *, ascii_only: bool = False) -> str:
    """One sign per effect and moment: handled, not handled, breach; a dot where there is none."""
    handled, missed, breach, none = ("+", "x", "!", ".") if ascii_only else ("✔", "✘", "⚠", "·")
    signs = {
        (one.effect, one.moment): breach if one.is_breach else handled if one.is_handled else missed
        for one in faults
    }
    groups = [
        f"{effect} {''.join(signs.get((effect, moment), none) for moment in moments)}"
        for effect, moments in MOMENTS.items()
    ]
    return "  ".join(groups)


def lines_of(campaign: FaultCampaign, *, ascii_only: bool = False) -> list[str]:
    """The trees with the marks of every leaf, and the branches of its parents not taken."""
    lines = []
    for arm, root in campaign.trees.items():
        lines.append(arm)
        for node, path, depth in _walked(root):
            name = path.rpartition("/")[2]
            kind = "" if node.kind == name.partition("#")[0] else f" [{node.kind}]"
            text = f"{'  ' * depth}{name}{kind}"
            if not node.children:
                found = campaign.of(arm, path)
                # Nothing made it run; or the campaign was interrupted.
                without = "did not run" if path in campaign.never_ran[arm] else "not tried yet"
                marks = marks_of(found, ascii_only=ascii_only) if found else without
                text = f"{text:<44} {marks}"
            elif note := _not_taken(campaign, arm, path):
                text = f"{text:<44} {note}"
            lines.append(text)
    return lines


def _not_taken(campaign: FaultCampaign, arm: str, path: str) -> str:
    """What a node never returned in any trial although it may; empty if nothing is missing."""
    statuses = [
        status
        for status in ("SUCCESS", "FAILURE")
        if (path, status) in campaign.branches[arm] - campaign.taken[arm]
    ]
    return f"never {' or '.join(statuses)}" if statuses else ""


def sample_lines(campaign: FaultCampaign, *, ascii_only: bool = False) -> list[str]:
    """A line on each sampled pair and each sampled fault of hardware, below their headings."""
    handled, missed, breach = ("+", "x", "!") if ascii_only else ("✔", "✘", "⚠")
    lines = []
    for title, trials in _samples(campaign):
        done = sum(one.is_handled for one in trials)
        lines.append(f"{title}: {done} of {len(trials)} are handled")
        for one in trials:
            sign = breach if one.is_breach else handled if one.is_handled else missed
            why = "" if one.is_handled else f"  {one.end}"
            lines.append(f"  {sign} {one.sentence}{why}")
    return lines


def _samples(campaign: FaultCampaign) -> list[tuple[str, tuple[FaultTrial, ...]]]:
    both = (("pairs of faults", campaign.pairs), ("hardware and world", campaign.hardware))
    return [(title, trials) for title, trials in both if trials]


def summary_of(campaign: FaultCampaign) -> str:
    """One sentence on all faults."""
    total = len(campaign.trials)
    handled = sum(one.is_handled for one in campaign.trials)
    breaches = sum(one.is_breach for one in campaign.trials)
    share = 100 * handled / total if total else math.nan
    breaks = "breaks" if breaches == 1 else "break"
    return (
        f"{handled} of {total} faults are handled ({share:.0f} %), {breaches} {breaks} a rule; "
        f"{100 * campaign.coverage:.0f} % of the branches were taken"
    )


_STYLE: Final = (
    "body{font:15px/1.5 system-ui,sans-serif;margin:0;background:#f4f6f8;color:#1d2733}"
    "main{max-width:1080px;margin:0 auto;padding:24px 32px 48px;background:#fff}"
    "table{border-collapse:collapse;font-size:13px;width:100%}"
    "th{text-align:center;color:#5b6875;border-bottom:2px solid #dde3e9;padding:4px 8px}"
    "td{border-bottom:1px solid #e8ecf0;padding:3px 8px;text-align:center}"
    "td:first-child,th:first-child{text-align:left;font-family:ui-monospace,monospace;"
    "white-space:pre}.h{background:#d9f0e4}.m{background:#f7dcda}.b{background:#c2453d;color:#fff}"
    ".n{color:#9aa5b1}td a{color:inherit;text-decoration:none}td a:hover{text-decoration:underline}"
)


def _page(campaign: FaultCampaign, out: Path) -> str:
    """The annotated trees as one page; a cell's tooltip has its reason, its sign a record."""
    columns = [(effect, moment) for effect, moments in MOMENTS.items() for moment in moments]
    head = "<tr><th>leaf</th>" + "".join(f"<th>{e}<br>{p}</th>" for e, p in columns) + "</tr>"
    rows = []
    for arm, root in campaign.trees.items():
        rows.append(f"<tr><td><b>{html.escape(arm)}</b></td>{'<td></td>' * len(columns)}</tr>")
        for node, path, depth in _walked(root):
            by = {(one.effect, one.moment): one for one in campaign.of(arm, path)}
            name = "  " * depth + path.rpartition("/")[2]
            cells = "".join(_cell(by.get(column), out, not node.children) for column in columns)
            note = _not_taken(campaign, arm, path) if node.children else ""
            if note:
                cells = f'<td class="n" colspan="{len(columns)}">{note}</td>'
            rows.append(f"<tr><td>{html.escape(name)}</td>{cells}</tr>")
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8">'
        f"<title>Faults of {html.escape(campaign.title)}</title><style>{_STYLE}</style><main>"
        f"<h1>Faults of {html.escape(campaign.title)}</h1>"
        f"<p>{html.escape(summary_of(campaign))}.</p>"
        "<p>✔ the task succeeded anyway; ✘ the run failed; ⚠ a rule was broken; · no such moment. "
        "A sign's tooltip has the reason; it links to the record of the run, for bt-why.</p>"
        f"<table>{head}{''.join(rows)}</table>{_breaches(campaign)}"
        f"{_sample_tables(campaign, out)}</main></html>\n"
    )


def _breaches(campaign: FaultCampaign) -> str:
    """List of the broken rules; empty if there are none."""
    lines = [
        f"<li>{html.escape(one.sentence)}: <b>{html.escape(one.outcome)}</b> "
        f"{html.escape(one.why)}</li>"
        for one in campaign.trials
        if one.is_breach
    ]
    return f"<h2>Broken rules</h2><ul>{''.join(lines)}</ul>" if lines else ""


def _sample_tables(campaign: FaultCampaign, out: Path) -> str:
    """Tables of the sampled faults."""
    parts = []
    for title, trials in _samples(campaign):
        rows = "".join(
            f"<tr><td>{html.escape(one.sentence)}</td>{_cell(one, out, is_leaf=True)}"
            f"<td>{'' if one.is_handled else html.escape(one.end)}</td></tr>"
            for one in trials
        )
        head = "<tr><th>fault</th><th></th><th>end</th></tr>"
        parts.append(f"<h2>{html.escape(title.capitalize())}</h2><table>{head}{rows}</table>")
    return "".join(parts)


def _cell(one: FaultTrial | None, out: Path, is_leaf: bool) -> str:
    if one is None:
        return '<td class="n">·</td>' if is_leaf else "<td></td>"
    sign, kind = ("✔", "h") if one.is_handled else ("⚠", "b") if one.is_breach else ("✘", "m")
    tip = html.escape(f"{one.outcome} {one.code}: {one.why}", quote=True)
    if (out / one.record).is_dir():
        sign = f'<a href="{html.escape(one.record, quote=True)}">{sign}</a>'
    return f'<td class="{kind}" title="{tip}">{sign}</td>'
