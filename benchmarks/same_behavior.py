"""Regression check: does this checkout behave like a stored state?

    python -m benchmarks.same_behavior 29a6c90 [--only TEXT] [--figures]

The first argument is a revision of this repository, a folder with a checkout, or a file that
``--save`` wrote. Compared are

- the state hash, outcome, and every leaf's status, code and reason of every shipped tree (ideal,
  lab and rough, two seeds) and of the generated files of `behavior_cases`;
- the output of ``bt-check`` for every golden mistake in ``tests/golden/mistakes``;
- the schema, ``bt-skills``, and ``--help`` of every command.

``--figures`` also compares real-time factor, set-point, planning, start and tracking, alternating
with the stored checkout. ``expected_changes.yaml`` beside this file lists intended differences,
each with its reason; an entry whose case no longer differs is reported, too. Exits with code 0 if
everything is equal or listed.
"""

from __future__ import annotations

import argparse
import difflib
import json
import os
import subprocess
import sys
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

import yaml

from benchmarks.alternating import ROOT, checkout_of
from benchmarks.behavior_cases import generated, shipped

EXPECTED: Final = Path(__file__).parent / "expected_changes.yaml"

COMMANDS: Final = (
    "bt-check",
    "bt-experiments",
    "bt-record",
    "bt-replay",
    "bt-robot",
    "bt-run",
    "bt-skills",
    "bt-tune-color",
    "bt-why",
)

_RUN: Final = """
import json, sys
import bt_dualarm as bt
for line in sys.stdin:
    name, tree, seed, reality, params = json.loads(line)
    try:
        given = json.loads(tree) if tree.startswith("{") else f"trees/{tree}.yaml"
        done = bt.run(given, seed=seed, reality=reality, params=params, renderer="ray")
        found = {
            "state_sha256": done.state_sha256,
            "outcome": done.outcome,
            "sim_time_s": done.sim_time_s,
            "leaves": [
                [leaf.path, str(leaf.status), leaf.code, leaf.reason]
                for arm in done.arms.values() for leaf in arm.runs
            ],
        }
    except Exception as error:
        found = {"error": f"{type(error).__name__}: {error}"}
    print(json.dumps([name, found]), flush=True)
"""

_TEXTS: Final = """
import contextlib, io, json, os, sys
from pathlib import Path
from bt_dualarm import cli
os.environ["COLUMNS"] = "100"
def output(command, *arguments):
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        try:
            code = getattr(cli, command.removeprefix("bt-").replace("-", "_"))(list(arguments))
        except SystemExit as end:
            code = end.code
    return f"{out.getvalue()}\\nexit code {code}"
texts = {f"{command} --help": output(command, "--help") for command in sys.argv[1:]}
texts["bt-skills"] = output("bt-skills")
texts["schema"] = Path("assets/schema/tree.schema.json").read_text()
for path in sorted(Path("tests/golden/mistakes").glob("*.yaml")):
    texts[f"mistake {path.stem}"] = output("bt-check", str(path))
print(json.dumps(texts))
"""

FIGURES: Final[Mapping[str, tuple[str, ...]]] = {
    "real-time factor": ("benchmarks.real_time", "--repeats", "1"),
    "set-point": ("benchmarks.setpoint",),
    "planning": ("benchmarks.scenes", "--problems", "40", "--best", "0"),
    "start": ("benchmarks.start",),
    "tracking": ("benchmarks.following", "--robot", "panda", "--motion", "circle"),
}
"""Benchmarks that both states have, and their arguments."""

Behavior = dict[str, Any]
"""Behavior of a state, by the name of the case."""


def behavior_of(checkout: Path, only: str) -> Behavior:
    """Behavior of a checkout in every case whose name contains ``only``."""
    cases = [case for case in (*shipped(), *generated()) if only in case.name]
    halves = [cases[0::2], cases[1::2]]
    found: Behavior = {}
    with ThreadPoolExecutor(len(halves)) as pool:
        for part in pool.map(lambda half: _runs_of(checkout, half), halves):
            found |= part
    arguments = [sys.executable, "-c", _TEXTS, *COMMANDS]
    done = subprocess.run(
        arguments, cwd=checkout, env=_environment(checkout), stdout=subprocess.PIPE, check=True
    )
    texts = json.loads(done.stdout)
    return found | {name: text for name, text in texts.items() if only in name}


