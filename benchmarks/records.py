"""Records of strangers through every reader and export: tracebacks, files elsewhere, memory.

    python -m benchmarks.records                         5,000 mutants, and all malicious records
    python -m benchmarks.records --mutants 200 --seed 3  fewer, and others

Each mutant that is not refused as it is read goes through every reader that takes less than a
second, and one in `--slow` through those that draw films and run the tree again; one that is
refused is refused by all readers alike, so one of them, drawn anew for each, has to say so.
"""

from __future__ import annotations

import argparse
import multiprocessing
import random
import resource
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from bt_dualarm.replay.record import Record
from tests.fuzz.malicious_records import MALICIOUS
from tests.fuzz.record_mutation import Files, mutated
from tests.fuzz.record_readers import QUICK, SLOW, fault_of
from tests.fuzz.recorded import recorded


def _read(record: Path, _: Path) -> int:
    Record.read(record)
    return 0


def _readings(
    files: Files, sandbox: Path, dice: random.Random, slow: int, *, everything: bool
) -> Iterator[tuple[str, bool, str]]:
    """Reader, whether it refused the record, and what was wrong with that."""
    shutil.rmtree(sandbox, ignore_errors=True)
    sandbox.mkdir(parents=True)
    files.write(sandbox / "record")
    names = [*QUICK, *(SLOW if dice.randrange(slow) == 0 else ())]
    if not everything:
        refused, _ = fault_of(_read, sandbox)
        if refused:
            names = dice.sample(names, 1)
    for name in names:
        refused, fault = fault_of((QUICK | SLOW)[name], sandbox)
        yield name, refused, fault


def _work(
    place: Path, files: Files, mutants: int, malicious: list[str], seed: int, slow: int
) -> tuple[Counter[str], list[str], int]:
    """Counts, faults, and the peak of memory in kB, of one process's share."""
    dice = random.Random(seed)  # noqa: S311 - no secret
    count = Counter[str]()
    faults = list[str]()
    for number in range(mutants + len(malicious)):
        if number < mutants:
            what, changed = mutated(files, dice)
        else:
            what = malicious[number - mutants]
            changed = files.copy()
            MALICIOUS[what](changed)
        count["records"] += 1
        everything = number >= mutants
        for name, refused, fault in _readings(
            changed, place / "s", dice, slow, everything=everything
        ):
            count["readings"] += 1
            count["refusals"] += refused
            if fault:
                kind = fault.split(":")[0]
                if kind not in ("printed", "written elsewhere"):
                    kind = "traceback"
                count[kind] += 1
                faults.append(f"{what}: {name}: {fault}")
                print(f"  {what}: {name}: {fault}", flush=True)
    return count, faults, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def main() -> int:
    """Print what came of all records; 0 where nothing was wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--mutants", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--slow", type=int, default=50, help="one in so many through slow readers")
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
    peak = max(result[2] for result in results) / 1024
    print(
        f"{arguments.mutants} mutated and {len(names)} malicious records, "
        f"{count['readings']} readings: {count['refusals']} refused, "
        f"{count['traceback']} tracebacks, {count['written elsewhere']} files elsewhere, "
        f"{count['printed']} times a raw control character; at most {peak:.0f} MB"
    )
    return int(any(result[1] for result in results))


if __name__ == "__main__":
    raise SystemExit(main())
