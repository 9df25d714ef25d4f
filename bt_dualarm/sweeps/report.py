"""The report of a sweep: what succeeds, what breaks, where and why, as Markdown and as one page."""

from __future__ import annotations

import base64
import html
import io
import json
import math
import shlex
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Vector
from bt_dualarm.core.share import write_text
from bt_dualarm.spec.node_types import counted
from bt_dualarm.sweeps.job import Cell
from bt_dualarm.sweeps.manifest import TEXT, SweepError
from bt_dualarm.sweeps.statistics import Boundary, SuccessRate
from bt_dualarm.sweeps.table import FAULTS, MANIFEST, columns_of, digest
from bt_dualarm.sweeps.trial import RECORDS

if TYPE_CHECKING:
    import pyarrow as pa
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKDOWN: Final = "report.md"
PAGE: Final = "report.html"

MOST_CELLS: Final = 60
"""Combinations listed one by one; of more, as of samples, only the charts and groups are shown."""

_MOST_CAUSES: Final = 20
_MOST_METRICS: Final = 60
_MOST_HISTOGRAMS: Final = 12
_BINS: Final = 8
_QUANTILES: Final = (0.05, 0.5, 0.95, 1.0)
_GOOD: Final = "#2f9e6e"
_BAD: Final = "#c2453d"
_INK: Final = "#39424e"


@dataclass(frozen=True)
class CellRate:
    """Success of one combination of parameters and reality.

    Attributes:
        values: Values by name; ``reality`` is one of them if it varies.
        rate: Successes and trials.
        failures: Trials without success, by code.
    """

    values: Mapping[str, Cell]
    rate: SuccessRate
    failures: Counter[str]

    @property
    def label(self) -> str:
        """The combination as text."""
        return ", ".join(f"{name} {_shown(value)}" for name, value in self.values.items()) or "all"


@dataclass(frozen=True)
class FailureCause:
    """Trials that failed for the same reason at the same leaf.

    Attributes:
        code: Code of the failure, or the outcome.
        arm: Name of the arm.
        leaf: Path of the leaf.
        cause: Kind of its cause, as ``bt-why`` names it.
        sentence: The cause of the first of these trials.
        count: Number of trials.
        share: Fraction of all trials.
        identity: Identity of the first of these trials.
        trial: Its number.
        where: Values of parameters to which they are confined; empty if they occur everywhere.
    """

    code: str
    arm: str
    leaf: str
    cause: str
    sentence: str
    count: int
    share: float
    identity: str
    trial: int
    where: str


@dataclass(frozen=True)
class MetricSummary:
    """Distribution of one metric over the trials that have it.

    Attributes:
        name: Arm, leaf and name of the metric.
        values: Its values, of shape (n,).
    """

    name: str
    values: Vector

    def quantile(self, share: float) -> float:
        """Value that this fraction of trials does not exceed."""
        return float(np.quantile(self.values, share))


@dataclass(frozen=True)
class _Columns:
    """Columns that the report reads, as NumPy arrays and lists."""

    table: pa.Table
    success: npt.NDArray[np.bool_]
    params: Mapping[str, list[Cell]]

    @classmethod
    def of(cls, table: pa.Table) -> _Columns:
        outcome = table["outcome"].to_numpy(zero_copy_only=False)
        varying = {}
        names = {**columns_of(table, "param."), "reality": "reality"}
        for name, column in names.items():
            unique = table[column].unique()
            if len(unique) > 1:
                varying[name] = table[column].to_pylist()
        return cls(table, outcome == "SUCCESS", varying)

    def texts(self, name: str) -> list[str]:
        """A column of texts; empty texts where it is missing."""
        if name not in self.table.column_names:
            return [""] * len(self.table)
        return [value or "" for value in self.table[name].to_pylist()]


def cells_of(table: pa.Table) -> tuple[CellRate, ...]:
    """Success by combination of the parameters that vary, in the order of their first trial."""
    columns = _Columns.of(table)
    keys = list(zip(*columns.params.values(), strict=True)) or [()] * len(table)
    codes = _codes(columns)
    counts: dict[tuple[Cell, ...], list[int]] = {}
    failures: dict[tuple[Cell, ...], Counter[str]] = defaultdict(Counter)
    for key, good, code in zip(keys, columns.success, codes, strict=True):
        count = counts.setdefault(key, [0, 0])
        count[1] += 1
        if good:
            count[0] += 1
        else:
            failures[key][code] += 1
    return tuple(
        CellRate(dict(zip(columns.params, key, strict=True)), SuccessRate(*count), failures[key])
        for key, count in counts.items()
    )


