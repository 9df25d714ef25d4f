"""Write a record and plot the planned and the executed path, in the plane of the circle.

Usage: python 08_plot_a_record.py [FOLDER]

Prints::

    record/arm1_plane.png
    record/arm1_time.png
    record/events.jsonl
    record/overview.png
    record/run.history
    record/samples.npz
    record/scene.png
    record/summary.json
    SUCCESS, 0.044... mm RMS, 207 positions of the tool
    wrote circle.png
"""

import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure  # draws without a display

import bt_dualarm as bt

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
result = bt.run("circle", params={"speed": 1.0, "turns": 1}, record=folder / "record")
for file in sorted((folder / "record").iterdir()):
    print(file.relative_to(folder))

# The files of a record can be read without this package: JSON and NumPy's format.
summary = json.loads((folder / "record" / "summary.json").read_text())
samples = np.load(folder / "record" / "samples.npz")
tool = samples["tool_arm1"]  # positions in the world at 100 Hz, of shape (n, 3), m
metrics = summary["arms"]["arm1"]["leaves"][0]["metrics"]
rms_mm = 1000 * metrics["path_rms_m"]
print(f"{summary['outcome']}, {rms_mm:.4f} mm RMS, {len(tool)} positions of the tool")

# The result has the skill's own series, too, at the controller's rate.
planned = result.arms["arm1"].leaves["circle"].series["planned"].values
figure = Figure(figsize=(4, 4), layout="constrained")
axes = figure.add_subplot(aspect="equal", xlabel="y (m)", ylabel="z (m)")
axes.plot(planned[:, 1], planned[:, 2], label="planned", linewidth=3, alpha=0.4)
axes.plot(tool[:, 1], tool[:, 2], label="executed", linewidth=1)
axes.legend()
figure.savefig(folder / "circle.png")
print("wrote circle.png")
