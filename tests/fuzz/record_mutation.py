# ruff: noqa: E501 - tables
"""Mutations of records like those by attackers or broken disks."""

from __future__ import annotations

import copy
import json
import os
import random
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from bt_dualarm.runtime.history_file import MAGIC, Block, pack, read_history

ESCAPES: Final = "\x1b]0;owned\x07\x1b[2J\x1b[31m\x9b1m\u202e\x7f"
"""Escapes that must never reach a terminal: title, clearing, color, direction."""

VALUES: Final[tuple[Any, ...]] = (
    None, True, False, 0, -1, 1, 3.5, -0.0, 1e300, 1e-320, 2**31, 2**63, 10**40, float("nan"),
    float("inf"), "", "x", "x/../../../pwned", "../../pwned", "/root/pwned", "a\0b", ESCAPES, "=1+1",
    "@SUM(A1)", "+cmd|' /C calc'!A0", "\t=1", "[red]x[/red]", "[/]", "</script><b>", "\ud800", "é" * 50,
    "x" * 5000, "a\nb", [], {}, [1], [None], [[]], {"a": 1}, {"xyz": "x"}, {"xyz": [1, 2]},
    [1.0, 2.0, 3.0], ["a", "b"], "{goal}", "{", "SUCCESS", "RUNNING", "FAILURE", "arm1", "ball",
)  # fmt: skip
"""Invalid values for the facts of a record."""


@dataclass
class Part:
    """One block: its data, its arrays, and declared properties that replace the arrays' true ones."""

    kind: Any
    data: Any
    arrays: dict[str, Any]
    declared: dict[str, Any] = field(default_factory=dict)

    def encoded(self) -> bytes:
        """The block with a valid checksum."""
        packed = {
            name: pack(np.ascontiguousarray(array)) if isinstance(array, np.ndarray) else array
            for name, array in self.arrays.items()
        }
        head = {
            "kind": self.kind,
            "data": self.data,
            "arrays": {name: self.declared.get(name, how) for name, (how, _) in packed.items()},
        }
        text = zlib.compress(as_json(head))
        body = struct.pack("<I", len(text)) + text + b"".join(some for _, some in packed.values())
        return framed(body)


def framed(body: bytes) -> bytes:
    """A body as a block of a file, with a valid checksum."""
    return struct.pack("<4sII", b"BLCK", len(body), zlib.crc32(body)) + body


def as_json(data: object) -> bytes:
    """JSON of anything, including lone surrogates, infinity and NaN."""
    return json.dumps(data, separators=(",", ":")).encode("utf-8", "surrogatepass")


@dataclass
class Files:
    """A record as files: history and frames as blocks, the others as bytes.

    Attributes:
        history: Blocks of the history.
        frames: Blocks of the frames.
        others: Content of the other files by name; None removes a file, a function creates it.
        raw: Final changes of a file's bytes by its name, which cut, flip or append.
    """

    history: list[Part]
    frames: list[Part]
    others: dict[str, bytes | Callable[[Path], object] | None]
    raw: dict[str, Callable[[bytes], bytes]] = field(default_factory=dict)

    @classmethod
    def of(cls, folder: Path) -> Files:
        """The record in a folder."""
        parts = [
            [_part(block) for block in read_history(folder / name).blocks]
            if (folder / name).exists()
            else []
            for name in ("run.history", "run.frames")
        ]
        others = {name: (folder / name).read_bytes() for name in ("events.jsonl", "summary.json")}
        return cls(parts[0], parts[1], dict(others))

    def copy(self) -> Files:
        """A copy whose parts may be changed."""
        return copy.deepcopy(self)

    def write(self, folder: Path) -> None:
        """Writes the record to a new folder."""
        folder.mkdir(parents=True)
        contents: dict[str, Any] = dict(self.others)
        for name, parts in (("run.history", self.history), ("run.frames", self.frames)):
            if parts and name not in contents:
                contents[name] = MAGIC + b"".join(part.encoded() for part in parts)
        for name, content in contents.items():
            if callable(content):
                content(folder / name)
            elif content is not None:
                (folder / name).write_bytes(self.raw.get(name, _same)(content))

    def second(self, number: int = 0) -> Part:
        """The block of a second of the run."""
        return [part for part in self.history if part.kind == "second"][number]

    @property
    def start(self) -> Any:
        """Data of the first block."""
        return self.history[0].data

    @property
    def events(self) -> list[Any]:
        """Changes of status."""
        content = self.others["events.jsonl"]
        assert isinstance(content, bytes)
        return [json.loads(line) for line in content.splitlines()]

    @events.setter
    def events(self, events: list[Any]) -> None:
        self.others["events.jsonl"] = b"".join(as_json(event) + b"\n" for event in events)

    @property
    def summary(self) -> Any:
        """The summary."""
        content = self.others["summary.json"]
        assert isinstance(content, bytes)
        return json.loads(content)

    @summary.setter
    def summary(self, summary: Any) -> None:
        self.others["summary.json"] = as_json(summary)

    @property
    def model(self) -> mujoco.MjModel:
        """The first model."""
        return mujoco.MjModel.from_binary_path("m.mjb", {"m.mjb": self.model_bytes})

    @property
    def model_bytes(self) -> bytes:
        """The first model as MuJoCo writes it."""
        part = next(part for part in self.history if part.kind == "model")
        rest: bytes = part.arrays["rest"].tobytes()
        whole = b""
        at = 0
        taken = 0
        for start, end, digest in part.data["cuts"]:
            whole += rest[taken : taken + start - at] + part.arrays[digest].tobytes()
            taken += start - at
            at = end
        return whole + rest[taken:]

    @model_bytes.setter
    def model_bytes(self, content: bytes) -> None:
        part = next(part for part in self.history if part.kind == "model")
        part.data = {**part.data, "cuts": []}
        part.arrays = {"rest": np.frombuffer(content, np.uint8)}