def _codes(columns: _Columns) -> list[str]:
    outcomes = columns.texts("outcome")
    return [code or outcome for code, outcome in zip(columns.texts("code"), outcomes, strict=True)]


def causes_of(table: pa.Table) -> tuple[FailureCause, ...]:
    """Causes of failures, the most frequent first."""
    columns = _Columns.of(table)
    bad = np.flatnonzero(np.logical_not(columns.success))
    if not len(bad):
        return ()
    codes = _codes(columns)
    arms, leaves, kinds = columns.texts("arm"), columns.texts("leaf"), columns.texts("cause")
    groups: dict[tuple[str, ...], list[int]] = defaultdict(list)
    for row in map(int, bad):
        groups[codes[row], arms[row], leaves[row], kinds[row]].append(row)
    sentences, reasons = columns.texts("cause_sentence"), columns.texts("reason")
    identities = table["identity"].to_pylist()
    trials = table["trial"].to_pylist()
    found = []
    for (code, arm, leaf, kind), rows in sorted(groups.items(), key=lambda one: -len(one[1])):
        first = rows[0]
        found.append(
            FailureCause(
                code, arm, leaf, kind, sentences[first] or reasons[first], len(rows),
                len(rows) / len(table), identities[first], trials[first],
                _where(columns, rows),
            )
        )  # fmt: skip
    return tuple(found)


def _where(columns: _Columns, rows: Sequence[int]) -> str:
    """Values of parameters to which these rows are confined, while other rows have others."""
    parts = []
    for name, values in columns.params.items():
        inside = {values[row] for row in rows}
        everywhere = set(values)
        if len(inside) == len(everywhere):
            continue
        numbers = [value for value in inside if _is_number(value)]
        if len(numbers) == len(inside) and len(inside) > 2:
            parts.append(f"{name} {_shown(min(numbers))} to {_shown(max(numbers))}")  # type: ignore[type-var]
        elif len(inside) <= 2:
            parts.append(f"{name} {' or '.join(sorted(map(_shown, inside)))}")
    return ", ".join(parts)


def metrics_of(table: pa.Table) -> tuple[MetricSummary, ...]:
    """Numbers that the leaves measured, in the order of their names."""
    found = []
    for name, column in columns_of(table, "metric.").items():
        kind = str(table.schema.field(column).type)
        if kind not in ("double", "int64"):
            continue
        values = table[column].drop_null().to_numpy().astype(float)
        values = values[np.isfinite(values)]
        if len(values):
            found.append(MetricSummary(name, values))
    return tuple(found)


def write_report(
    folder: Path, table: pa.Table, title: str, boundary: Boundary | None = None
) -> None:
    """Write `MARKDOWN` and `PAGE`; records in the folder are linked.

    Args:
        folder: Output folder of the sweep.
        table: Its sorted rows, at least one.
        title: Path or name of the tree.
        boundary: Boundary of success, if it was searched.

    Raises:
        SweepError: The folder cannot be written to.
    """
    report = _Report(folder, table, title, boundary)
    try:
        write_text(folder / MARKDOWN, report.markdown())
        write_text(folder / PAGE, report.html())
    except OSError as error:
        raise SweepError(f"cannot write to {folder}: {error.strerror or error}") from error


