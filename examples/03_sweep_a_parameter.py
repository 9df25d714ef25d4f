"""Run one tree with several values of a parameter and compare the measurements.

Prints::

    speed  duration   RMS error   largest error
     0.25    2.90 s    0.046... mm     0.19... mm
     0.50    2.07 s    0.046... mm     0.2... mm
     1.00    1.50 s    0.044... mm     0.19... mm
"""

import bt_dualarm as bt


def measure(speed: float) -> tuple[float, float, float]:
    """Duration in s, RMS and largest distance of the tool from its plan in mm."""
    result = bt.run("circle", params={"speed": speed, "turns": 1})
    metrics = result.arms["arm1"].leaves["circle"].metrics
    return metrics["duration_s"], 1000 * metrics["path_rms_m"], 1000 * metrics["path_max_m"]


# Runs do not know of each other. For a long sweep give `measure` to the `map` of a
# `concurrent.futures.ProcessPoolExecutor`: one process computes one run at a time.
print("speed  duration   RMS error   largest error")
for speed in (0.25, 0.5, 1.0):
    duration, rms, largest = measure(speed)
    print(f"{speed:5.2f} {duration:7.2f} s {rms:9.4f} mm {largest:9.3f} mm")