def _part(block: Block) -> Part:
    return Part(block.kind, json.loads(json.dumps(block.data)), dict(block.arrays))


def _same(content: bytes) -> bytes:
    return content


def places(data: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths to all values in some JSON."""
    inner = (
        data.items()
        if isinstance(data, dict)
        else enumerate(data)
        if isinstance(data, list)
        else ()
    )
    return [at, *(place for key, value in inner for place in places(value, (*at, key)))]


def edited(data: Any, dice: random.Random) -> Any:
    """The same JSON with one value replaced, removed, renamed or duplicated."""
    data = copy.deepcopy(data)
    *above, last = dice.choice(places(data)[1:] or [("x",)])
    inner = data
    for key in above:
        inner = inner[key]
    value = copy.deepcopy(dice.choice(VALUES))
    change = dice.random()
    if not isinstance(inner, dict | list):
        return value
    if change < 0.6:
        inner[last] = value
    elif change < 0.8:
        del inner[last]
    elif isinstance(inner, list):
        inner.insert(last, value)
    else:
        inner[
            dice.choice(["x/../../../pwned", ESCAPES, "", "time_s", "kind", "=1", str(last) + "x"])
        ] = inner.pop(last) if change < 0.9 else inner[last]
    return data


def _edit_facts(files: Files, dice: random.Random) -> None:
    part = dice.choice(files.history + files.frames[:3])
    part.data = edited(part.data, dice)


def _edit_note(files: Files, dice: random.Random) -> None:
    notes = dice.choice([part for part in files.history if part.kind == "second"]).data["notes"]
    if notes:
        number = dice.randrange(len(notes))
        notes[number] = edited(notes[number], dice)


def _edit_events(files: Files, dice: random.Random) -> None:
    events = files.events
    for _ in range(dice.choice([1, 1, 3])):
        number = dice.randrange(len(events))
        change = dice.random()
        if change < 0.7:
            events[number] = edited(events[number], dice)
        elif change < 0.8:
            events.insert(dice.randrange(len(events)), events[number])
        elif change < 0.9 and len(events) > 1:
            del events[number]
        else:
            dice.shuffle(events)
    files.events = events


def _edit_summary(files: Files, dice: random.Random) -> None:
    files.summary = edited(files.summary, dice)


def _edit_text(files: Files, dice: random.Random) -> None:
    texts = files.start["texts"]
    name = dice.choice([*texts])
    lines = texts[name].split("\n")
    number = dice.randrange(len(lines))
    lines[number] = dice.choice(["", lines[number] + ESCAPES, "  x: [", lines[number][2:], "- *a"])
    texts[name] = "\n".join(lines)


def _edit_array(files: Files, dice: random.Random) -> None:
    part = dice.choice([part for part in files.history + files.frames[:3] if part.arrays])
    name = dice.choice([*part.arrays])
    array = part.arrays[name]
    change = dice.randrange(8)
    if change == 0:
        del part.arrays[name]
    elif change == 1:
        part.arrays[dice.choice(["x", "arm:x/../../pwned", "states", "rows", f"arm:{ESCAPES}"])] = (
            array
        )
    elif change == 2:
        part.arrays[name] = array[: dice.randrange(len(array) + 1)]
    elif change == 3:
        part.arrays[name] = array.astype(dice.choice(["<f8", "<f4", "<u4", "|u1"]))
    elif change == 4:
        part.arrays[name] = array.reshape(
            dice.choice([(-1,), (1, *array.shape), (*array.shape, 1)])
        )
    elif change == 5 and array.ndim > 1:
        part.arrays[name] = np.ascontiguousarray(array[:, : dice.randrange(array.shape[1] + 1)])
    elif change == 6:
        how, _ = pack(np.ascontiguousarray(array))
        part.declared[name] = edited(how, dice)
    else:
        changed = array.copy()
        flat = changed.reshape(-1)
        if flat.size:
            value = dice.choice([np.nan, np.inf, 1e300, -1.0, 0.0, 1e12, 7.0])
            with np.errstate(all="ignore"):
                flat[dice.randrange(flat.size)] = np.array(value).astype(array.dtype)
        part.arrays[name] = changed


def _edit_blocks(files: Files, dice: random.Random) -> None:
    parts = dice.choice([files.history, files.history, files.frames or files.history])
    number = dice.randrange(len(parts))
    change = dice.randrange(5)
    if change == 0:
        del parts[number]
    elif change == 1:
        parts.insert(dice.randrange(len(parts) + 1), copy.deepcopy(parts[number]))
    elif change == 2:
        dice.shuffle(parts)
    elif change == 3:
        parts[number].kind = dice.choice(["second", "model", "start", "end", "x", *VALUES])
    else:
        parts.extend(dice.choice([files.frames, files.history])[:3])


def _edit_model(files: Files, dice: random.Random) -> None:
    model = files.model
    names = [
        name
        for name in dir(model)
        if not name.startswith("_")
        and isinstance(getattr(model, name), np.ndarray)
        and getattr(model, name).size
    ]
    numbers: list[int] = [*range(-3, 9), 100, 10_000, 2**30, 2**31 - 1, -(2**31)]
    for _ in range(dice.choice([1, 1, 4])):
        flat = getattr(model, dice.choice(names)).reshape(-1)
        at = dice.randrange(flat.size)
        wide = flat.dtype.kind == "f"
        value = (
            dice.choice([np.nan, np.inf, 1e300, 0.0, -1.0, 1e10]) if wide else dice.choice(numbers)
        )
        with np.errstate(all="ignore"):
            flat[at] = np.array(value).astype(flat.dtype)
    content = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, content)
    files.model_bytes = content.tobytes()


def _edit_model_bytes(files: Files, dice: random.Random) -> None:
    content = bytearray(files.model_bytes)
    for _ in range(dice.choice([1, 3])):
        at = dice.choice([dice.randrange(16, 800), dice.randrange(len(content) - 4)]) // 4 * 4
        number = dice.choice([-1, 0, 1, 2**31 - 1, -(2**31), dice.randrange(2**31)])
        content[at : at + 4] = struct.pack("<i", number)
    files.model_bytes = bytes(content[: dice.choice([None, None, dice.randrange(len(content))])])


def _edit_bytes(files: Files, dice: random.Random) -> None:
    name = dice.choice(["run.history", "run.frames", "events.jsonl", "summary.json"])
    change = dice.randrange(4)
    share = dice.random()
    bit = dice.randrange(8)

    def changed(content: bytes) -> bytes:
        at = int(share * len(content))
        if change == 0:
            return content[:at]
        if change == 1:
            return (
                content[:at] + bytes([content[at] ^ 1 << bit]) + content[at + 1 :]
                if content
                else b""
            )
        if change == 2:
            return content[:at] + content[at // 2 :]
        return content + content[at:]

    files.raw[name] = changed


def _edit_kind_of_file(files: Files, dice: random.Random) -> None:
    name = dice.choice(["run.history", "run.frames", "events.jsonl", "summary.json"])
    files.others[name] = dice.choice([
        None, b"", b"\0" * 1000, b"[" * 100_000, b"{}", b"null", b"[1]\n", b"nan\n",
        os.mkfifo, Path.mkdir,
        lambda path: path.symlink_to("/dev/zero"),
        lambda path: path.symlink_to("/etc/hostname"),
        lambda path: path.symlink_to(path),
    ])  # fmt: skip


MUTATIONS: Final = (
    _edit_facts, _edit_facts, _edit_facts, _edit_note, _edit_note, _edit_events, _edit_events,
    _edit_events, _edit_summary, _edit_text, _edit_array, _edit_array, _edit_array, _edit_blocks,
    _edit_model, _edit_model, _edit_model_bytes, _edit_bytes, _edit_bytes, _edit_kind_of_file,
)  # fmt: skip


def mutated(files: Files, dice: random.Random) -> tuple[str, Files]:
    """A record with one mutation, sometimes two, and the names of the mutations."""
    mutant = files.copy()
    done = []
    for _ in range(dice.choice([1, 1, 1, 2])):
        mutation = dice.choice(MUTATIONS)
        try:
            mutation(mutant, dice)
        except (
            LookupError,
            TypeError,
            ValueError,
            AttributeError,
            AssertionError,
            RecursionError,
            StopIteration,
        ):
            continue  # the first change left nothing to change here
        done.append(mutation.__name__)
    return " ".join(done), mutant
