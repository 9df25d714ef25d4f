"""What the live view costs: CPU time of a run with one browser and without, in turns.

    python -m benchmarks.viewing [TREE] [--rounds 3]

The browser is a process that asks as the page does, every 80 ms; its own time is not counted.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time

import bt_dualarm
from bt_dualarm.live.view import LiveView
from bt_dualarm.runtime.signals import StopRequest

BROWSER = """
import sys, time, urllib.request
try:
    while True:
        urllib.request.urlopen(sys.argv[1] + "now").read()
        time.sleep(0.08)
except OSError:
    pass
"""


def cost(tree: str, *, viewed: bool) -> float:
    """CPU time of this process for the run, in s."""
    stop = StopRequest()
    with bt_dualarm.open(tree, stop=stop) as run:
        if not viewed:
            before = time.process_time()
            run.finish()
            return time.process_time() - before
        with LiveView(run, stop, paused=False) as view:
            view.gate.set_speed(None)
            with subprocess.Popen([sys.executable, "-c", BROWSER, view.url]) as browser:
                before = time.process_time()
                run.finish()
                took = time.process_time() - before
                browser.terminate()
            return took


def main() -> None:
    """Take turns."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tree", nargs="?", default="pick_and_track")
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    cost(arguments.tree, viewed=False)
    ratios = []
    for _ in range(arguments.rounds):
        plain = cost(arguments.tree, viewed=False)
        seen = cost(arguments.tree, viewed=True)
        ratios.append(seen / plain)
        print(f"without {plain:.2f} s, with one browser {seen:.2f} s of CPU")
    print(f"median of the ratios {statistics.median(ratios):.3f}")


if __name__ == "__main__":
    main()
