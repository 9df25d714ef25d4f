"""Cost of the live view: CPU time of a run with and without one browser.

    python -m benchmarks.viewing [TREE] [--rounds 3]

Runs alternate with and without a browser. The browser is a process that sends the page's requests:
the state of the run every 80 ms, and every 400 ms the log and a camera image; its own time is not
counted. Both runs keep a record, which is not completed.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import bt_dualarm
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.runtime.run import Run
from bt_dualarm.viewer.live_view import LiveView

BROWSER = """
import sys, time, urllib.request
def ask(what):
    try:
        urllib.request.urlopen(sys.argv[1] + what).read()
    except urllib.error.HTTPError:
        pass
try:
    ask("scene")
    while True:
        for _ in range(5):
            ask("now")
            time.sleep(0.08)
        ask("log?after=0")
        ask("eye?arm=" + sys.argv[2])
except OSError:
    pass
"""


def cost(tree: str, *, viewed: bool) -> float:
    """CPU time of this process for a run, s."""
    stop = StopRequest()
    with (
        TemporaryDirectory() as folder,
        bt_dualarm.open(tree, stop=stop, record=Path(folder) / "out") as run,
    ):
        took = finish_with_browser(run, stop) if viewed else finish(run)
        if run.open_record is not None:
            run.open_record.recorder.close()
        return took


def finish(run: Run) -> float:
    """CPU time of the run alone, s."""
    before = time.process_time()
    run.finish()
    return time.process_time() - before


def finish_with_browser(run: Run, stop: StopRequest) -> float:
    """CPU time of the run with a browser connected, s."""
    with LiveView(run, stop, paused=False) as view:
        view.gate.set_speed(None)
        command = [sys.executable, "-c", BROWSER, view.url, [*run.arms][-1]]
        with subprocess.Popen(command) as browser:
            took = finish(run)
            browser.terminate()
        return took


def main() -> None:
    """Run both kinds alternately and print the ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tree", nargs="?", default="pick_and_track")
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    cost(arguments.tree, viewed=False)
    ratios = []
    for _ in range(arguments.rounds):
        plain = cost(arguments.tree, viewed=False)
        viewed = cost(arguments.tree, viewed=True)
        ratios.append(viewed / plain)
        print(f"without {plain:.2f} s, with one browser {viewed:.2f} s of CPU")
    print(f"median of the ratios {statistics.median(ratios):.3f}")


if __name__ == "__main__":
    main()