class _Report:
    def __init__(
        self, folder: Path, table: pa.Table, title: str, boundary: Boundary | None
    ) -> None:
        self.folder = folder
        self.table = table
        self.title = title
        self.cells = cells_of(table)
        self.causes = causes_of(table)
        self.metrics = metrics_of(table)
        self.rate = SuccessRate(sum(one.rate.successes for one in self.cells), len(table))
        self.sha256 = digest(table)
        processors = set(_Columns.of(table).texts("processor")) - {""}
        self.boundary = boundary
        self.options = _options(folder)
        self.notes = [] if boundary is None else [f"Boundary of success: {boundary}."]
        if len(processors) > 1:
            self.notes.append(
                f"Trials ran on {len(processors)} kinds of processors: states of equal trials are "
                "only comparable within one kind."
            )
        crashed = sum(one.count for one in self.causes if one.code == "WORKER_DIED")
        if crashed:
            have = "has" if crashed == 1 else "have"
            self.notes.append(
                f"{counted(crashed, 'trial')} {have} no result: a worker died each time."
            )

    def command(self, cause: FailureCause) -> str:
        """Command that repeats the first trial of a cause; empty if its tree is not a file."""
        if self.title == TEXT:
            return ""
        row = self.table.filter(
            [one == cause.identity for one in self.table["identity"].to_pylist()]
        )
        values = row.to_pylist()[0]
        parts = ["bt-run", self.title]
        for name, column in columns_of(self.table, "param.").items():
            if values[column] is not None:
                parts += ["--param", f"{name}={_shown(values[column], exact=True)}"]
        parts += ["--seed", str(values["seed"])]
        parts += ["--reality", values["reality"]] if values["reality"] else []
        return shlex.join([*parts, *self.options])

    def record(self, cause: FailureCause) -> str:
        """Path of a record of the cause, from the folder; empty if none was kept."""
        path = Path(RECORDS) / cause.identity
        return path.as_posix() if (self.folder / path).is_dir() else ""

    def costs(self) -> str:
        """Sentence on time and memory."""
        sums = {
            name: self.table[name].drop_null().to_numpy()
            for name in ("cpu_s", "memory_mb")
            if name in self.table.column_names
        }
        cpu, memory = sums.get("cpu_s"), sums.get("memory_mb")
        if cpu is None or not len(cpu) or memory is None or not len(memory):
            return ""
        machines = counted(len(set(_Columns.of(self.table).texts("machine")) - {""}), "machine")
        return (
            f"{cpu.sum() / 3600:.2f} hours of CPU, {np.median(cpu):.2f} s per trial (median), "
            f"at most {memory.max():.0f} MB, on {machines}."
        )

    def markdown(self) -> str:
        """The report as Markdown."""
        lines = [
            f"# Sweep of {self.title}",
            f"**{self.rate}** of {counted(len(self.table), 'trial')} succeeded "
            "(Wilson interval, 95 %).",
            *self.notes,
            "## What breaks",
        ]
        if not self.causes:
            lines.append("Nothing: every trial succeeded.")
        else:
            head = "trials", "share", "code", "arm and leaf", "cause", "where", "record"
            rows = []
            for one in self.causes[:_MOST_CAUSES]:
                record = self.record(one)
                link = f"[record]({record})" if record else ""
                place = f"{one.arm} {one.leaf}".strip()
                share = f"{100 * one.share:.1f} %"
                rows.append((str(one.count), share, one.code, place, one.sentence, one.where, link))
            lines.append(_markdown_table(head, rows))
            commands = [self.command(one) for one in self.causes[:_MOST_CAUSES]]
            if any(commands):
                lines += [
                    "To repeat the first trial of each:",
                    "\n".join(["```bash", *commands, "```"]),
                ]
        if len(self.cells) <= MOST_CELLS:
            names = list(self.cells[0].values)
            lines += [
                "## Success by combination",
                _markdown_table(
                    [*names, "trials", "success", "failures"],
                    [
                        (
                            *map(_shown, cell.values.values()),
                            str(cell.rate.trials),
                            str(cell.rate),
                            _counted(cell.failures),
                        )
                        for cell in self.cells
                    ],
                ),
            ]
        lines += [
            "## Metrics",
            _markdown_table(
                ("metric", "trials", "5 %", "median", "95 %", "largest"),
                [
                    (
                        metric.name,
                        str(len(metric.values)),
                        *(f"{metric.quantile(share):.4g}" for share in _QUANTILES),
                    )
                    for metric in self.metrics[:_MOST_METRICS]
                ],
            ),
            self.costs(),
            f"Hash of all results: `{self.sha256}`",
        ]
        return "\n\n".join(filter(None, lines)) + "\n"

    def html(self) -> str:
        """The report as one page without external files, except links to records."""
        low, high = self.rate.interval
        body = [
            f"<h1>Sweep of <code>{html.escape(self.title)}</code></h1>",
            f'<p class="headline"><b>{100 * self.rate.value:.1f} %</b> of '
            f"{counted(len(self.table), 'trial')} succeeded "
            f"<span>95 % interval {100 * low:.1f} to {100 * high:.1f} %</span></p>",
            _bar(self.rate),
            *(f'<p class="note">{html.escape(note)}</p>' for note in self.notes),
            "<h2>What breaks</h2>",
            self._causes_html(),
        ]
        charts = success_charts(self.table, self.cells, self.boundary)
        if charts or len(self.cells) > 1:
            body.append("<h2>Where it breaks</h2>")
            body += [_image(figure) for figure in charts]
        if 1 < len(self.cells) <= MOST_CELLS:
            body.append(html_cells(self.cells))
        if self.metrics:
            body += ["<h2>Metrics</h2>", self._metrics_html()]
            varying = [one for one in self.metrics if np.ptp(one.values) > 0.0]
            if varying:
                body.append(_image(_histograms(varying[:_MOST_HISTOGRAMS])))
        body.append(
            f"<footer>{html.escape(self.costs())} Hash of all results: <code>{self.sha256}</code>"
            "</footer>"
        )
        return (
            '<!doctype html><html lang="en"><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width">'
            f"<title>Sweep of {html.escape(self.title)}</title><style>{_STYLE}</style>"
            f"<main>{''.join(body)}</main></html>\n"
        )

    def _causes_html(self) -> str:
        if not self.causes:
            return "<p>Nothing: every trial succeeded.</p>"
        rows = []
        for one in self.causes[:_MOST_CAUSES]:
            record = html.escape(self.record(one))
            command = html.escape(self.command(one))
            how = [f"<code>{command}</code>"] if command else []
            how += [f'bt-why <a href="{record}">{record}</a>'] if record else []
            rows.append(
                (
                    str(one.count),
                    f"{100 * one.share:.1f} %",
                    f"<b>{html.escape(one.code)}</b><br>"
                    + html.escape(f"{one.arm} {one.leaf}".strip()),
                    html.escape(one.sentence),
                    html.escape(one.where) or "everywhere",
                    f'<div class="how">{"<br>".join(how)}</div>',
                )
            )
        head = "trials", "share", "failure", "cause", "where", "to repeat"
        more = len(self.causes) - _MOST_CAUSES
        return _html_table(head, rows, 2) + (f"<p>and {more} more</p>" if more > 0 else "")

    def _metrics_html(self) -> str:
        rows = [
            (
                *(f"{metric.quantile(share):.4g}" for share in _QUANTILES),
                str(len(metric.values)),
                html.escape(metric.name),
            )
            for metric in self.metrics[:_MOST_METRICS]
        ]
        table = _html_table(("5 %", "median", "95 %", "largest", "trials", "metric"), rows, 5)
        metrics = counted(len(self.metrics), "metric")
        return f"<details open><summary>{metrics}</summary>{table}</details>"


