"""Which faults of which leaves a tree handles: every leaf is made to fail, raise and hang in turn.

The tree first runs without faults. Then each leaf that ran gets each effect in each phase, one per
trial, on the engine of sweeps. A fault is handled if the run succeeds all the same, its goals
included.
"""

from __future__ import annotations

import html
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bt_dualarm.core.share import write_text
from bt_dualarm.runtime.api import registry_of
from bt_dualarm.runtime.file_check import check as check_tree
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.runtime.options import RunOptions, find_tree
from bt_dualarm.runtime.run import Run
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.faults import EFFECTS, PHASES, leaf_paths, unique_names
from bt_dualarm.spec.node_types import NodeSpec
from bt_dualarm.spec.yaml_reader import Data, TreeInput, is_yaml, read_tree
from bt_dualarm.sweeps.engine import Engine
from bt_dualarm.sweeps.manifest import Manifest, SweepError, checked
from bt_dualarm.sweeps.sweep import Progress, run_sweep

if TYPE_CHECKING:
    import pyarrow as pa

PAGE: Final = "faults.html"

_PREFIX: Final = "injected_"
_FIELDS: Final = ("arm", "leaf", "effect", "phase", "after")


@dataclass(frozen=True)
class LeafFault:
    """What became of the run with one fault.

    Attributes:
        arm: Name of the arm.
        leaf: Path of the leaf.
        effect: ``fail``, ``raise`` or ``hang``.
        phase: ``start``, ``during`` or ``end``.
        outcome: Outcome of the run.
        code: Code of the decisive failure, empty for SUCCESS.
        reason: Its sentence.
        ending: Why the run ended.
    """

    arm: str
    leaf: str
    effect: str
    phase: str
    outcome: str
    code: str
    reason: str
    ending: str

    @property
    def is_handled(self) -> bool:
        """Whether the task was done all the same."""
        return self.outcome == "SUCCESS"

    @property
    def is_breach(self) -> bool:
        """Whether the run broke a rule: a false success, an invariant, a crash."""
        return self.outcome in ("FALSE_SUCCESS", "CRASHED", "ERROR") or "invariant" in self.ending


@dataclass(frozen=True)
class FaultCampaign:
    """Result of injecting faults into every leaf of a tree.

    Attributes:
        title: Path or name of the tree.
        trees: Root of each arm's tree, by the arm's name.
        faults: All faults, in the order of the trees.
        never_ran: Paths of leaves, by arm, that did not run without faults.
        reached: Paths of leaves, by arm, that ran in any of the trials.
    """

    title: str
    trees: Mapping[str, NodeSpec]
    faults: tuple[LeafFault, ...]
    never_ran: Mapping[str, tuple[str, ...]]
    reached: Mapping[str, frozenset[str]]

    @property
    def coverage(self) -> float:
        """Share of the leaves of all trees that ran in any of the trials."""
        leaves = sum(len(leaf_paths(root)) for root in self.trees.values())
        return sum(len(paths) for paths in self.reached.values()) / leaves

    def of(self, arm: str, leaf: str) -> tuple[LeafFault, ...]:
        """Faults of one leaf."""
        return tuple(one for one in self.faults if (one.arm, one.leaf) == (arm, leaf))


