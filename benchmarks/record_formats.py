"""The current record versus one MCAP file of the same content: cost, ``kill -9``, hostile files.

    python -m benchmarks.record_formats [TREE] [--rounds 7] [--kills 20] [--mutants 5000]

The blocks, samples and events of one run are kept as a tape, which is written alternately in each
layout; then runs alternate without a record, with the current one and with MCAP. ``blocks`` puts
the blocks of the history into MCAP unchanged, which no viewer reads; ``messages`` writes each
state, set-point, sample, event and note as a separate message that viewers plot: CDR with ROS 2
schemas for numbers, JSON for the rest. An MCAP chunk ends with each simulated second, like a block
of the history.
"""

from __future__ import annotations

import argparse
import io
import json
import random
import resource
import signal
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Final, Protocol
from unittest import mock

import lz4.frame
import numpy as np
import numpy.typing as npt
import zstandard
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

import bt_dualarm
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.export.mcap import messages_of, write_mcap
from bt_dualarm.replay.record import Record
from bt_dualarm.runtime import observations, recorder
from bt_dualarm.runtime.history_file import (
    Block,
    HistoryError,
    HistoryWriter,
    ReadBudget,
    read_history,
)
from bt_dualarm.runtime.outcome import Sample
from bt_dualarm.runtime.recorder import EVENTS, HISTORY, LOG, PARTS, SAMPLES

FILE: Final = "run.mcap"
LAYOUTS: Final = {
    "today": None,
    "blocks, no compression": ("blocks", CompressionType.NONE),
    "messages, zstd": ("messages", CompressionType.ZSTD),
    "messages, lz4": ("messages", CompressionType.LZ4),
    "messages, no compression": ("messages", CompressionType.NONE),
}
_MEMORY_LIMIT: Final = 4 << 30
"""Address space of the process that reads hostile files, bytes."""


class RecordWriter(Protocol):
    """Writer of a record during a run."""

    def block(self, block: Block) -> None:
        """Write a block of the history."""

    def sample(self, sample: Sample) -> None:
        """Write positions of tools and objects at one time."""

    def lines(self, name: str, text: str) -> None:
        """Write lines of the events or of the log."""

    def finish(self) -> None:
        """Write the remaining data and close the files."""


class CurrentWriter:
    """The current files: history, samples, events, log.

    Args:
        folder: Folder to write to.
    """

    def __init__(self, folder: Path) -> None:
        self._history = HistoryWriter(folder / HISTORY)
        self._samples = recorder.SampleFiles(folder / PARTS)
        self._journals = {name: observations.Journal(folder / name) for name in (EVENTS, LOG)}
        self._archive = folder / SAMPLES

    def block(self, block: Block) -> None:
        """See `RecordWriter`."""
        self._history.add(block)

    def sample(self, sample: Sample) -> None:
        """See `RecordWriter`."""
        self._samples.add(sample)

    def lines(self, name: str, text: str) -> None:
        """See `RecordWriter`."""
        self._journals[name].add(text)

    def finish(self) -> None:
        """See `RecordWriter`."""
        self._history.close()
        for journal in self._journals.values():
            journal.close()
        with self._archive.open("wb") as file:
            self._samples.write_archive(file)
        self._samples.remove()


_FLOATS: Final = {np.dtype("<f8"): ("float64", 4), np.dtype("<f4"): ("float32", 0)}
"""Name in a ROS 2 schema, and padding in bytes between the length of a sequence and its numbers."""