def html_cells(cells: Sequence[CellRate]) -> str:
    """Table of combinations with bars, for the page and for notebooks."""
    names = list(cells[0].values) if cells else []
    rows = []
    for cell in cells[:MOST_CELLS]:
        low, high = cell.rate.interval
        success = (
            f"{100 * cell.rate.value:.1f} %<br><small>{100 * low:.1f} to {100 * high:.1f}</small>"
        )
        rows.append(
            (
                *(html.escape(_shown(value)) for value in cell.values.values()),
                str(cell.rate.trials),
                success,
                _bar(cell.rate),
                html.escape(_counted(cell.failures)),
            )
        )
    head = (*map(html.escape, names), "trials", "success", "", "failures")
    return _html_table(head, rows, len(names) + 2)


def _html_table(head: Sequence[str], rows: Iterable[Sequence[str]], numbers: int) -> str:
    """Table of escaped cells, whose first columns are numbers."""

    def line(tag: str, cells: Sequence[str]) -> str:
        kinds = (' class="n"' if column < numbers else "" for column in range(len(cells)))
        return "".join(f"<{tag}{k}>{cell}</{tag}>" for k, cell in zip(kinds, cells, strict=True))

    body = "".join(f"<tr>{line('td', row)}</tr>" for row in rows)
    return f"<table><tr>{line('th', head)}</tr>{body}</table>"


def _markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    escaped = ([cell.replace("|", "\\|") for cell in line] for line in lines)
    return "\n".join(f"| {' | '.join(line)} |" for line in escaped)


def _counted(failures: Counter[str]) -> str:
    return ", ".join(f"{code} {count}" for code, count in failures.most_common(4))


