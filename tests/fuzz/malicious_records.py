# ruff: noqa: E501 - tables
"""Malicious records, each with a single manipulation."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from bt_dualarm.runtime.history_file import MAGIC
from tests.fuzz.record_mutation import ESCAPES, Files, Part, as_json, framed

Edit = Callable[[Files], object]

PATHS: Final = ("x/../../../pwned", "../../pwned", "/tmp/pwned", "..", "a\0b", "a\nb", "-rf", "")  # noqa: S108


def _renamed(name: str) -> Edit:
    """Renames an arm wherever its name occurs."""

    def edit(files: Files) -> None:
        start = files.start
        start["arms"] = {
            (name if arm == "arm1" else arm): facts for arm, facts in start["arms"].items()
        }
        for part in files.history[1:]:
            for note in part.data.get("notes", ()):
                note["arm"] = name if note["arm"] == "arm1" else note["arm"]
            if "arm:arm1" in part.arrays:
                part.arrays[f"arm:{name}"] = part.arrays.pop("arm:arm1")
        files.events = [
            {**event, "arm": name if event["arm"] == "arm1" else event["arm"]}
            for event in files.events
        ]

    return edit


def _start(**facts: Any) -> Edit:
    return lambda files: files.start.update(facts)


def _arm(**facts: Any) -> Edit:
    return lambda files: files.start["arms"]["arm1"].update(facts)


def _without(key: str) -> Edit:
    return lambda files: files.start.pop(key)


def _event(**facts: Any) -> Edit:
    def edit(files: Files) -> None:
        *events, last = files.events
        failed = next(event for event in files.events if event["new"] == "FAILURE")
        events = [{**event, **(facts if event == failed else {})} for event in [*events, last]]
        files.events = events

    return edit


def _note(**facts: Any) -> Edit:
    return lambda files: files.second().data["notes"][0].update(facts)


def _summary(**facts: Any) -> Edit:
    def edit(files: Files) -> None:
        files.summary = {**files.summary, **facts}

    return edit


def _file(name: str, content: Any) -> Edit:
    return lambda files: files.others.update({name: content})


def _link(name: str, target: str) -> Edit:
    return _file(name, lambda path: Path(path).symlink_to(target))


def _array(name: str, change: Callable[[Any], Any]) -> Edit:
    def edit(files: Files) -> None:
        arrays = files.second().arrays
        arrays[name] = change(arrays[name].copy())

    return edit


def _set(row: int, column: int, value: float) -> Callable[[Any], Any]:
    def change(array: Any) -> Any:
        array[row, column] = value
        return array

    return change


def _declared(name: str, **facts: Any) -> Edit:
    """Declares an array with properties that differ from its content."""

    def edit(files: Files) -> None:
        part = files.second()
        array = part.arrays[name]
        how = {"dtype": array.dtype.str, "shape": [*array.shape], "size": 10}
        part.declared[name] = {**how, **facts}

    return edit


def _deep(depth: int) -> bytes:
    return b"[" * depth + b"]" * depth


def _tree(depth: int, width: int = 1) -> Any:
    node: Any = {"kind": "wait", "name": "w", "ports": {}, "place": "x:1", "children": []}
    for _ in range(depth):
        node = {**node, "kind": "sequence", "children": [node] * width}
    return node


def _bomb(files: Files) -> None:
    """A small block that declares two hundred arrays of 32 MiB each."""
    plain = zlib.compress(bytes(1 << 25), 9)
    head = {
        "kind": "second",
        "data": files.second().data,
        "arrays": {
            f"a{number}": {"dtype": "|u1", "shape": [1 << 25], "size": len(plain)}
            for number in range(200)
        },
    }
    text = zlib.compress(as_json(head))
    body = struct.pack("<I", len(text)) + text + plain * 200
    files.raw["run.history"] = lambda content: content + framed(body)
    files.others["run.history"] = MAGIC + files.history[0].encoded()


def _text_bomb(files: Files) -> None:
    """A head that is small when compressed and contains 60 MB of brackets."""
    text = zlib.compress(
        b'{"kind":"second","arrays":{},"data":{"x":[' + b"{}," * 20_000_000 + b"{}]}}", 9
    )
    files.others["run.history"] = (
        MAGIC + files.history[0].encoded() + framed(struct.pack("<I", len(text)) + text)
    )


def _sparse(path: Path) -> None:
    """A sparse file of a terabyte."""
    path.write_bytes(MAGIC)
    os.truncate(path, 1 << 40)


def _many_lines(files: Files) -> None:
    files.others["events.jsonl"] = as_json(files.events[0]) + b"\n"
    files.raw["events.jsonl"] = lambda line: line * 100_000


def _many_models(files: Files) -> None:
    model = next(part for part in files.history if part.kind == "model")
    for number in range(1, 200):
        files.history.insert(
            2, Part("model", {**model.data, "generation": number}, {"rest": model.arrays["rest"]})
        )


def _model(**fields: int) -> Edit:
    """Replaces the first element of some fields of the model."""

    def edit(files: Files) -> None:
        import mujoco

        model = files.model
        for name, value in fields.items():
            getattr(model, name).reshape(-1)[0] = value
        content = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, content)
        files.model_bytes = content.tobytes()

    return edit


def _model_word(at: int, value: int) -> Edit:
    def edit(files: Files) -> None:
        content = bytearray(files.model_bytes)
        content[at : at + 4] = struct.pack("<i", value)
        files.model_bytes = bytes(content)

    return edit


def _cuts(*cuts: Any) -> Edit:
    return lambda files: next(part for part in files.history if part.kind == "model").data.update(
        cuts=[*cuts]
    )


def _frame(**facts: Any) -> Edit:
    return lambda files: files.frames[0].data.update(facts)


def _huge_frame(files: Files) -> None:
    """A JPEG whose header declares 65,000 by 65,000 pixels."""
    content = bytearray(cv2.imencode(".jpg", np.zeros((8, 8, 3), np.uint8))[1].tobytes())
    at = content.index(b"\xff\xc0")
    content[at + 5 : at + 9] = struct.pack(">HH", 65_000, 65_000)
    files.frames[0].arrays["jpeg"] = np.frombuffer(bytes(content), np.uint8)


def _no_jpeg(files: Files) -> None:
    files.frames[0].arrays["jpeg"] = np.frombuffer(b"GIF89a" + bytes(50), np.uint8)


MALICIOUS: Final[dict[str, Edit]] = {
    **{f"an arm named {name!r}": _renamed(name) for name in PATHS},
    "an arm named with escapes": _renamed(ESCAPES),
    "an arm named as a formula": _renamed("=cmd|' /C calc'!A0"),
    "a tree named with escapes": _start(name=ESCAPES),
    "a tree named as a path": _start(name="../../pwned"),
    "a tree named by lines": _start(name="a\nerror: you have been hacked"),
    "no arms": _start(arms={}),
    "no name": _without("name"),
    "no texts": _start(texts={}),
    "texts that are a list": _start(texts=["a"]),
    "texts of a device": _start(texts={"/dev/zero": "bt_dualarm: 1"}),
    "included texts of devices": lambda files: files.start["texts"].update({"/dev/zero": "", "/dev/stdin": ""}),
    "skills in devices": _start(skills={"wait": {"file": "/dev/zero", "sha256": "0"}, "set": {"file": "/dev/stdin", "sha256": "0"}}),
    "pages in devices": _start(pages={"/dev/zero": "0", "../../../../dev/stdin": "0"}),
    "skills without a file": _start(skills={"wait": {}}),
    "skills of an unknown name": _start(skills={"rm -rf": {"file": "/etc/passwd", "sha256": "0"}}),
    "a path in a device": _start(path="/dev/zero/x.yaml"),
    "a path with a null": _start(path="a\0b"),
    "a path at the top": _start(path="/"),
    "no time in a step": _start(timestep=0.0),
    "steps backwards": _start(timestep=-0.002),
    "a step of a year": _start(timestep=3e7),
    "a seed that is text": _start(seed="0"),
    "a seed beyond all": _start(seed=10**30),
    "another renderer": _start(renderer="x" * 1000),
    "a reality of lists": _start(reality={"arm1": [[[]]]}),
    "a duration without end": _start(duration=float("inf")),
    "no processor": _start(processor=None),
    "versions of lists": _start(versions={"mujoco": ["4"]}),
    "objects that are none": _start(objects={"ball": 3}),
    "objects named as paths": _start(objects={"../x": {}}),
    "parameters that the tree does not know": _start(params={"x": [1] * 100, ESCAPES: 1}),
    "a robot in a device": _arm(robot="/dev/zero"),
    "a robot named with escapes": _arm(robot=ESCAPES),
    "a robot far up": _arm(robot="../../../../etc/passwd.yaml"),
    "a gripper in a device": _arm(gripper="/dev/zero.yaml"),
    "a base that is nowhere": _arm(base={"xyz": [float("nan"), 0, 0]}),
    "a camera of a gigapixel": _arm(camera={"mount": "wrist", "resolution": [100_000, 100_000], "fov": 50.0}),
    "a camera without size": _arm(camera={"mount": "wrist"}),
    "a force limit of text": _arm(force_limit="much"),
    "a tree of a thousand levels": _arm(tree=_tree(90)),
    "a tree of a million nodes": _arm(tree=_tree(6, 7)),
    "a tree that is none": _arm(tree=[]),
    "a node named as a path": lambda files: files.start["arms"]["arm1"]["tree"].update(name="../../x"),
    "a node named with escapes": lambda files: files.start["arms"]["arm1"]["tree"].update(name=ESCAPES),
    "ports of anything": lambda files: [
        node.update(ports={"object": {"a": []}, "color": [1], "size": "x", "to": {"xyz": "abc"}, "speed": None})
        for node in files.start["arms"]["arm1"]["tree"]["children"]
    ],
    "a reason with escapes": _event(reason=f"it is {ESCAPES}\n\nerror: no"),
    "a reason with markup": _event(reason="[bold red]x[/bold red] [/] <script>alert(1)</script>"),
    "a reason that is a formula": _event(reason='=HYPERLINK("http://x","y")'),
    "a code in small letters": _event(code="a b"),
    "a path of formulas": _event(path="=1+1/@x"),
    "an event of another arm": _event(arm="nobody"),
    "an event at no time": _event(time_s=float("nan")),
    "an event before all others": _event(time_s=-1.0),
    "an event of another status": _event(new="EXPLODED"),
    "an event that ended before it began": _event(old="RUNNING", new="SUCCESS"),
    "numbers of an event that are texts": _event(metrics=dict.fromkeys(["reach_m", "distance_m", "residual_m", "force_n", "moved_m", "second", "first", "saturated", "grasps"], ESCAPES)),
    "numbers of an event that are huge": _event(metrics=dict.fromkeys(["reach_m", "distance_m", "saturated"], 1e308)),
    "numbers of an event that are none": _event(metrics={"reach_m": None, "distance_m": None}),
    "no numbers of an event": _event(metrics=None),
    "every code": lambda files: setattr(files, "events", [{**event, "new": "FAILURE", "code": code, "old": "RUNNING", "reason": "x"} for event in files.events for code in ("OUT_OF_REACH", "FORCE_LIMIT", "COLLISION", "NOT_SEEN", "OVERLOADED", "TOO_WIDE", "NO_VALUE", "TRACKING_ERROR", "NO_CONTACT", "TIMED_OUT", "BUSY")]),
    "events that are lists": _file("events.jsonl", b"[1]\n[2]\n"),
    "events of deep lists": _file("events.jsonl", _deep(100_000) + b"\n"),
    "events without end": _many_lines,
    "a note of no kind": _note(kind=None),
    "a note of an unknown kind": _note(kind="x/../../y"),
    "a note of another arm": _note(arm="../x"),
    "a note at no time": _note(time_s=None),
    "a note of a look without a picture": _note(kind="look", stamp=0.0, pixel=[1], area_px=-1.0, point=[], locked=0),
    "a note of an edit": _note(kind="edited", tree={"kind": "x"}),
    "a note of a deep edit": _note(kind="edited", tree=_tree(80)),
    "a note of a key with escapes": _note(kind="wrote", leaf="sequence", key=ESCAPES, value=ESCAPES),
    "a note of answers": _note(kind="found", stamp=0.0, asked="x", answer=[[], {}, "x"]),
    "a summary of a list": _file("summary.json", b"[]"),
    "a summary of deep lists": _file("summary.json", _deep(100_000)),
    "a summary of arms named as paths": _summary(arms={"../../x": {}}),
    "a summary without an end": _summary(ending=None),
    "a summary with a guard of text": _summary(arms={"arm1": {"guard": {"saturated": "x"}}}),
    "a summary of no number": _file("summary.json", b'{"ending": NaN}'),
    "a history in a device": _link("run.history", "/dev/zero"),
    "a summary in a device": _link("summary.json", "/dev/zero"),
    "events in a device": _link("events.jsonl", "/dev/urandom"),
    "pictures in a device": _link("run.frames", "/dev/zero"),
    "a history in a pipe": _file("run.history", os.mkfifo),
    "events in a pipe": _file("events.jsonl", os.mkfifo),
    "a summary in a pipe": _file("summary.json", os.mkfifo),
    "pictures in a pipe": _file("run.frames", os.mkfifo),
    "a history that is a folder": _file("run.history", Path.mkdir),
    "a history that leads to itself": _file("run.history", lambda path: path.symlink_to(path)),
    "a history elsewhere": _link("run.history", "/etc/passwd"),
    "a sparse history": _file("run.history", _sparse),
    "a bomb of arrays": _bomb,
    "a bomb of text": _text_bomb,
    "two hundred models": _many_models,
    "an array that says to be huge": _declared("states", shape=[1 << 20, 1 << 20]),
    "an array of negative shape": _declared("states", shape=[-1, -44]),
    "an array of objects": _declared("states", dtype="|O"),
    "an array of text": _declared("states", dtype="<U1000000"),
    "an array of fields": _declared("states", dtype=[["a", "<f8"]]),
    "an array of minus ten bytes": _declared("states", size=-10),
    "an array of no bytes": _declared("states", size=0),
    "a state that is no number": _array("states", _set(0, 3, np.nan)),
    "a state beyond the world": _array("states", _set(1, 3, 1e300)),
    "times without end": _array("states", _set(-1, 0, 1e12)),
    "times that go back": _array("states", lambda array: array[::-1]),
    "states of another world": _array("states", lambda array: array[:, :5]),
    "states of one number": _array("states", lambda array: array[:, 0]),
    "fewer states than rows": _array("states", lambda array: array[:3]),
    "set-points that are not numbers": _array("arm:arm1", _set(0, 0, np.inf)),
    "set-points of half a joint": _array("arm:arm1", lambda array: array[:, :7]),
    "set-points of too many joints": _array("arm:arm1", lambda array: np.tile(array, (1, 4))),
    "set-points without joints": _array("arm:arm1", lambda array: array[:, :0]),
    "rows beyond the steps": _array("rows", lambda array: array + 10**6),
    "no checksums": _array("checksums", lambda array: array[:0]),
    "a model of nothing": lambda files: setattr(files, "model_bytes", b""),
    "a model of noise": lambda files: setattr(files, "model_bytes", bytes(range(256)) * 4000),
    "a model of many bodies": _model_word(20 + 8 * 6, 2**31 - 1),
    "a model that is half": lambda files: setattr(files, "model_bytes", files.model_bytes[:5000]),
    "a model of another MuJoCo": _model_word(8, 999),
    "a joint of another kind": _model(jnt_type=77),
    "a mesh that begins elsewhere": _model(mesh_vertadr=2**30),
    "a mesh of other faces": _model(mesh_face=10_000_000),
    "a shape of no mesh": _model(geom_dataid=2**30, geom_type=7),
    "a body that hangs on itself": _model(body_parentid=5),
    "a motor of another joint": _model(actuator_trnid=2**20),
    "a tree of other lengths": _model(tree_dofnum=2**30),
    "a name beyond all names": _model(name_bodyadr=2**30),
    "cuts that overlap": _cuts([0, 10, "x"], [5, 20, "x"]),
    "cuts backwards": _cuts([100, 5, "x"]),
    "cuts of text": _cuts("abc"),
    "no model": lambda files: files.history.pop(1),
    "a model twice": lambda files: files.history.insert(1, files.history[1]),
    "no start": lambda files: files.history.pop(0),
    "a start twice": lambda files: files.history.insert(1, files.history[0]),
    "seconds in another order": lambda files: files.history.reverse(),
    "a picture of another arm": _frame(arm="../x"),
    "a picture of no region": _frame(region=[0, 0, 0, 0]),
    "a picture of a huge image": _frame(size=[10**6, 10**6]),
    "a picture of negative strides": _frame(stride=-1),
    "a picture that unpacks to gigabytes": _huge_frame,
    "a picture that is none": _no_jpeg,
}  # fmt: skip