@dataclass
class McapRecordWriter:
    """One MCAP file.

    Attributes:
        file: File to write.
        layout: ``blocks`` or ``messages``.
        compression: Compression of its chunks.
    """

    file: BinaryIO
    layout: str
    compression: CompressionType
    _channels: dict[str, int] = field(default_factory=dict)
    _schemas: dict[str, int] = field(default_factory=dict)
    _time: float = 0.0

    def __post_init__(self) -> None:
        """Write the header."""
        self._writer = Writer(self.file, compression=self.compression)
        self._writer.start("bt_dualarm")

    def block(self, block: Block) -> None:
        """See `RecordWriter`."""
        states = block.arrays.get("states")
        self._time = float(states[-1, 0]) if states is not None else self._time
        if self.layout == "blocks" or block.kind == "model":
            self._add(f"/{block.kind}", "", block.encoded(), self._time)
        elif block.kind == "second":
            self._add_second(block)
        else:
            self._add_json(f"/{block.kind}", dict(block.data), self._time)
        if block.kind in ("second", "end"):
            self._writer.flush()  # type: ignore[no-untyped-call]  # untyped package

    def _add_second(self, block: Block) -> None:
        facts = {name: value for name, value in block.data.items() if name != "notes"}
        for name in ("checksums", "rows"):
            facts[name] = block.arrays[name].tolist()
        self._add_json("/second", facts, self._time)
        if "key" in block.arrays:
            self._add_floats("/key", self._time, block.arrays["key"])
        states = block.arrays.get("states", np.empty((0, 1)))
        times = states[:, 0].tolist()
        for name, rows in block.arrays.items():
            if name == "states":
                name = f"states/{block.data['generation']}"
                rows = states[:, 1:]
            elif ":" not in name:
                continue
            topic = "/" + name.replace(":", "/")
            # An arm that was spawned in this second has only its last rows.
            for at, row in zip(times[-len(rows) :], rows, strict=True):
                self._add_floats(topic, at, row)
        notes: Any = block.data["notes"]
        for note in notes:
            self._add_json(f"/{note['arm']}/{note['kind']}", note, note["time_s"])

    def sample(self, sample: Sample) -> None:
        """See `RecordWriter`."""
        topic = f"/samples/{' '.join(sample.names)}"
        self._add_floats(topic, sample.time, sample.points.ravel())

    def lines(self, name: str, text: str) -> None:
        """See `RecordWriter`."""
        for line in text.splitlines():
            self._add(f"/{name}", "{}", line.encode(), self._time)

    def finish(self) -> None:
        """See `RecordWriter`."""
        self._writer.finish()  # type: ignore[no-untyped-call]  # untyped package
        self.file.close()

    def _add_floats(self, topic: str, at: float, row: npt.NDArray[np.generic]) -> None:
        kind, padding = _FLOATS[row.dtype]
        head = struct.pack(f"<4sdI{padding}x", b"\0\1\0\0", at, len(row))
        self._add(topic, f"float64 time_s\n{kind}[] values\n", head + row.tobytes(), at)

    def _add_json(self, topic: str, content: object, at: float) -> None:
        text = json.dumps(content, allow_nan=False, separators=(",", ":"))
        self._add(topic, "{}", text.encode(), at)

    def _add(self, topic: str, schema: str, data: bytes, at: float) -> None:
        if topic not in self._channels:
            encoding = {"": "", "{}": "jsonschema"}.get(schema, "ros2msg")
            if schema and schema not in self._schemas:
                name = f"bt_dualarm/msg/S{len(self._schemas)}"
                made = self._writer.register_schema(name, encoding, schema.encode())
                self._schemas[schema] = made
            how = {"": "opaque", "jsonschema": "json", "ros2msg": "cdr"}[encoding]
            number = self._writer.register_channel(topic, how, self._schemas.get(schema, 0))
            self._channels[topic] = number
        nanoseconds = round(at * 1e9)
        self._writer.add_message(self._channels[topic], nanoseconds, data, nanoseconds)


def open_writer(name: str, folder: Path) -> RecordWriter:
    """Writer of a record in one of the layouts, in an empty folder."""
    how = LAYOUTS[name]
    if how is None:
        return CurrentWriter(folder)
    return McapRecordWriter((folder / FILE).open("wb"), *how)


