"""Untrusted records in every reader and exporter: tracebacks, files written elsewhere, memory.

    python -m benchmarks.records                         5,000 mutants, and all malicious records
    python -m benchmarks.records --mutants 200 --seed 3  fewer, and others

Each mutant that can be read goes through every reader that takes less than a second, and one in
`--slow` also through those that render videos and run the tree again. A mutant that is refused on
reading is refused by all readers alike, so only one random reader has to report it.

Each reading is a separate process, forked from one that has imported everything and read the
original record, so that meshes are loaded once; the memory printed is the largest of one such
process, its imports included. Progress is printed every hundred records.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import pickle
import random
import resource
import shutil
import signal
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from bt_dualarm.replay.record import Record
from tests.fuzz.malicious_records import MALICIOUS
from tests.fuzz.record_mutation import Files, mutated
from tests.fuzz.record_readers import QUICK, SLOW, fault_of
from tests.fuzz.recorded import recorded

MOST_MB: Final = 1000
"""Largest memory that one reading may take, MB."""


@dataclass(frozen=True)
class Reading:
    """Result of one reading.

    Attributes:
        refused: Whether the record was refused with one of the project's errors.
        fault: Fault of the reader; empty if there is none.
        memory_mb: Largest memory of its process or of a child process, MB.
    """

    refused: bool
    fault: str
    memory_mb: float


def read_in_child(reader: Callable[[Path, Path], int], sandbox: Path) -> Reading:
    """Read ``sandbox/record`` in a separate process."""
    receiver, sender = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(receiver)
        try:
            refused, fault = fault_of(reader, sandbox)
            kb = max(
                resource.getrusage(who).ru_maxrss
                for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
            )
            with os.fdopen(sender, "wb") as pipe:
                pickle.dump(Reading(refused, fault, kb / 1024), pipe)
        finally:
            os._exit(0)
    os.close(sender)
    with os.fdopen(receiver, "rb") as pipe:
        answer = pipe.read()
    _, status = os.waitpid(child, 0)
    if not answer:
        ended = signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else status
        return Reading(False, f"the process ended: {ended}", 0.0)
    reading: Reading = pickle.loads(answer)  # noqa: S301 - written above
    return reading


def _read(record: Path, _: Path) -> int:
    Record.read(record)
    return 0


def _readings(
    files: Files, sandbox: Path, rng: random.Random, slow: int, *, everything: bool
) -> Iterator[tuple[str, Reading]]:
    """Readers and their results."""
    shutil.rmtree(sandbox, ignore_errors=True)
    sandbox.mkdir(parents=True)
    files.write(sandbox / "record")
    names = [*QUICK, *(SLOW if rng.randrange(slow) == 0 else ())]
    if not everything and read_in_child(_read, sandbox).refused:
        names = rng.sample(names, 1)
    for name in names:
        yield name, read_in_child((QUICK | SLOW)[name], sandbox)


def _work(
    place: Path, files: Files, mutants: int, malicious: list[str], seed: int, slow: int
) -> tuple[Counter[str], list[str], tuple[float, str]]:
    """Counts, faults, and largest memory of a reading in MB with its name, of one share."""
    rng = random.Random(seed)  # noqa: S311 - no secret
    count = Counter[str]()
    faults = list[str]()
    peak = (0.0, "")
    total = mutants + len(malicious)
    sandbox = place / "s"
    sandbox.mkdir(parents=True)
    files.write(sandbox / "record")
    for reader in QUICK.values():
        fault_of(reader, sandbox)
    for number in range(total):
        if number and number % 100 == 0:
            print(f"  share {seed}: {number} of {total} records", flush=True)
        if number < mutants:
            origin, changed = mutated(files, rng)
        else:
            origin = malicious[number - mutants]
            changed = files.copy()
            MALICIOUS[origin](changed)
        count["records"] += 1
        everything = number >= mutants
        for name, reading in _readings(changed, sandbox, rng, slow, everything=everything):
            count["readings"] += 1
            count["refusals"] += reading.refused
            fault = reading.fault
            peak = max(peak, (reading.memory_mb, f"{origin}: {name}"))
            if reading.memory_mb > MOST_MB:
                fault = fault or f"memory: {reading.memory_mb:.0f} MB"
            if fault:
                kind = fault.split(":")[0]
                if kind not in ("printed", "written elsewhere", "memory"):
                    kind = "traceback"
                count[kind] += 1
                faults.append(f"{origin}: {name}: {fault}")
                print(f"  {origin}: {name}: {fault}", flush=True)
    return count, faults, peak


def main() -> int:
    """Print the results of all records; returns 0 if there are no faults."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--mutants", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--slow", type=int, default=50, help="use slow readers for one in so many")
    parser.add_argument("--workers", type=int, default=1)
    arguments = parser.parse_args()
    names = [*MALICIOUS]
    with tempfile.TemporaryDirectory() as folder:
        files = recorded(Path(folder) / "made")
        shares = [
            (
                Path(folder) / str(worker),
                files,
                len(range(worker, arguments.mutants, arguments.workers)),
                names[worker :: arguments.workers],
                arguments.seed * 1000 + worker,
                arguments.slow,
            )
            for worker in range(arguments.workers)
        ]
        with multiprocessing.get_context("spawn").Pool(arguments.workers) as pool:
            results = pool.starmap(_work, shares, chunksize=1)
    count = sum((result[0] for result in results), Counter[str]())
    memory_mb, reading = max(result[2] for result in results)
    print(
        f"{arguments.mutants} mutated and {len(names)} malicious records, "
        f"{count['readings']} readings: {count['refusals']} refused, "
        f"{count['traceback']} tracebacks, {count['written elsewhere']} files elsewhere, "
        f"{count['printed']} times a raw control character; "
        f"{count['memory']} of more than {MOST_MB} MB, at most {memory_mb:.0f} MB ({reading})"
    )
    return int(any(result[1] for result in results))


if __name__ == "__main__":
    raise SystemExit(main())
