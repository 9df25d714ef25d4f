"""Runs stopped at random times and in blocking skills: exit code, complete files, arms at rest.

    python benchmarks/interrupts.py signals  [--times 200] [--seed 0]
    python benchmarks/interrupts.py blockers [--times 300] [--seed 0]
    python benchmarks/interrupts.py workers  [--times 50] [--seed 0]

``signals``: INT, TERM and HUP at random wall-clock times after the start of the program.
``blockers``: code that does not return, in each phase of a skill, with no, one or two signals.
``workers``: the planning process is killed or stopped; the leaf fails, or its plan is found.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from subprocess import PIPE

import numpy as np

from bt_dualarm.core.errors import Failure
from bt_dualarm.planning.process import PlanningProcess
from tests.control.walls import LEFT, RIGHT, problem_in, walled_world

SKILLS = Path(__file__).parents[1] / "tests" / "faults" / "skills"
PROGRAM = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "signal.signal(signal.SIGHUP, signal.SIG_DFL); print('begun', flush=True); "
    "import bt_dualarm.cli as cli, sys; sys.exit(cli.run())"
)
BLOCKED = """\
bt_dualarm: 1
name: blocked
world: {{scene: empty, time_limit: 20}}
arms:
  arm1: {{robot: ur5, tree: {{timeout: {{seconds: 0.3, child: {{blocker: {ports}}}}}}}}}
  arm2: {{robot: ur3, base: {{xyz: [0, 2, 0]}}, tree: {{wait: 10}}}}
"""
KINDS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
PHASES = ("constructor", "before", "step", "finally", "stream")
DEEDS = ("spin", "sleep", "wait", "swallow", "deadlock")
OVERRUN = 154
BUDGET_S = 1.0  # wall-clock budget of the watchdog
LONGEST_S = 10.0  # from the start of blocking to the exit, plots of the record included
LATEST = 6.0  # latest time of a signal after the start of the program, s
STANDS = 2e-4  # largest motion of a resting tool between two samples, 10 ms apart, m


def run_and_signal(
    arguments: list[str], kind: signal.Signals | None, moment: float
) -> tuple[int, str, float]:
    """Exit code, standard error, and seconds since its first lines, of a run that gets a signal."""
    command = [sys.executable, "-c", PROGRAM, *arguments]
    with subprocess.Popen(command, stdout=PIPE, stderr=PIPE, text=True) as process:
        if process.stdout is not None:
            process.stdout.readline()
            if kind is None:
                process.stdout.readline()  # printed when it begins to block
        began = time.monotonic()
        if kind is not None:
            time.sleep(moment)
            process.send_signal(kind)
        errors = process.communicate(timeout=300)[1]
    # The same code as a shell reports for a process that was ended by a signal.
    code = process.returncode if process.returncode >= 0 else 128 - process.returncode
    return code, errors, time.monotonic() - began


def interrupt_run(rng: np.random.Generator, number: int, folder: Path) -> tuple[str, list[str]]:
    """One signal at a random time; returns a description of the case and its faults."""
    kind = KINDS[number % len(KINDS)]
    moment = rng.uniform(0.0, LATEST)
    arguments = ["pick_and_track", "--display", "quiet", "--record", str(folder)]
    code, errors, _ = run_and_signal(arguments, kind, moment)
    faults = [] if code == 128 + kind else [f"exit code {code} instead of {128 + kind}"]
    if "Traceback" in errors:
        faults.append("a traceback")
    if folder.exists() and any(folder.iterdir()):  # there are none before the run begins
        faults += _record_faults(folder, at_rest=True)
    return f"{kind.name} at {moment:5.2f} s", faults


def interrupt_blocker(rng: np.random.Generator, number: int, folder: Path) -> tuple[str, list[str]]:
    """One blocking skill; returns a description of the case and its faults."""
    phase = PHASES[number % len(PHASES)]
    action = str(rng.choice(DEEDS))
    names = [KINDS[index].name for index in rng.integers(len(KINDS), size=rng.integers(3))]
    ports = {"phase": phase, "action": action, "signals": " ".join(names)}
    folder.mkdir()
    tree = folder / "blocked.yaml"
    tree.write_text(BLOCKED.format(ports=json.dumps(ports)), encoding="utf-8")
    arguments = [str(tree), "--display", "quiet", "--skills", str(SKILLS)]
    arguments += ["--record", str(folder / "out"), "--watchdog", str(BUDGET_S)]
    code, errors, seconds = run_and_signal(arguments, None, 0.0)
    expected = 128 + signal.Signals[names[0]] if names else OVERRUN
    faults = [] if code == expected else [f"exit code {code} instead of {expected}"]
    if "blocker.py" not in errors:
        faults.append("the blocking file is not named")
    if seconds > LONGEST_S:
        faults.append("too late")
    faults += _record_faults(folder / "out", at_rest=False)
    return f"{' '.join((action, 'in', phase, *names))}, {seconds:.1f} s", faults


def interrupt_planning(
    rng: np.random.Generator, number: int, _folder: Path
) -> tuple[str, list[str]]:
    """One killed or stopped planning process; returns a description of the case and its faults."""
    kind = (signal.SIGKILL, signal.SIGSTOP)[number % 2]
    moment = rng.uniform(0.0, 0.5)
    planning = PlanningProcess()
    problem = problem_in(walled_world(), RIGHT, LEFT)
    try:
        pending = planning.solve(problem)
        time.sleep(moment)
        os.kill(planning.pid or 0, kind)
        try:
            pending.result()
            description = "found"
        except Failure as failure:
            description = failure.code
        faults = [] if len(planning.solve(problem).result()) > 1 else ["the next plan is not found"]
    finally:
        planning.close()
    return f"{kind.name} at {moment:.2f} s: {description}", faults


def _record_faults(folder: Path, *, at_rest: bool) -> Iterator[str]:
    try:
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        for line in (folder / "events.jsonl").read_text(encoding="utf-8").splitlines():
            json.loads(line)
        with np.load(folder / "samples.npz") as archive:
            samples = {name: archive[name] for name in archive.files}
    except (OSError, ValueError) as error:
        yield f"record: {error}"
        return
    if summary["outcome"] not in ("UNFINISHED", "SUCCESS", "FAILURE"):
        yield f"outcome {summary['outcome']}"
    for name in samples if at_rest else ():
        motion = np.diff(samples[name][-2:], axis=0)
        if name.startswith("tool_") and not (np.linalg.norm(motion, axis=1) < STANDS).all():
            yield f"{name} moves at the end"


TRIALS: dict[str, tuple[Callable[..., tuple[str, list[str]]], int]] = {
    "signals": (interrupt_run, 200),
    "blockers": (interrupt_blocker, 300),
    "workers": (interrupt_planning, 100),
}


def main() -> int:
    """Parse the options and run the trials; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("family", choices=TRIALS)
    parser.add_argument("--times", type=int)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    trial, times = TRIALS[arguments.family]
    times = arguments.times or times
    rng = np.random.default_rng(arguments.seed)
    bad = 0
    with tempfile.TemporaryDirectory() as scratch:
        for number in range(times):
            description, faults = trial(rng, number, Path(scratch) / str(number))
            bad += bool(faults)
            print(f"{description}: {'; '.join(faults) or 'fine'}", flush=True)
    print(f"{times - bad} of {times} ended as expected")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