def _bar(rate: SuccessRate) -> str:
    """Bar of a success rate with its interval, as SVG."""
    low, high = rate.interval
    width = 240
    return (
        f'<svg class="bar" viewBox="0 0 {width} 14" width="{width}" height="14" role="img" '
        f'aria-label="{100 * rate.value:.1f} percent">'
        f'<rect width="{width}" height="14" fill="{_BAD}" opacity=".25"/>'
        f'<rect width="{width * rate.value:.1f}" height="14" fill="{_GOOD}"/>'
        f'<line x1="{width * low:.1f}" x2="{width * high:.1f}" y1="7" y2="7" stroke="#111" '
        'stroke-width="2"/></svg>'
    )


def _shown(value: Cell, *, exact: bool = False) -> str:
    if isinstance(value, bool) or value is None:
        return "true" if value else "" if value is None else "false"
    if isinstance(value, float):
        return repr(value) if exact else f"{value:.4g}"
    return str(value)


def _is_number(value: Cell) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


# Charts.


def success_charts(
    table: pa.Table, cells: Sequence[CellRate], boundary: Boundary | None = None
) -> list[Figure]:
    """Success over the parameters that vary: a curve, a heat map or points."""
    columns = _Columns.of(table)
    numeric = [
        name for name, values in columns.params.items() if all(_is_number(one) for one in values)
    ]
    if len(cells) < 2 or not numeric:
        return []
    if len(numeric) >= 2 and (len(cells) > MOST_CELLS or boundary is not None):
        return [_scatter(columns, pair, boundary) for pair in _pairs(numeric)[:3]]
    figures = []
    if len(numeric) >= 2:
        figures.append(_heat_map(columns, numeric[0], numeric[1]))
    figures += [_curve(columns, name) for name in numeric[:3]]
    return figures


def _pairs(names: Sequence[str]) -> list[tuple[str, str]]:
    return [(a, b) for number, a in enumerate(names) for b in names[number + 1 :]]


def _axes(width: float, height: float) -> tuple[Figure, Axes]:
    # Figures without pyplot: pyplot keeps every figure until it is closed.
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots()
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=_INK)
    return figure, axes


def _curve(columns: _Columns, name: str) -> Figure:
    """Success over one parameter, a line per reality; many values are grouped."""
    figure, axes = _axes(6.4, 3.0)
    values = np.array(columns.params[name], float)
    realities = columns.params.get("reality", [""] * len(values))
    unique = np.unique(values)
    edges = unique if len(unique) <= 25 else np.quantile(values, np.linspace(0, 1, _BINS + 1))
    for reality in dict.fromkeys(realities):
        chosen = np.array([one == reality for one in realities])
        points, rates = [], []
        for number, low in enumerate(edges):
            if len(unique) <= 25:
                inside = chosen & (values == low)
            elif number == len(edges) - 1:
                continue
            else:
                last = number == len(edges) - 2
                below = values <= edges[number + 1] if last else values < edges[number + 1]
                inside = chosen & (values >= low) & below
            if inside.any():
                points.append(float(values[inside].mean()))
                rates.append(SuccessRate(int(columns.success[inside].sum()), int(inside.sum())))
        middle = np.array([rate.value for rate in rates])
        spans = np.array([rate.interval for rate in rates])
        axes.errorbar(
            points, 100 * middle, 100 * np.abs(spans.T - middle), marker="o", capsize=3,
            label=str(reality) or None,
        )  # fmt: skip
    axes.set(xlabel=name, ylabel="success [%]", ylim=(-3, 103))
    axes.grid(alpha=0.3)
    if len(set(realities)) > 1:
        axes.legend(frameon=False)
    return figure


