"""What an arm and its camera did in the second before a leaf ended, in sentences."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bt_dualarm.replay.evidence import LOOK_BACK_S, Evidence


def second_before(e: Evidence) -> Iterator[str]:
    """Sentences on arm, guard, camera and contacts, in this order."""
    since = max(e.ended - LOOK_BACK_S, 0.0)
    yield from _arm(e, since)
    yield from _guard(e)
    yield from _camera(e, since)
    touched = {touch.other for scene in e.moments(10, since) for touch in scene.touches(e.arm)}
    if touched:
        yield f"it touched {', '.join(sorted(touched))}"


def _arm(e: Evidence, since: float) -> Iterator[str]:
    record = e.record
    first, last = record.index_at(since), record.index_at(e.ended)
    rows = [row for index in range(first, last + 1) if (row := record.arm_row(e.arm, index))]
    tools = [e.scene(time).tool(e.arm) for time in (since, e.ended)]
    if not rows or tools[0] is None or tools[1] is None:
        yield f"{e.arm} was not in the world"
        return
    speed = np.degrees(max(float(np.abs(row[1]).max()) for row in rows))
    torque = max(float(np.abs(row[3]).max()) for row in rows)
    moved = 1e3 * float(np.linalg.norm(tools[1] - tools[0]))
    place = ", ".join(f"{x:.3f}" for x in tools[1])
    yield (
        f"the tool moved by {moved:.0f} mm, to ({place}) m; "
        f"set-points went at up to {speed:.0f}°/s, motors gave up to {torque:.0f} N m"
    )


def _guard(e: Evidence) -> Iterator[str]:
    for note in e.notes("guard", since=e.began, until=e.ended + 0.05)[-3:]:
        yield f"at {note['time_s']:.2f} s its guard {note['does']} it: {note['reason']}"


def _camera(e: Evidence, since: float) -> Iterator[str]:
    frames = e.notes("frame", since=since, until=e.ended)
    looks = e.notes("look", since=since, until=e.ended)
    if not frames:
        return
    seen = [look for look in looks if look["pixel"]]
    sentence = f"its camera took {len(frames)} pictures; the target was found in {len(seen)}"
    if seen:
        (x, y), area = seen[-1]["pixel"], seen[-1]["area_px"]
        sentence += f", last at {seen[-1]['stamp']:.2f} s, pixel ({x:.0f}, {y:.0f}), {area:.0f} px²"
    yield sentence
