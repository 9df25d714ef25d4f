"""Test how robust a tree is: run it with many seeds, each of which samples another robot.

Prints::

    lab:   5 of 5 succeeded, RMS error 0.045... to 0.05... mm
    rough: 5 of 5 succeeded, RMS error 0.063... to 0.07... mm
"""

import bt_dualarm as bt

for reality in ("lab", "rough"):
    results = [
        bt.run("circle", params={"turns": 1}, reality=reality, seed=seed) for seed in range(5)
    ]
    successes = sum(result.outcome is bt.Outcome.SUCCESS for result in results)
    errors_mm = [
        1000 * result.arms["arm1"].leaves["circle"].metrics["path_rms_m"] for result in results
    ]
    print(f"{reality + ':':6} {successes} of {len(results)} succeeded, ", end="")
    print(f"RMS error {min(errors_mm):.4f} to {max(errors_mm):.4f} mm")
