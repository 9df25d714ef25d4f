"""Turn runs into a data set for imitation learning, in LeRobot's format, and inspect it.

Needs the extra ``export`` (``pip install 'bt_dualarm[export]'``), which brings pyarrow.

Usage: python 13_export_for_learning.py [FOLDER]

Prints::

    written: data (2 episodes, 104 frames)
    25 frames a second, 2 episodes, 104 frames
      observation.state        float32 [6]
      observation.velocity     float32 [6]
      observation.effort       float32 [6]
      action                   float32 [6]
    ...
      arm1.shoulder_pan_joint     0.04... rad, standard deviation 0.11... rad
      arm1.shoulder_lift_joint   -0.92... rad, standard deviation 0.07... rad
    ...
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import bt_dualarm as bt

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())

# A run with its record is one demonstration; the seed samples another robot for each.
records = [folder / f"run_{seed}" for seed in (1, 2)]
for seed, record in enumerate(records, start=1):
    bt.run("circle", params={"turns": 1, "speed": 1.0}, seed=seed, record=record)

program = Path(sys.executable).with_name("bt-record")
command: list[str | Path] = [
    program,
    "export",
    *records,
    "--lerobot",
    folder / "data",
    "--only-successes",
]
done = subprocess.run(command, capture_output=True, text=True, check=True)
print(done.stdout.replace(str(folder) + "/", ""), end="")

info = json.loads((folder / "data" / "meta" / "info.json").read_text())
print(f"{info['fps']} frames a second, {info['total_episodes']} episodes, ", end="")
print(f"{info['total_frames']} frames")
for name, feature in info["features"].items():
    print(f"  {name:24} {feature['dtype']} {feature['shape']}")

# It includes statistics for normalization; frames are in Parquet files below `data/data`.
stats = json.loads((folder / "data" / "meta" / "stats.json").read_text())["action"]
for name, mean, std in zip(
    info["features"]["action"]["names"], stats["mean"], stats["std"], strict=True
):
    print(f"  {name:26} {mean:6.3f} rad, standard deviation {std:.3f} rad")
