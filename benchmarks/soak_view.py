"""The live view under load: browsers that come and go, hostile requests, slow clients.

    python -m benchmarks.soak_view [TREE] [--rounds 250]
    python -m benchmarks.soak_view [TREE] --slow 200

During a run, a process repeatedly opens the page, aborts requests, and sends data that is not HTTP,
bodies of 10 MB, wrong host names and foreign origins. Prints how often the page was opened, how
many hostile requests were served, by how much the run's process has grown since a tenth of the
rounds, and whether the hash equals that of an unobserved run.

With --slow N, a process opens N connections of each kind of slow client (idle, half a request, half
a body, readers that take nothing) and leaves them open while everything that a page shows is
requested. Prints the response times and the resources of the run's process.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import bt_dualarm
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.runtime.run import Run
from bt_dualarm.viewer.live_view import LiveView

STRANGERS = r"""
import http.client, json, random, socket, sys
from urllib.parse import urlsplit
place, rounds = urlsplit(sys.argv[1]), int(sys.argv[2])
port, base, rng = place.port, place.path, random.Random(5)
good = {"Host": f"127.0.0.1:{port}"}
counts = {"opened": 0, "strange": 0, "served": 0, "refused": 0, "broken": 0}
GO = json.dumps({"action": "explode"})
def ask(path, body=None, headers=good, method=None):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    try:
        connection.request(method or ("GET" if body is None else "POST"), path, body, dict(headers))
        answer = connection.getresponse()
        answer.read()
        return answer.status
    except (OSError, http.client.HTTPException):
        return 0
    finally:
        connection.close()
def strange(status):
    counts["strange"] += 1
    counts["served" if 200 <= status < 300 else "refused" if status else "broken"] += 1
def raw(content):
    with socket.create_connection(("127.0.0.1", port), timeout=20) as connection:
        try:
            connection.sendall(content)
            if rng.random() < 0.5:
                connection.shutdown(socket.SHUT_WR)
                said = connection.recv(200)
                strange(200 if b" 200 " in said else 400 if said else 0)
            else:
                strange(0)
        except OSError:
            strange(0)