@contextmanager
def recording_to(record_writer: RecordWriter) -> Iterator[None]:
    """Context whose runs record to a writer, which they do not finish, and draw no plots."""

    class Blocks:
        def __init__(self, path: Path) -> None:
            self.path = path

        def add(self, block: Block) -> None:
            record_writer.block(block)

        def finish(self) -> None:
            pass

        def close(self) -> None:
            pass

    class Samples:
        def __init__(self, folder: Path) -> None:
            self.folder = folder

        def add(self, sample: Sample) -> None:
            record_writer.sample(sample)

        def write_archive(self, file: BinaryIO) -> None:
            pass

        def remove(self) -> None:
            pass

    class Lines:
        def __init__(self, path: Path) -> None:
            self._name = path.name

        def add(self, text: str) -> None:
            if text:
                record_writer.lines(self._name, text)

        def finish(self) -> None:
            pass

        def close(self) -> None:
            pass

    with (
        mock.patch("bt_dualarm.runtime.history.HistoryWriter", Blocks),
        mock.patch("bt_dualarm.runtime.recorder.SampleFiles", Samples),
        mock.patch("bt_dualarm.runtime.recorder.Journal", Lines),
        mock.patch("bt_dualarm.runtime.plots.files_of", return_value=()),
    ):
        yield


@dataclass
class Tape:
    """Everything that a run wrote, in order.

    Attributes:
        calls: Name of a method of `RecordWriter`, and its arguments.
    """

    calls: list[tuple[str, tuple[object, ...]]] = field(default_factory=list)

    def block(self, block: Block) -> None:
        """See `RecordWriter`."""
        self.calls.append(("block", (block,)))

    def sample(self, sample: Sample) -> None:
        """See `RecordWriter`."""
        self.calls.append(("sample", (sample,)))

    def lines(self, name: str, text: str) -> None:
        """See `RecordWriter`."""
        self.calls.append(("lines", (name, text)))

    def finish(self) -> None:
        """See `RecordWriter`."""
        self.calls.append(("finish", ()))

    def write(self, record_writer: RecordWriter) -> None:
        """Repeat all calls on another writer."""
        for name, arguments in self.calls:
            getattr(record_writer, name)(*arguments)


def run_of(
    tree: str, layout: str, folder: Path, report: Callable[[float], None] | None = None
) -> float:
    """Run a tree; returns the CPU seconds of the run and its record, plots excluded.

    Args:
        tree: Name of the tree.
        layout: One of `LAYOUTS`, or empty for no record.
        folder: Empty folder of the record.
        report: Receives the simulated time in s every 20 simulated ms.
    """
    record_writer = open_writer(layout, folder) if layout else Tape()
    with recording_to(record_writer), tempfile.TemporaryDirectory() as other:
        run = bt_dualarm.open(tree, record=other if layout else None)
        before = time.process_time()
        while report is not None and not run.done:
            run.step(0.02)
            report(run.time)
        run.finish()
        run.close()
        record_writer.finish()
        return time.process_time() - before


@dataclass(frozen=True, eq=False)
class Read:
    """Readable content of a record.

    Attributes:
        states: States in order, as bytes.
        last_s: Simulated time of the last state.
        ended: Why reading ended; empty at the end of a complete file.
    """

    states: list[bytes]
    last_s: float
    ended: str


def read_current(path: Path, budget: ReadBudget | None = None) -> Read:
    """Read a history in the current format."""
    file = read_history(path, budget)
    rows = [row for block in file.blocks for row in block.arrays.get("states", ())]
    last = float(rows[-1][0]) if rows else 0.0
    return Read([row.tobytes() for row in rows], last, file.torn)


