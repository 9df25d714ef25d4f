"""The report of the experiments: one HTML file with all in it, and Markdown with its pictures."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import BinaryIO

from bt_dualarm.experiments.figures import over_time, overlay, png
from bt_dualarm.experiments.results import Result
from bt_dualarm.runtime.atomic_write import write_atomically, write_text

HEADER = (
    "experiment", "controller", "renderer", "RMS [mm]", "max [mm]", "bound [mm]", "lag [ms]",
    "amplitude", "lost", "images", "sighting sd [mm]", "joint margin [°]", "peak velocity",
    "peak acceleration",
)  # fmt: skip

EXPLANATION = (
    "Error: distance of the following tool from the true cube in the plane at equal times, "
    "less their mean offset, from the first to the last moment of the leading arm's curve; the "
    "follower knows its camera and its joints only. RMS and maximum over all seeds, the others "
    "are means. Bound: for proportional control the lag at the highest gain that is stable at "
    "all, 2/π · v · (latency + half a frame); for predictive control the error of the same filter "
    "fed with true positions and white noise of the measured deviation of a sighting, through the "
    "same latency. Amplitude: spread of the tracked path over that of the true one. Images: how "
    "many the follower moved by, its effective waypoints. Margin: distance to a joint's limit; "
    "peaks: measured, as shares of the limits; each the worst of all joints, times and seeds. The "
    "limits are kept by what is sent; a measured acceleration passes its own for moments, which is "
    "above 100 %, where that of the set-points changes suddenly."
)


def row(result: Result) -> tuple[str, ...]:
    """A result as texts, in the order of `HEADER`."""
    cell, margins = result.cell, [trial.margins for trial in result.trials]
    return (
        cell.name,
        cell.controller,
        cell.renderer,
        f"{1e3 * result.rms:.2f}",
        f"{1e3 * result.worst:.2f}",
        f"{1e3 * result.bound:.2f}",
        f"{1e3 * result.mean('lag'):.1f}",
        f"{result.mean('amplitude_ratio'):.3f}",
        f"{sum(trial.lost_count for trial in result.trials)}",
        f"{result.mean('frames'):.0f}",
        f"{1e3 * result.mean('sighting_sd'):.3f}",
        f"{57.29578 * min(m.position_rad for m in margins):.0f}",
        f"{max(m.velocity for m in margins):.0%}",
        f"{max(m.acceleration for m in margins):.0%}",
    )


def write_report(folder: Path, results: Sequence[Result]) -> None:
    """Write ``report.html``, ``report.md`` and the pictures that the latter shows.

    Args:
        folder: Place of the report; made if it is not there.
        results: Results in the order of the table, at least one; those of the same case and
            renderer are drawn together.

    Raises:
        OSError: The folder cannot be written to.
    """
    folder.mkdir(parents=True, exist_ok=True)
    pictures: list[tuple[str, bytes]] = []
    for title, group in _groups(results):
        name = re.sub(r"\W+", "_", title)
        pictures += [
            (f"{name}_plane.png", png(overlay(group))),
            (f"{name}_time.png", png(over_time(group))),
        ]
    for name, content in pictures:
        write_atomically(folder / name, partial(_put, content))
    write_text(folder / "report.md", _markdown(results, [name for name, _ in pictures]))
    write_text(folder / "report.html", _html(results, pictures))


def _put(content: bytes, file: BinaryIO) -> None:
    file.write(content)


def _groups(results: Sequence[Result]) -> Iterator[tuple[str, list[Result]]]:
    found: dict[str, list[Result]] = {}
    for result in results:
        found.setdefault(f"{result.cell.name}, {result.cell.renderer}", []).append(result)
    yield from found.items()


def _commands(results: Sequence[Result]) -> Iterator[str]:
    yield from (result.cell.command(result.trials[0].seed) for result in results)


def _seeds(results: Sequence[Result]) -> str:
    seeds = sorted({trial.seed for result in results for trial in result.trials})
    return "Seeds: " + ", ".join(map(str, seeds)) + "."


def _markdown(results: Sequence[Result], pictures: Sequence[str]) -> str:
    lines = ["# Tracking experiments", "", EXPLANATION, "", _seeds(results), ""]
    lines += ["| " + " | ".join(HEADER) + " |", "|" + "---|" * len(HEADER)]
    lines += ["| " + " | ".join(row(result)) + " |" for result in results]
    lines += ["", *(f"![{name}]({name})" for name in pictures)]
    lines += ["", "## Every row by hand", "", "```text", *_commands(results), "```", ""]
    return "\n".join(lines)


_STYLE = (
    "body{font:15px/1.5 sans-serif;max-width:1150px;margin:2em auto;padding:0 1em}"
    "table{border-collapse:collapse;font-size:13px}td,th{border:1px solid #ccc;padding:3px 7px;"
    "text-align:right}td:first-child,td:nth-child(2),td:nth-child(3){text-align:left}"
    "img{max-width:100%}pre{background:#f4f4f4;padding:1em;white-space:pre-wrap;font-size:12px}"
)


def _html(results: Sequence[Result], pictures: Sequence[tuple[str, bytes]]) -> str:
    def line(tag: str, texts: Sequence[str]) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(text)}</{tag}>" for text in texts) + "</tr>"

    images = "".join(
        f'<p><img alt="{html.escape(name)}" '
        f'src="data:image/png;base64,{base64.b64encode(content).decode()}"></p>'
        for name, content in pictures
    )
    rows = "".join(line("td", row(result)) for result in results)
    commands = html.escape("\n".join(_commands(results)))
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>Tracking experiments</title>'
        f"<style>{_STYLE}</style><h1>Tracking experiments</h1><p>{html.escape(EXPLANATION)}</p>"
        f"<p>{_seeds(results)}</p><table>{line('th', HEADER)}{rows}</table>{images}"
        f"<h2>Every row by hand</h2><pre>{commands}</pre></html>\n"
    )