JSON = {"Content-Type": "application/json"}
for number in range(rounds):
    for what in ("", "now", "log?after=0", "series"):
        status = ask(base + what)
        counts["opened"] += status == 200
    raw(rng.randbytes(rng.randrange(1, 3000)))
    raw(b"GET " + base.encode() + b"now HTTP/1.1\r\nHost: 127.0.0.1\r\nX: " + b"x" * 70000)
    begun = b"do HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nContent-Length: 99" % port
    raw(b"POST " + base.encode() + begun)
    raw(b"\x16\x03\x01" + rng.randbytes(200))
    strange(ask(base + "now", headers={"Host": f"evil.example:{port}"}))
    strange(ask(base + "now", headers={**good, "Origin": "http://evil.example"}))
    strange(ask(base + "do", GO, {**good, **JSON, "Origin": "null"}))
    strange(ask(f"/{'a' * 22}/now"))
    strange(ask(base + "do", GO, {**good, **JSON}))
    strange(ask(base + "do", b"[" * 19000, {**good, **JSON}))
    strange(ask(base + "at?t=" + rng.choice(["nan", "-1", "1e300", "x", "'"])))
    strange(ask(base + "now", headers=good, method=rng.choice(["PUT", "DELETE", "OPTIONS"])))
    if number % 25 == 0:
        strange(ask(base + "do", b"x" * 10_000_000, {**good, **JSON}))
    if number % max(1, rounds // 10) == 0:
        print(json.dumps(counts), flush=True)
print(json.dumps(counts), flush=True)
"""

SLOW = r"""
import socket, sys
from urllib.parse import urlsplit
place, count = urlsplit(sys.argv[1]), int(sys.argv[2])
port, base = place.port, place.path.encode()
host = b"Host: 127.0.0.1:%d\r\n" % port
kinds = {
    "idle": b"",
    "half a request": b"GET " + base + b"now HTTP/1.1\r\n" + host,
    "half a body": b"POST " + base + b"do HTTP/1.1\r\n" + host
    + b"Content-Type: application/json\r\nContent-Length: 99\r\n\r\n{",
    "takes nothing": b"GET " + base + b" HTTP/1.1\r\n" + host + b"\r\n",
}
for name, begun in kinds.items():
    opened = []
    for _ in range(count):
        one = socket.create_connection(("127.0.0.1", port), timeout=30)
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        one.sendall(begun)
        opened.append(one)
    print(name, flush=True)
    sys.stdin.readline()
    for one in opened:
        one.close()
"""


def size() -> tuple[float, int, int]:
    """Memory of this process in MB, its threads and open files."""
    pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1])
    files = len([*Path("/proc/self/fd").iterdir()])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6, threading.active_count(), files


def soak(view: LiveView, rounds: int) -> None:
    """Run the hostile client; afterwards let the run continue at full speed."""
    command = [sys.executable, "-c", STRANGERS, view.url, str(rounds)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as strangers:
        sizes = []
        for line in strangers.stdout or ():
            counts = json.loads(line)
            sizes.append(size())
            print(f"{counts}  {sizes[-1][0]:.0f} MB, {sizes[-1][1]} threads, {sizes[-1][2]} files")
    time.sleep(1.0)
    after = size()
    early = sizes[1]
    print(
        f"grown by {after[0] - early[0]:.1f} MB, {after[1] - early[1]} threads, "
        f"{after[2] - early[2]} files since a tenth of it"
    )
    view.gate.set_speed(None)
    view.gate.go()


def serve_slow_clients(view: LiveView, count: int) -> None:
    """Send the requests of a page while slow clients of each kind keep connections open."""
    command = [sys.executable, "-c", SLOW, view.url, str(count)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, text=True, **pipes) as clients:  # type: ignore[call-overload]  # by keyword
        for name in clients.stdout or ():
            took = []
            for what in ("", "now", "log?after=0", "series") * 10:
                began = time.monotonic()
                with urllib.request.urlopen(view.url + what, timeout=60) as answer:  # noqa: S310 - our own
                    answer.read()
                took.append(time.monotonic() - began)
            memory, threads, files = size()
            print(
                f"{count} x {name.strip()}: {len(took)} of {len(took)} requests answered, "
                f"at most {max(took):.3f} s; {memory:.0f} MB, {threads} threads, {files} files"
            )
            clients.stdin.write("\n")
            clients.stdin.flush()
    view.gate.set_speed(None)
    view.gate.go()


def run_disturbed(run: Run, stop: StopRequest, disturb: Callable[[LiveView], None]) -> str:
    """Hash of a run during which the live view is disturbed."""
    with LiveView(run, stop, paused=False) as view:
        thread = threading.Thread(target=disturb, args=(view,))
        view.gate.set_speed(0.1)
        thread.start()
        sha256 = run.finish().state_sha256
        thread.join()
    if run.open_record is not None:
        run.open_record.recorder.close()
    return sha256


def main() -> None:
    """Run the tree with and without the disturbance, and compare the hashes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tree", nargs="?", default="pick_and_track")
    parser.add_argument("--rounds", type=int, default=250)
    parser.add_argument("--slow", type=int, help="connections of each kind of slow client")
    arguments = parser.parse_args()
    disturb = partial(soak, rounds=arguments.rounds)
    if arguments.slow is not None:
        disturb = partial(serve_slow_clients, count=arguments.slow)
    plain = bt_dualarm.run(arguments.tree).state_sha256
    stop = StopRequest()
    with (
        TemporaryDirectory() as folder,
        bt_dualarm.open(arguments.tree, stop=stop, record=Path(folder) / "out") as run,
    ):
        disturbed = run_disturbed(run, stop, disturb)
    print("the hash is the same" if disturbed == plain else "THE HASH DIFFERS")


if __name__ == "__main__":
    main()