def _runs_of(checkout: Path, cases: list[Any]) -> Behavior:
    """Run cases one after the other in one process; a case that ends the process is an error."""
    found: Behavior = {}
    waiting = list(cases)
    while waiting:
        done = subprocess.run(
            [sys.executable, "-c", _RUN],
            input="".join(json.dumps(case) + "\n" for case in waiting),
            cwd=checkout,
            env=_environment(checkout),
            stdout=subprocess.PIPE,
            text=True,
            check=False,
        )
        lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("[")]
        found |= dict(lines)
        waiting = waiting[len(lines) :]
        if waiting and done.returncode != 0:
            found[waiting.pop(0).name] = {"error": f"the process ended with {done.returncode}"}
    return found


def _environment(checkout: Path) -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(checkout), "PYTHONHASHSEED": "0"}


def differences(before: Behavior, after: Behavior) -> dict[str, str]:
    """Cases that differ, each with the first few differing lines."""
    found = {}
    for name in sorted(before.keys() | after.keys()):
        old = before.get(name, "no such case")
        new = after.get(name, "no such case")
        if isinstance(old, dict) and "error" in old and old == new:
            found[name] = f"cannot be run in either state: {old['error']}"
        elif old != new:
            lines = difflib.unified_diff(_lines(old), _lines(new), "before", "after", "", "", 0, "")
            found[name] = "\n".join(list(lines)[2:14])
    return found


def _lines(found: object) -> list[str]:
    text = found if isinstance(found, str) else json.dumps(found, indent=1)
    return text.splitlines()


def compare_figures(before: Path) -> None:
    """Print the last line of each benchmark: for the stored state, this one, the stored one."""
    for name, (module, *arguments) in FIGURES.items():
        for text, checkout in (("before", before), ("after", ROOT), ("before", before)):
            done = subprocess.run(
                [sys.executable, "-m", module, *arguments],
                cwd=checkout,
                env=_environment(checkout),
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                check=False,
            )
            last = (done.stdout.strip().splitlines() or ["(nothing)"])[-1]
            print(f"{name}, {text}: {last}", flush=True)


def main() -> int:
    """Compare both states, and print each difference with its listed reason, if any."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("before")
    parser.add_argument("--only", default="", help="cases whose name contains this text")
    parser.add_argument("--save", type=Path, help="only save the stored state's behavior")
    parser.add_argument("--figures", action="store_true", help="compare benchmarks, too")
    arguments = parser.parse_args()
    if Path(arguments.before).is_file():
        before = json.loads(Path(arguments.before).read_text(encoding="utf-8"))
        before = {name: one for name, one in before.items() if arguments.only in name}
    else:
        with checkout_of(arguments.before) as checkout:
            before = behavior_of(checkout, arguments.only)
            if arguments.figures:
                compare_figures(checkout)
    if arguments.save:
        arguments.save.write_text(json.dumps(before, indent=1), encoding="utf-8")
        return 0
    after = behavior_of(ROOT, arguments.only)
    return report(differences(before, after), len(after), arguments.only)


def report(found: Mapping[str, str], compared: int, only: str) -> int:
    """Print the differences; returns the exit code."""
    listed: dict[str, str] = yaml.safe_load(EXPECTED.read_text(encoding="utf-8")) or {}
    unexpected = 0
    for name, text in found.items():
        reason = next((why for start, why in listed.items() if name.startswith(start)), None)
        if reason is None:
            unexpected += 1
            print(f"DIFFERS {name}\n{text}")
        else:
            print(f"differs as listed: {name}: {reason}")
    stale = [key for key in listed if only in key and not any(n.startswith(key) for n in found)]
    for key in stale:
        print(f"listed, but no longer different: {key}")
    print(
        f"{compared} cases compared: {compared - len(found)} equal, "
        f"{len(found) - unexpected} differ as listed, {unexpected} differ unexpectedly"
    )
    return 1 if unexpected or stale else 0


if __name__ == "__main__":
    sys.exit(main())
