"""Draw the animations of the cookbook, `docs/images/cookbook/NAME.webp`.

    .venv/bin/python docs/images/cookbook.py [NAME ...]

Each tree is run with seed 0 and recorded; about fifty frames of the scene are drawn, two or three a
second, so that the animation shows the task in fast motion and stays below 400 kB.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Final

import numpy as np

import bt_dualarm
from bt_dualarm.export.video import FilmScene, clear_corner, followed
from bt_dualarm.replay.record import Record

COOKBOOK: Final = Path(__file__).parents[1] / "cookbook"
TARGETS: Final = Path(__file__).with_name("cookbook")
SIZE: Final = (440, 300)
FRAMES: Final = 50
SHOWN_MS: Final = 160
"""Time for which the animation shows a frame."""

MOST_BYTES: Final = 400_000


def draw(record: Record, target: Path) -> None:
    """Write the animation of a record."""
    times = np.linspace(float(record.times[0]), record.until, FRAMES).tolist()
    aspect = SIZE[0] / SIZE[1]
    viewpoints = followed(record, times, aspect)
    scene = FilmScene(record, SIZE, *clear_corner(record, times, viewpoints, aspect))
    images = [
        scene.draw(record.moment(record.index_at(time)), viewpoint).convert("RGB")
        for time, viewpoint in zip(times, viewpoints, strict=True)
    ]
    for quality in (60, 45, 30, 15):
        images[0].save(
            target,
            save_all=True,
            append_images=images[1:],
            duration=SHOWN_MS,
            loop=0,
            quality=quality,
            method=4,
        )
        if target.stat().st_size <= MOST_BYTES:
            return
    raise SystemExit(f"{target} has {target.stat().st_size} bytes")


def main() -> int:
    """Run, record and draw the given trees, or all of them; returns the exit code."""
    TARGETS.mkdir(exist_ok=True)
    for name in sys.argv[1:] or sorted(path.stem for path in COOKBOOK.glob("*.yaml")):
        with tempfile.TemporaryDirectory() as folder:
            result = bt_dualarm.run(COOKBOOK / f"{name}.yaml", record=folder)
            if str(result.outcome) != "SUCCESS":
                sys.stderr.write(f"{name}: {result.outcome}\n")
                return 1
            draw(Record.read(Path(folder)), TARGETS / f"{name}.webp")
    return 0


if __name__ == "__main__":
    sys.exit(main())
