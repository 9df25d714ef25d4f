"""Whether runs resumed from a record equal the uninterrupted ones, and how fast they are.

    python -m benchmarks.resuming [--times 10] [--seed 0]

Each of five runs is recorded once, then resumed at random times: with two arms and a camera, in
`rough`, by sight alone, by a marker, with a changed parameter, with spawned arms. Prints how many
final hashes equal those of the uninterrupted runs, and how much faster than real time the past was
restored, without rendering its images again.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import bt_dualarm
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.rerun import Changed, resumed
from bt_dualarm.skill.registry import Registry

MARKED = """\
bt_dualarm: 1
name: marked
params:
  speed: {type: number, default: 0.4, range: [0.1, 1]}
world: {scene: empty, reality: rough, time_limit: 60}
objects:
  block:
    shape: box
    size: [0.06, 0.06, 0.04]
    mass: 0.1
    pose: {xyz: [0.45, 0, 0.02]}
    marker: {dictionary: apriltag_36h11, id: 5, size: 0.045}
arms:
  finder:
    robot: panda
    camera: {mount: wrist, resolution: [320, 240], fov: 50, fps: 30}
    tree:
      sequence:
        - look_at: {at: {xyz: [0.45, 0, 0.02]}, distance: 0.35}
        - locate: {object: block, by: marker, pose: "{block}"}
        - go_home
  artist:
    robot: ur5
    base: {xyz: [0, 1.5, 0]}
    tree:
      sequence:
        - reach_to_pose: {posture: present, speed: "{speed}"}
        - circle: {plane: yz, radius: 0.08, speed: "{speed}"}
"""

CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "pick_and_track": ("pick_and_track", {}),
    "pick_and_track, rough, seed 5": ("pick_and_track", {"reality": "rough", "seed": 5}),
    "pick_by_sight": ("pick_by_sight", {"seed": 2}),
    "a marker and two arms, rough, speed=0.7": (MARKED, {"params": {"speed": 0.7}}),
    "spawn_and_command": ("spawn_and_command", {}),
}


def main() -> None:
    """Record and resume the runs, and compare their hashes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    registry = Registry.load()
    equal = count = 0
    with tempfile.TemporaryDirectory() as name:
        for number, (case, (tree, options)) in enumerate(CASES.items()):
            folder = Path(name) / str(number)
            sha256 = bt_dualarm.run(tree, record=folder, **options).state_sha256
            record = Record.read(folder)
            factors = []
            for at in rng.uniform(0.1, record.until, arguments.times):
                before = time.process_time()
                with resumed(record, float(at), registry, Changed()) as run:
                    factors.append(float(at) / (time.process_time() - before))
                    equal += run.finish().state_sha256 == sha256
                count += 1
            median = float(np.median(factors))
            print(f"{case}: {median:.1f} s of the past per CPU second (median)", flush=True)
    print(f"{equal} of {count} final hashes equal those of the uninterrupted runs")


if __name__ == "__main__":
    main()