def read_messages(file: BinaryIO) -> Read:
    """Read the messages of an MCAP file from its start, as the package reads a truncated one."""
    states = []
    last = 0.0
    ended = ""
    topics: dict[int, str] = {}
    try:
        for record in StreamReader(file, validate_crcs=True, record_size_limit=1 << 26).records:
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message) and topics[record.channel_id].startswith("/states/"):
                states.append(record.data[4:12] + record.data[20:])
                (last,) = struct.unpack("<d", record.data[4:12])
    except Exception as error:  # noqa: BLE001 - their types are counted
        ended = f"{type(error).__module__}.{type(error).__name__}"
    return Read(states, last, ended)


def median_ms(*actions: Callable[[], object], rounds: int) -> list[float]:
    """Median CPU times in ms of alternating actions."""
    spent: list[list[float]] = [[] for _ in actions]
    for _ in range(rounds):
        for action, column in zip(actions, spent, strict=True):
            before = time.process_time()
            action()
            column.append(1e3 * (time.process_time() - before))
    return [statistics.median(column) for column in spent]


def cost_of_writing(tape: Tape, until: float, root: Path, rounds: int) -> None:
    """Print CPU time and size of each layout, and whether the states are bitwise equal."""

    def write(name: str) -> None:
        for path in (root / name).iterdir():
            path.unlink()
        tape.write(open_writer(name, root / name))

    for name in LAYOUTS:
        (root / name).mkdir()
    actions = [lambda name=name: write(name) for name in LAYOUTS]
    for name, spent in zip(LAYOUTS, median_ms(*actions, rounds=rounds), strict=True):
        size = sum(path.stat().st_size for path in (root / name).iterdir())
        print(f"{name}: {spent / until:.2f} ms of CPU per simulated second, {size / 1e6:.2f} MB")
    current = read_current(root / "today" / HISTORY)
    with (root / "messages, zstd" / FILE).open("rb") as file:
        print(f"states bitwise equal: {read_messages(file).states == current.states}")


def cost_of_reading(root: Path, until: float, rounds: int) -> None:
    """Print the CPU time of reading everything, and of reading one time."""
    history = root / "today" / HISTORY
    rng = random.Random(0)  # noqa: S311 - no secret

    def all_of(name: str) -> None:
        with (root / name / FILE).open("rb") as file:
            read_messages(file)

    def moment(name: str) -> None:
        at = round(rng.uniform(0.0, until) * 1e9)
        with (root / name / FILE).open("rb") as file:
            found = make_reader(file).iter_messages(
                topics=["/states/0", "/states/1", "/states/2"],
                starting_at=at,
                ending_before=at + 20_000_000,
            )
            next(found, None)

    names = [name for name in LAYOUTS if name.startswith("messages")]
    whole = [lambda name=name: all_of(name) for name in names]
    single = [lambda name=name: moment(name) for name in names]
    spent = median_ms(lambda: read_current(history), *whole, *single, rounds=rounds)
    print(f"today: {spent[0]:.1f} ms to read all, including every time")
    columns = zip(names, spent[1 : 1 + len(names)], spent[1 + len(names) :], strict=True)
    for name, all_ms, one_ms in columns:
        print(f"{name}: {all_ms:.1f} ms to read all, {one_ms:.1f} ms for one time by the index")


def cost_of_runs(tree: str, rounds: int) -> None:
    """Print the CPU time of whole runs relative to those without a record."""
    names = ("", "today", "messages, zstd")
    spent: dict[str, list[float]] = {name: [] for name in names}
    for number in range(rounds):
        for name in names if number % 2 else names[::-1]:
            with tempfile.TemporaryDirectory() as folder:
                spent[name].append(run_of(tree, name, Path(folder)))
        shown = ", ".join(f"{name or 'none'} {column[-1]:.2f} s" for name, column in spent.items())
        print(f"CPU with the record: {shown}", flush=True)
    for name in names[1:]:
        ratios = [recorded / none for recorded, none in zip(spent[name], spent[""], strict=True)]
        smallest = min(spent[name]) / min(spent[""])
        print(
            f"{name}: {statistics.median(ratios):.3f} times a run without (least: {smallest:.3f})"
        )