def _heat_map(columns: _Columns, across: str, up: str) -> Figure:
    """Success over two parameters."""
    x, y = np.array(columns.params[across], float), np.array(columns.params[up], float)
    xs, ys = np.unique(x), np.unique(y)
    column, row = np.searchsorted(xs, x), np.searchsorted(ys, y)
    good = np.zeros((len(ys), len(xs)))
    count = np.zeros_like(good)
    np.add.at(good, (row, column), columns.success)
    np.add.at(count, (row, column), 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        rate = 100 * good / count
    figure, axes = _axes(6.4, 4.2)
    image = axes.imshow(rate, origin="lower", aspect="auto", vmin=0, vmax=100, cmap="RdYlGn")
    axes.set_xticks(range(len(xs)), [f"{v:.4g}" for v in xs], rotation=45 if len(xs) > 8 else 0)
    axes.set_yticks(range(len(ys)), [f"{v:.4g}" for v in ys])
    axes.set(xlabel=across, ylabel=up)
    if rate.size <= 150:
        for i, j in np.ndindex(rate.shape):
            if count[i, j]:
                axes.text(j, i, f"{rate[i, j]:.0f}", ha="center", va="center", fontsize=8)
    figure.colorbar(image, label="success [%]")
    return figure


def _scatter(columns: _Columns, names: tuple[str, str], boundary: Boundary | None) -> Figure:
    """Successes and failures over two parameters, of at most 5,000 trials."""
    x, y = (np.array(columns.params[name], float) for name in names)
    shown = np.linspace(0, len(x) - 1, min(len(x), 5000)).astype(int)
    figure, axes = _axes(6.4, 4.2)
    for good, color, label in ((True, _GOOD, "success"), (False, _BAD, "no success")):
        chosen = shown[columns.success[shown] == good]
        axes.scatter(x[chosen], y[chosen], s=12, c=color, label=label, alpha=0.7, linewidths=0)
    if boundary is not None and set(boundary.names) == set(names) and boundary.points:
        points = np.array(boundary.points)[:, [boundary.names.index(name) for name in names]]
        axes.scatter(
            points[:, 0], points[:, 1], s=16, facecolors="none", edgecolors=_INK, label="boundary"
        )
    axes.set(xlabel=names[0], ylabel=names[1])
    axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(1, 1))
    return figure


def _histograms(metrics: Sequence[MetricSummary]) -> Figure:
    from matplotlib.figure import Figure

    rows = math.ceil(len(metrics) / 3)
    figure = Figure(figsize=(9.6, 2.0 * rows), layout="constrained")
    grid = figure.subplots(rows, 3, squeeze=False).ravel()
    for axes, metric in zip(grid, metrics, strict=False):
        axes.hist(
            metric.values, bins=min(40, max(5, int(len(metric.values) ** 0.5))), color="#4878a8"
        )
        axes.set_title(metric.name, fontsize=8, color=_INK, wrap=True)
        axes.tick_params(labelsize=7)
        axes.spines[["top", "right"]].set_visible(False)
    for axes in grid[len(metrics) :]:
        axes.set_visible(False)
    return figure


def _image(figure: Figure) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    content = base64.b64encode(buffer.getvalue()).decode()
    return f'<img alt="chart" src="data:image/png;base64,{content}">'


_STYLE: Final = (
    "body{font:15px/1.5 system-ui,sans-serif;margin:0;background:#f4f6f8;color:#1d2733}"
    "main{max-width:1080px;margin:0 auto;padding:24px 32px 48px;background:#fff}"
    "h1{font-size:24px;margin:0 0 4px}h2{font-size:18px;margin:32px 0 8px}"
    ".headline{font-size:18px;margin:8px 0}.headline b{font-size:34px;margin-right:6px}"
    ".headline span{color:#5b6875;margin-left:10px;font-size:14px}"
    ".note{background:#fff6df;border-left:4px solid #d9a400;padding:6px 12px}"
    "table{border-collapse:collapse;font-size:13px;width:100%;margin:8px 0}"
    "th{text-align:left;color:#5b6875;border-bottom:2px solid #dde3e9;padding:4px 8px}"
    "td{border-bottom:1px solid #e8ecf0;padding:5px 8px;vertical-align:top}"
    "td.n,th.n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}"
    ".how{max-width:280px;overflow-wrap:anywhere}"
    "code{font:12px/1.4 ui-monospace,monospace;background:#f0f3f6;padding:1px 4px}"
    "img{max-width:100%;display:block;margin:8px 0}.bar{vertical-align:middle;border-radius:3px}"
    "small{color:#5b6875}summary{cursor:pointer;color:#5b6875}"
    "footer{margin-top:32px;color:#5b6875;font-size:12px;overflow-wrap:anywhere}"
)


def _options(folder: Path) -> list[str]:
    """Options of ``bt-run`` that all trials in a folder have in common."""
    try:
        content = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return []
    found = [] if content.get("duration") is None else ["--duration", f"{content['duration']:g}"]
    for skills in content.get("skills", ()):
        found += ["--skills", skills]
    if (folder / FAULTS).is_file():
        found += ["--faults", str(folder / FAULTS)]
    return found


def title_of(folder: Path) -> str:
    """Title of the sweep in an output folder, from its manifest."""
    try:
        content = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        return str(content["tree"])[:200]
    except (OSError, ValueError, KeyError, TypeError):
        return folder.name