def inject_faults(
    tree: TreeInput,
    out: Path,
    engine: Callable[[], Engine],
    *,
    seed: int = 0,
    skills: tuple[Path, ...] = (),
    stop: StopRequest | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> FaultCampaign:
    """Inject every effect in every phase into every leaf, one per trial.

    Args:
        tree: Path or name of a tree, YAML text, or a mapping.
        out: Output folder, as of a sweep; trials that have run before are kept.
        engine: Returns the engine; the caller closes it.
        seed: Seed of all trials.
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
    durations = _without_faults(file, seed, skills)
    longest = max((end for ran in durations.values() for _, end in ran.values()), default=0.0)
    manifest = Manifest(
        _with_fault(read_tree(tree, folder).data),
        (seed,),
        # A hanging leaf must not take longer than its own timeouts may.
        duration=min(file.world.time_limit, 3.0 * longest + 30.0),
        skills=skills,
        folder=folder,
        explicit=tuple(_faults_of(durations)),
    )
    result = run_sweep(
        checked(manifest), out, engine, stop=stop, progress=progress, keep="failures"
    )
    campaign = _campaign(file, durations, result.table)
    write_text(out / PAGE, _page(campaign))
    return campaign


def _without_faults(
    file: TreeFile, seed: int, skills: tuple[Path, ...]
) -> dict[str, dict[str, tuple[float, float]]]:
    """Start and end in s of each leaf that runs, by arm and path.

    Raises:
        SweepError: The tree does not succeed.
    """
    with Run(file, registry_of(skills), RunOptions(seed=seed)) as run:
        result = run.finish()
    if result.outcome != "SUCCESS" or not result.goals_met:
        raise SweepError(
            f"{file.name} does not succeed without faults ({result.outcome}): run it with bt-run "
            "first"
        )
    return {
        arm.name: {
            path: (leaf.runs[0].started_s, leaf.runs[0].ended_s or result.sim_time_s)
            for path, leaf in arm.leaves.items()
        }
        for arm in result.arms.values()
    }


def _with_fault(data: Data) -> dict[str, Data]:
    """The tree with a fault whose fields are parameters."""
    params = {
        f"{_PREFIX}{name}": {"type": "duration" if name == "after" else "text"} for name in _FIELDS
    }
    given = data.get("params") or {}
    faults = {"injected": {name: f"{{{_PREFIX}{name}}}" for name in _FIELDS}}
    return {**data, "params": {**given, **params}, "faults": faults}


def _faults_of(
    durations: Mapping[str, Mapping[str, tuple[float, float]]],
) -> list[Mapping[str, Data]]:
    found: list[Mapping[str, Data]] = []
    for arm, leaves in durations.items():
        for leaf, (start, end) in leaves.items():
            for effect in EFFECTS:
                for phase in PHASES:
                    after = round(0.5 * (end - start), 3) if phase == "during" else 0.0
                    if phase == "during" and after <= 0.0:
                        continue  # it takes no time: there is no middle
                    values = (arm, leaf, effect, phase, after)
                    found.append({f"{_PREFIX}{n}": v for n, v in zip(_FIELDS, values, strict=True)})
    return found


def _campaign(
    file: TreeFile, durations: Mapping[str, Mapping[str, tuple[float, float]]], table: pa.Table
) -> FaultCampaign:
    faults = []
    reached = {arm: set(leaves) for arm, leaves in durations.items()}
    for row in table.to_pylist():
        given = {name: row[f"param.{_PREFIX}{name}"] for name in _FIELDS[:-1]}
        rest = {n: str(row.get(n) or "") for n in ("outcome", "code", "reason", "ending")}
        faults.append(LeafFault(**given, **rest))
        for arm in reached:
            reached[arm] |= set((row.get(f"leaves.{arm}") or "").split("\n")) - {""}
    trees = {name: arm.tree for name, arm in file.arms.items()}
    never = {
        arm: tuple(path for path in leaf_paths(root) if path not in durations.get(arm, {}))
        for arm, root in trees.items()
    }
    known = {
        arm: frozenset(paths & leaf_paths(trees[arm]).keys()) for arm, paths in reached.items()
    }
    title = file.name
    return FaultCampaign(title, trees, tuple(faults), never, known)


# The annotated tree, in the terminal and as a page.


def marks_of(faults: Sequence[LeafFault], *, ascii_only: bool = False) -> str:
    """One sign per effect and phase: handled, not handled, breach; a dot where there is none."""
    handled, missed, breach, none = ("+", "x", "!", ".") if ascii_only else ("✔", "✘", "⚠", "·")
    by = {(one.effect, one.phase): one for one in faults}
    groups = []
    for effect in EFFECTS:
        signs = ""
        for phase in PHASES:
            one = by.get((effect, phase))
            signs += (
                none
                if one is None
                else breach
                if one.is_breach
                else handled
                if one.is_handled
                else missed
            )
        groups.append(f"{effect} {signs}")
    return "  ".join(groups)


def lines_of(campaign: FaultCampaign, *, ascii_only: bool = False) -> list[str]:
    """The trees with the marks of every leaf."""
    lines = []
    for arm, root in campaign.trees.items():
        lines.append(arm)
        waiting = [(root, root.name, 1)]
        while waiting:
            node, path, depth = waiting.pop()
            name = path.rpartition("/")[2]
            kind = "" if node.kind == name.partition("#")[0] else f" [{node.kind}]"
            text = f"{'  ' * depth}{name}{kind}"
            if not node.children:
                found = campaign.of(arm, path)
                marks = marks_of(found, ascii_only=ascii_only) if found else "did not run"
                text = f"{text:<44} {marks}"
            lines.append(text)
            paths = [(child, f"{path}/{n}") for child, n in _named(node)]
            waiting += [(child, below, depth + 1) for child, below in reversed(paths)]
    return lines


def _named(node: NodeSpec) -> list[tuple[NodeSpec, str]]:
    return list(zip(node.children, unique_names(node.children), strict=True))


def summary_of(campaign: FaultCampaign) -> str:
    """One sentence on all faults."""
    total = len(campaign.faults)
    handled = sum(one.is_handled for one in campaign.faults)
    breaches = sum(one.is_breach for one in campaign.faults)
    share = 100 * handled / total if total else math.nan
    return (
        f"{handled} of {total} faults are handled ({share:.0f} %), {breaches} break a rule; "
        f"{100 * campaign.coverage:.0f} % of the leaves ran in some trial"
    )


_STYLE: Final = (
    "body{font:15px/1.5 system-ui,sans-serif;margin:0;background:#f4f6f8;color:#1d2733}"
    "main{max-width:1080px;margin:0 auto;padding:24px 32px 48px;background:#fff}"
    "table{border-collapse:collapse;font-size:13px;width:100%}"
    "th{text-align:center;color:#5b6875;border-bottom:2px solid #dde3e9;padding:4px 8px}"
    "td{border-bottom:1px solid #e8ecf0;padding:3px 8px;text-align:center}"
    "td:first-child,th:first-child{text-align:left;font-family:ui-monospace,monospace;"
    "white-space:pre}.h{background:#d9f0e4}.m{background:#f7dcda}.b{background:#c2453d;color:#fff}"
    ".n{color:#9aa5b1}"
)


def _page(campaign: FaultCampaign) -> str:
    """The annotated trees as one page; a cell's tooltip has code and reason."""
    columns = [(effect, phase) for effect in EFFECTS for phase in PHASES]
    head = "<tr><th>leaf</th>" + "".join(f"<th>{e}<br>{p}</th>" for e, p in columns) + "</tr>"
    rows = []
    for arm, root in campaign.trees.items():
        rows.append(f"<tr><td><b>{html.escape(arm)}</b></td>{'<td></td>' * len(columns)}</tr>")
        waiting = [(root, root.name, 1)]
        while waiting:
            node, path, depth = waiting.pop()
            by = {(one.effect, one.phase): one for one in campaign.of(arm, path)}
            name = "  " * depth + path.rpartition("/")[2]
            cells = "".join(_cell(by.get(column), not node.children) for column in columns)
            rows.append(f"<tr><td>{html.escape(name)}</td>{cells}</tr>")
            below = [(child, f"{path}/{n}", depth + 1) for child, n in _named(node)]
            waiting += reversed(below)
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8">'
        f"<title>Faults of {html.escape(campaign.title)}</title><style>{_STYLE}</style><main>"
        f"<h1>Faults of {html.escape(campaign.title)}</h1>"
        f"<p>{html.escape(summary_of(campaign))}.</p>"
        "<p>✔ the task was done all the same; ✘ the run failed; ⚠ a rule was broken.</p>"
        f"<table>{head}{''.join(rows)}</table></main></html>\n"
    )


def _cell(one: LeafFault | None, is_leaf: bool) -> str:
    if one is None:
        return '<td class="n">·</td>' if is_leaf else "<td></td>"
    sign, kind = ("✔", "h") if one.is_handled else ("⚠", "b") if one.is_breach else ("✘", "m")
    tip = html.escape(f"{one.outcome} {one.code}: {one.reason or one.ending}", quote=True)
    return f'<td class="{kind}" title="{tip}">{sign}</td>'