def cost_of_viewing(tree: str) -> None:
    """Print the cost of the messages that `bt-record export --mcap` writes for Foxglove."""
    with (
        tempfile.TemporaryDirectory() as folder,
        mock.patch("bt_dualarm.runtime.plots.files_of", return_value=()),
    ):
        bt_dualarm.run(tree, record=folder)
        record = Record.read(Path(folder))
        before = time.process_time()
        write_mcap(messages_of(record), Path(folder) / FILE)
        spent = 1e3 * (time.process_time() - before) / record.until
        size = (Path(folder) / FILE).stat().st_size
    print(f"export for Foxglove: {spent:.1f} ms per simulated second, {size / 1e6:.2f} MB")


def kill(tree: str, layout: str, kills: int, rng: random.Random) -> None:
    """Print what is readable of runs that are killed at random times."""
    missing = []
    endings = Counter[str]()
    for _ in range(kills):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            command = [sys.executable, "-m", "benchmarks.record_formats", tree]
            command += ["--child", layout, name]
            with subprocess.Popen(command, stdout=subprocess.PIPE) as child:
                output: Any = child.stdout
                output.readline()
                time.sleep(rng.uniform(0.0, 3.0))
                child.send_signal(signal.SIGKILL)
                times = output.read().split()
            reached = float(times[-2]) if len(times) > 1 else 0.0
            try:
                with suppress(FileNotFoundError):
                    if layout == "today":
                        left = read_current(folder / HISTORY)
                    else:
                        with (folder / FILE).open("rb") as file:
                            left = read_messages(file)
                    missing.append(reached - left.last_s)
                    endings[left.ended or "whole"] += 1
            except HistoryError as error:
                endings[str(error)] += 1
    print(f"{layout}: {len(missing)} of {kills} killed runs readable, at most {max(missing):.2f} s")
    print(f"  missing; reading ended with {dict(endings)}")


def cut(root: Path, rng: random.Random) -> None:
    """Print how each layout is read when it is truncated at a random byte."""
    for name in LAYOUTS:
        if name.startswith("blocks"):
            continue
        path = root / name / (HISTORY if name == "today" else FILE)
        content = path.read_bytes()
        whole = read_current(path) if name == "today" else read_messages(io.BytesIO(content))
        sound = Counter[str]()
        for _ in range(200):
            part = content[: rng.randrange(100, len(content))]
            if name == "today":
                (root / "part").write_bytes(part)
                left = read_current(root / "part")
            else:
                left = read_messages(io.BytesIO(part))
            wrong = left.states != whole.states[: len(left.states)]
            sound["a wrong state at the end" if wrong else "only true states"] += 1
            sound[f"ended by {left.ended if name != 'today' else 'a message'}"] += 1
        print(f"{name}, truncated 200 times: {dict(sound)}")


def _mutated(content: bytes, rng: random.Random) -> bytes:
    """Flip, remove, repeat or overwrite some bytes."""
    at = rng.randrange(len(content))
    size = rng.choice((1, 1, 1, 4, 8, 100))
    kind = rng.randrange(4)
    if kind == 0:
        new = bytes((content[at] ^ 1 << rng.randrange(8),))
        return content[:at] + new + content[at + 1 :]
    if kind == 1:
        return content[:at] + content[at + size :]
    if kind == 2:
        return content[:at] + content[at : at + size] + content[at:]
    return content[:at] + rng.choice((b"\0", b"\xff", b"\x7f")) * size + content[at + size :]


