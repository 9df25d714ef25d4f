"""A story as text for a terminal: the cause first, then what it is known by."""

from __future__ import annotations

import json
from collections.abc import Iterator

from bt_dualarm.replay.record import Facts, Record
from bt_dualarm.replay.story import Story
from bt_dualarm.spec.wording import escaped

_MOST_NUMBERS = 12


def story_text(story: Story) -> str:
    """All of a story, several lines; text of the record cannot begin a line of its own."""
    return "\n".join(escaped(line, keep="") for line in _lines(story))


def _lines(story: Story) -> Iterator[str]:
    when = f"{story.status} at {story.at_s:.2f} s"
    if story.ended_s is None:
        when = f"ran at {story.at_s:.2f} s, for {story.at_s - story.began_s:.2f} s"
    code = f" {story.code}" if story.code and story.code != story.status else ""
    yield f"{story.arm}: {story.leaf} ({story.place}) {when}{code}"
    for number, cause in enumerate(story.causes):
        mark = "why" if number == 0 else "also"
        yield f"  {mark}: {cause.sentence}"
        if cause.remedy:
            yield f"       to change: {cause.remedy}"
    if story.reason and all(story.reason not in cause.sentence for cause in story.causes):
        yield f"  it said: {story.reason}"
    yield "  chain:"
    for depth, link in enumerate(story.chain):
        name = str(link["path"]).rpartition("/")[2]
        kind = "" if link["kind"] == name else f" [{link['kind']}]"
        yield f"    {'  ' * depth}{name}{kind} {link['status']}"
    yield from _values("ports", story.ports)
    for key in story.keys:
        writer = "nobody" if key["leaf"] is None else f"{key['leaf']} at {key['time_s']:.2f} s"
        yield f"  key {key['key']} = {_short(key['value'])}, written by {writer}"
    yield from _values("numbers", dict([*story.numbers.items()][:_MOST_NUMBERS]))
    if story.before:
        yield "  in the second before:"
        yield from (f"    {sentence}" for sentence in story.before)
    for other in story.others:
        yield f"  failed before, and passed over: {other}"


def _values(title: str, values: Facts) -> Iterator[str]:
    if values:
        yield f"  {title}:"
        yield from (f"    {name}: {_short(value)}" for name, value in values.items())


def _short(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= 100 else f"{text[:97]}..."


def state_of(record: Record) -> str:
    """One line on what the record is of, and whether all of it is there."""
    line = f"{record.name}, seed {record.start['seed']}, {record.until:.2f} s"
    if record.summary is None:
        line += "; the run was not ended in order"
    if record.torn:
        line += f"; of its history {record.torn}"
    return line
