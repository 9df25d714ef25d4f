"""A record as one page: scene, slider, trees and reasons; it opens from disk, without network."""

from __future__ import annotations

import json
from collections.abc import Iterator

from bt_dualarm.replay.page_scene import PageScene
from bt_dualarm.replay.record import Facts, Record
from bt_dualarm.replay.story import stories
from bt_dualarm.replay.story_text import state_of, story_text
from bt_dualarm.replay.timeline import Node, Timeline
from bt_dualarm.share import share_dir

_PLACE = "DATA_OF_THE_RECORD"
_SCRIPT = "SCRIPT_OF_THE_SCENE"


def html_of(record: Record) -> str:
    """The page of a record.

    Raises:
        ReplayError: The record has no state, or this MuJoCo cannot read its models.
    """
    # In a script nothing but its end tag is looked for.
    return page_with_scene("replay.html").replace(
        _PLACE, json.dumps(page_data(record)).replace("<", "\\u003c")
    )


def page_with_scene(name: str) -> str:
    """A shipped page with the script in it that draws scenes."""
    pages = share_dir("assets") / "pages"
    script = (pages / "scene.js").read_text(encoding="utf-8")
    return (pages / name).read_text(encoding="utf-8").replace(_SCRIPT, script)


def page_data(record: Record) -> Facts:
    """All that the page shows, ready for JSON."""
    scene = PageScene.of(record)
    told = stories(record)
    begin = min((story.ended_s for story in told if story.ended_s is not None), default=0.0)
    return {
        **vars(scene),
        "name": record.name,
        "facts": state_of(record),
        "until": round(record.until, 4),
        "begin": round(begin, 4),
        "trees": [_tree(record, root) for root in Timeline(record).roots.values()],
        "keys": [
            [note["time_s"], note["arm"], note["leaf"], note["key"], json.dumps(note["value"])]
            for note in record.notes
            if note["kind"] == "wrote"
        ],
        "why": "\n\n".join(map(story_text, told)),
    }


def _tree(record: Record, root: Node) -> Facts:
    robot = record.arms[root.arm]["robot"]
    return {"arm": root.arm, "robot": robot, "nodes": [*_nodes(root, 0)]}


def _nodes(node: Node, depth: int) -> Iterator[Facts]:
    changes = [
        [change.time, change.new, f"{change.code}: {change.reason}" if change.code else ""]
        for change in node.changes
    ]
    yield {
        "depth": depth,
        "name": node.path.rpartition("/")[2],
        "kind": node.kind,
        "place": node.place,
        "changes": changes,
    }
    for child in node.children:
        yield from _nodes(child, depth + 1)