def mutate(tape: Tape, mutants: int, rng: random.Random) -> None:
    """Print how mutants of short files are read."""
    seconds = [call for call in tape.calls if call[0] == "block" and call[1][0].kind == "second"]  # type: ignore[attr-defined]
    short = Tape([*seconds[:2], ("finish", ())])
    for name in ("today", "messages, zstd", "messages, no compression"):
        with tempfile.TemporaryDirectory() as folder:
            root = Path(folder)
            short.write(open_writer(name, root))
            path = root / (HISTORY if name == "today" else FILE)
            content = path.read_bytes()
            whole = read_current(path) if name == "today" else read_messages(io.BytesIO(content))
            found = Counter[str]()
            for _ in range(mutants):
                mutant = _mutated(content, rng)
                try:
                    if name == "today":
                        path.write_bytes(mutant)
                        left = read_current(path)
                    else:
                        left = read_messages(io.BytesIO(mutant))
                except DualArmError:
                    found["rejected with a message"] += 1
                    continue
                wrong = left.states != whole.states[: len(left.states)]
                found["WRONG states read"] += wrong
                found[("torn" if name == "today" else left.ended) if left.ended else "read"] += 1
        print(f"{name}, {mutants} mutants: {dict(found.most_common())}")


def bombs() -> None:
    """Print the peak memory when a small chunk decompresses to a gigabyte."""
    for name in ("zstd", "lz4"):
        command = [sys.executable, "-m", "benchmarks.record_formats", "--bomb", name]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        print(done.stdout.strip() or f"{name}: ended by {done.stderr.strip().splitlines()[-1]}")


def bomb(name: str) -> None:
    """Read a chunk that declares 1,000 bytes but has 2**30: one record of an unknown type."""
    plain = bytes(1 << 20)
    record = struct.pack("<BQ", 0x80, (1 << 30) - 9)
    if name == "zstd":
        maker = zstandard.ZstdCompressor().compressobj(size=1 << 30)
        parts = [maker.compress(record + plain[len(record) :])]
        parts += (maker.compress(plain) for _ in range(1023))
        data = b"".join((*parts, maker.flush()))
    else:
        with io.BytesIO() as file:
            with lz4.frame.open(file, "wb") as target:
                target.write(record + plain[len(record) :])
                for _ in range(1023):
                    target.write(plain)
            data = file.getvalue()
    with io.BytesIO() as file:
        writer = Writer(file, compression=CompressionType.NONE, use_chunking=False)
        writer.start()
        builder = writer._Writer__record_builder  # type: ignore[attr-defined]
        Chunk(name, data, 0, 0, 0, 1000).write(builder)
        writer.finish()  # type: ignore[no-untyped-call]  # untyped package
        content = file.getvalue()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY_LIMIT, _MEMORY_LIMIT))
    read = read_messages(io.BytesIO(content))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(
        f"{name} chunk of {len(data) / 1e6:.2f} MB that declares 1,000 bytes: "
        f"{(peak - before) / 1024:.0f} MB more memory, ended by {read.ended or 'nothing'}"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print all figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("tree", nargs="?", default="pick_and_track")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--mutants", type=int, default=5000)
    parser.add_argument("--child", nargs=2, metavar=("LAYOUT", "FOLDER"), help=argparse.SUPPRESS)
    parser.add_argument("--bomb", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.bomb:
        bomb(options.bomb)
        return
    if options.child:
        layout, folder = options.child
        run_of(options.tree, layout, Path(folder), lambda at: print(at, flush=True))
        return
    rng = random.Random(0)  # noqa: S311 - no secret
    tape = Tape()
    with tempfile.TemporaryDirectory() as other, recording_to(tape):
        until = bt_dualarm.run(options.tree, record=other).sim_time_s
    tape.finish()
    with tempfile.TemporaryDirectory() as name:
        cost_of_writing(tape, until, Path(name), 3 * options.rounds)
        cost_of_reading(Path(name), until, 3 * options.rounds)
        cut(Path(name), rng)
    if options.rounds > 1:
        cost_of_viewing(options.tree)
        cost_of_runs(options.tree, options.rounds)
    for layout in ("today", "messages, zstd") if options.kills else ():
        kill(options.tree, layout, options.kills, rng)
    if options.mutants:
        mutate(tape, options.mutants, rng)
        bombs()


if __name__ == "__main__":
    main()
